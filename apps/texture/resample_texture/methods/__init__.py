"""Our own ways to warp, by name."""
