"""Numba kernels of references; they take only arrays and numbers."""
