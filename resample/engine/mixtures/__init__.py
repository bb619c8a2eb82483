"""Samples of which each is a splat or a point, projected and painted nearest first."""
