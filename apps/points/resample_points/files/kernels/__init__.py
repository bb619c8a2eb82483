"""Numba kernels of readers; they take only arrays and numbers."""
