"""Data beyond memory: bricks and their caches, passes, windows, cached facts."""
