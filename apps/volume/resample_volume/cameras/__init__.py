"""Cameras around a volume, and their ways."""
