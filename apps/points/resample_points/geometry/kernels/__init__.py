"""Numba kernels that measure clouds; they take only arrays and numbers."""
