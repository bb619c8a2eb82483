"""Test scenes, comparisons and figures."""
