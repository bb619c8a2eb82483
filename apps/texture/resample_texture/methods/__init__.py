"""Our own warping methods, by name."""
