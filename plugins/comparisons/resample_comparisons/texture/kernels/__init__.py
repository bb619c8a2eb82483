"""Numba kernels; they take only arrays and numbers."""
