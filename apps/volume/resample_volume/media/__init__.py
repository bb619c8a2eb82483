"""Several volumes, colors, channels, times and uneven grids, put together."""
