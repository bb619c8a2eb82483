"""The library of kernels: which are built in, and how they become a shared library."""
