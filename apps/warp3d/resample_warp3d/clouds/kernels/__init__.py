"""Numba kernels of clouds; they take only arrays and numbers."""
