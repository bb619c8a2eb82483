"""Several volumes, colors, channels and times, put together."""
