"""Benchmarks: `make bench` for times, `make scores` for quality beside other programs."""
