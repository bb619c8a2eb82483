"""Comparisons of methods with a truth, and the methods of others to compare with."""
