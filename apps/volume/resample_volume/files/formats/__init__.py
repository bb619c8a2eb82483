"""Formats of volumes: read their files, write some."""
