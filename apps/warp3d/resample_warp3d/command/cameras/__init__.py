"""Options of the source's and the target's camera."""
