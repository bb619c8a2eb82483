"""Measured and shown: scenes, pairs, comparisons, figures."""
