"""Pictures larger than memory, read and written strip by strip."""
