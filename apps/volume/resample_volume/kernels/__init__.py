"""The numba code of volumes: bare arrays and numbers."""
