"""Numba kernels of rivals; they take only arrays and numbers."""
