"""Unstructured and multiblock grids, resampled onto a lattice by VTK."""
