"""The numba code of voxels: bare arrays and numbers."""
