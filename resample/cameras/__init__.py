"""Camera models, lenses, poses and their files."""
