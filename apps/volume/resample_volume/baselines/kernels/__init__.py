"""Numba kernels of the reference; they take only arrays and numbers."""
