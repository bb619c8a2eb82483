"""Measured and shown: scenes, comparisons, figures."""
