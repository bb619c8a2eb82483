"""Test scenes, real pairs, comparisons and figures."""
