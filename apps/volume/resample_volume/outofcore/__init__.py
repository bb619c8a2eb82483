"""Volumes larger than memory: windows, and what they depend on of all voxels, brick by brick."""
