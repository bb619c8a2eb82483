"""Kernels that measure hardware limits, count fragments, and stand in for other methods."""
