"""Machine code of kernels: compiled by numba, cached on disk, or built ahead into a library."""
