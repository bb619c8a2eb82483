"""Calibrated cameras, their lenses and poses, and files of them."""
