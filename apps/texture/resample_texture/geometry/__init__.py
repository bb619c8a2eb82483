"""Geometry of warps: matrices, corners, maps, lenses and planes."""
