"""Numba kernels of depth images; they take only arrays and numbers."""
