"""Constants that all compositing painters share."""

from resample.types import Single

VISIBLE = 1.0 / 255.0  # opacity from which on a pixel counts as covered, for its nearest depth

# Straight red, green, blue, and their depth.
Light = tuple[Single, Single, Single, Single]
