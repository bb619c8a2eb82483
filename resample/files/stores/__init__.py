"""Chunked zarr arrays: access and OME-Zarr metadata."""
