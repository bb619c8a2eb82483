"""The numba code of 3D warping: bare arrays and numbers."""
