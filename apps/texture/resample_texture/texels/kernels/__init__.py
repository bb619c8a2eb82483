"""The numba code of texels: bare arrays and numbers."""
