"""Depth images: a scene with a truth, comparisons, and methods from the literature."""
