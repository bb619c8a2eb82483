"""Volumes: references by rays, comparisons, VTK, and older ways to paint voxels."""
