"""The numba code of rivals: bare arrays and numbers."""
