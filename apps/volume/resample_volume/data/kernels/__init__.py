"""The numba code of voxels in their places: bare arrays and numbers."""
