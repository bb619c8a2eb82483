"""What all command lines share, and the `resample` command."""
