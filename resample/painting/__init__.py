"""Samples to pictures: checked, seen by a camera, in runs of neighbours, painted."""
