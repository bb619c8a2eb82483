"""The numba code of references: bare arrays and numbers."""
