"""What painters that composite samples agree on."""

from resample.types import Single

VISIBLE = 1.0 / 255.0  # opacity from which on a pixel counts as having seen something

Light = tuple[
    Single, Single, Single, Single
]  # straight red, green, blue, and the depth they are at
