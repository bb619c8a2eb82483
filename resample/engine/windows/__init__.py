"""Pixels that gather: each takes the mean of an interpolated grid over its footprint."""
