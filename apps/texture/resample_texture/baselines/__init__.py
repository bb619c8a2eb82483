"""Baseline warping methods of other libraries, for comparison."""
