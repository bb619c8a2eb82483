"""Kernels: neighbours, cells and discs of points, colors of Gaussians, rasters, LZF."""
