"""Numba kernels for voxel addresses and gradients: bare arrays and numbers."""
