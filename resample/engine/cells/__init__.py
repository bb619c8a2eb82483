"""Cells of a surface on the screen: placed in batches, shared out among pixels, summed."""
