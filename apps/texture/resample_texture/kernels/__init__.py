"""The numba code of texture mapping: bare arrays and numbers."""
