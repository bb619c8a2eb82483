"""Read and write pictures and films."""
