"""The numba code of splats and points: bare arrays and numbers."""
