"""Surfaces among voxels: meshes, image planes, isosurfaces and sections."""
