"""The numba code of generated scenes: bare arrays and numbers."""
