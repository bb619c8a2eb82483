"""Zarr and OME-Zarr: volumes and pictures in chunks, on disk and at addresses."""
