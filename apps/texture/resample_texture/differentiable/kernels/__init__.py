"""Numba code of differentiable warps, in float64.

Gradients are those of what is computed.
"""
