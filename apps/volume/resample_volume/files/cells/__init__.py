"""Grids of cells of any shape, or of several blocks, resampled onto a lattice by VTK."""
