"""Measured and shown: comparisons, color bars, the paper's figures."""
