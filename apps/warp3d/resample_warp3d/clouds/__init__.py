"""Point clouds: files, colors, spacing, cameras, rendering."""
