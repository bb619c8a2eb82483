"""The `resample-volume` command."""
