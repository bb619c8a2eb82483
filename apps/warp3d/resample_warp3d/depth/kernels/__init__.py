"""The numba code of depth images: bare arrays and numbers."""
