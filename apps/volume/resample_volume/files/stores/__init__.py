"""Read and write chunked volumes: OME-Zarr and zarr arrays."""
