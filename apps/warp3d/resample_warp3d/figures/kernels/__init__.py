"""Numba kernels of generated scenes; they take only arrays and numbers."""
