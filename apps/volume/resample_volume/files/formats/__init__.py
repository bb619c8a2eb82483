"""File formats of volumes: read all, write some."""
