"""The numba code of clouds: bare arrays and numbers."""
