"""Volumes that come as pictures: pages and slices."""
