"""Formats of volumes: what their files say, and how some are written."""
