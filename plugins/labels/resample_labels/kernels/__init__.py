"""Numba kernels of label pictures."""
