"""Arrays in chunks, of zarr: opened, and what OME-Zarr says of them."""
