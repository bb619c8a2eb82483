"""Image pyramid by box means, down to one texel, packed in one array."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats

MOST_CHANNELS = 4  # that OpenCV shrinks in one call


class Pyramid(NamedTuple):
    """The levels of a picture's pyramid."""

    texel: Floats  # (T,) all levels, one after the other, each of them (h, w, C)
    levels: NDArray[np.int64]  # (L, 3) where a level begins in `texel`, its height and its width


def pyramid(source: Floats) -> Pyramid:
    """Return the pyramid of a picture (H, W, C).

    A level has half the rows and columns of the previous one, rounded down and at least one. At odd
    sizes texels are means over more than 2 × 2 texels, of which the outer ones count in part.
    """
    pictures = [source]
    while max(pictures[-1].shape[:2]) > 1:
        height, width = pictures[-1].shape[:2]
        pictures.append(shrunk(pictures[-1], max(1, height // 2), max(1, width // 2)))
    ends = np.cumsum([picture.size for picture in pictures])
    levels = [
        (end - picture.size, *picture.shape[:2])
        for end, picture in zip(ends, pictures, strict=True)
    ]
    texel = np.concatenate([picture.ravel() for picture in pictures])
    return Pyramid(texel, np.array(levels, np.int64))


def shrunk(picture: Floats, height: int, width: int) -> Floats:
    """Shrink a picture (H, W, C) to (height, width, C) by box means."""
    import cv2

    result = np.empty((height, width, picture.shape[2]), np.float32)
    for first in range(0, picture.shape[2], MOST_CHANNELS):
        part = np.ascontiguousarray(picture[..., first : first + MOST_CHANNELS])
        small = cv2.resize(part, (width, height), interpolation=cv2.INTER_AREA)
        result[..., first : first + MOST_CHANNELS] = small.reshape(height, width, -1)
    return result
