"""Chunked zarr arrays: access, OME-Zarr metadata, and pictures."""
