"""Numba kernels of the application: bare arrays and numbers."""
