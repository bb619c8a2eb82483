"""The numba code of sheets: bare arrays and numbers."""
