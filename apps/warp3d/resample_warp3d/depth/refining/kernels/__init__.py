"""Numba kernels of conditioning; they take only arrays and numbers."""
