"""Volumes in chunks: OME-Zarr and zarr arrays, in and out."""
