"""Interpolation of fields between thick slices."""
