"""The numba code of textured triangles: bare arrays and numbers."""
