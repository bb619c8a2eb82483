"""Surfaces in a volume: meshes, image planes, isosurfaces and sections."""
