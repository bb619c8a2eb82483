"""Pixels that gather: each takes the mean of an interpolated grid over what it covers."""
