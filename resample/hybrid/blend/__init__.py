"""What becomes of all that a pixel gets: sum, nearest surface or over."""
