"""Formats of volumes: what their headers say, how values lie, and how some are written."""
