"""Numba kernels of differentiable warps, in float64.

Gradients are the exact derivatives of the forward pass.
"""
