"""The numba code of conditioning: bare arrays and numbers."""
