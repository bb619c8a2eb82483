"""The `resample-points` command."""
