"""Build the kernel library: choose kernels, compile them, link a shared library."""
