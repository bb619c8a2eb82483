"""Numba kernels of maps of particles; they take only arrays and numbers."""
