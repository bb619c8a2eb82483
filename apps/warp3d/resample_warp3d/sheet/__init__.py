"""Depth images as sheets of cells, painted in two layers."""
