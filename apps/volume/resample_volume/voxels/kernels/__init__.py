"""Numba kernels of voxels; they take only arrays and numbers."""
