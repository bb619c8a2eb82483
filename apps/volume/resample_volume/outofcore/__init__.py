"""Volumes larger than memory: windows, and statistics of all voxels, brick by brick."""
