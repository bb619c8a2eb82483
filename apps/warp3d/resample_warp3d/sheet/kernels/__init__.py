"""Numba kernels of sheets; they take only arrays and numbers."""
