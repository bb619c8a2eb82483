"""Scenes of several volumes, colors, channels and times."""
