"""The operator every primitive ends in: something behind all that a sub-pixel has seen so far."""

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single

VISIBLE = 1.0 / 255.0  # opacity from which on a pixel counts as having seen something

Light = tuple[
    Single, Single, Single, Single
]  # straight red, green, blue, and the depth they are at


@kernel
def behind(pixel: Floats, row: int, column: int, alpha: Single, light: Light) -> Single:
    """Composite a straight color behind a sub-pixel of (h, w, 8); gives what it still lets pass."""
    before = pixel[row, column, 3]
    share = before * alpha
    after = before - share
    pixel[row, column, 0] += share * light[0]
    pixel[row, column, 1] += share * light[1]
    pixel[row, column, 2] += share * light[2]
    pixel[row, column, 3] = after
    pixel[row, column, 4] += share * light[3]
    pixel[row, column, 7] += share
    if pixel[row, column, 6] == np.inf and after < np.float32(1.0 - VISIBLE):
        pixel[row, column, 6] = light[3]
    return after
