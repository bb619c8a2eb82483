"""Baseline methods of warping depth images, for comparison."""
