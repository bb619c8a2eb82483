"""Read and write volumes."""
