"""Old names of `resample_dropins`, which another package has."""
