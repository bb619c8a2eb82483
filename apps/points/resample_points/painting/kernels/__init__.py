"""Numba kernels that paint clouds; they take only arrays and numbers."""
