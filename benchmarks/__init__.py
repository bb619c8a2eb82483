"""Benchmarks against other programs: `make bench`, or `python -m benchmarks GROUP ...`."""
