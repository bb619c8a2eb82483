"""The `resample-warp3d` command."""
