"""Our own ways to warp depth images, by name."""
