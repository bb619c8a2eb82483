"""Speed, side by side with peers: `make bench`, or `python -m benchmarks` with names of groups."""
