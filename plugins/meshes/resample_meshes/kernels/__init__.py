"""Numba kernels of textured triangles; they take only arrays and numbers."""
