"""Grids of cells of VTK's, resampled onto a lattice: `.vts`, `.vtu`, `.vtm`, legacy `.vtk`."""
