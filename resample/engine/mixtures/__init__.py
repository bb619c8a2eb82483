"""Mixtures of splats and points, projected and painted nearest first."""
