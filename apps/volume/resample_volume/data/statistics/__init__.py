"""Statistics of values in bricks, and caches of bricks."""
