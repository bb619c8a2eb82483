"""The numba code of the reference: bare arrays and numbers."""
