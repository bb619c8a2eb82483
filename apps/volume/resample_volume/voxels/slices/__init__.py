"""Fields between thick slices."""
