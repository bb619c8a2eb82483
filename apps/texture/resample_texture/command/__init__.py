"""The `resample-texture` command."""
