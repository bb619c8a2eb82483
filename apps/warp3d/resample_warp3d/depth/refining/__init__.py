"""Depth images conditioned: what is wrong with a depth map, and what color knows better."""
