"""Machine code of kernels: compiled by numba, kept on disk, and built ahead into a library."""
