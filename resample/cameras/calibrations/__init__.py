"""Readers of camera files from other programs."""
