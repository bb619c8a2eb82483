"""Numba kernels of texels; they take only arrays and numbers."""
