"""Previews: pictures of fewer pixels, enlarged to full size."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

RESIZED = ("uint8", "uint16", "int16", "float32", "float64")  # types that OpenCV resizes


def enlarged(part: NDArray[Any], per: int, shape: tuple[int, int], *, smooth: bool) -> NDArray[Any]:
    """Enlarge each pixel of a picture (h, w) or (h, w, C) to `per` × `per` pixels.

    Parameters
    ----------
    shape
        Height and width of the result, px; the excess is cropped.
    """
    import cv2

    height, width = part.shape[:2]
    if part.dtype.name in RESIZED and part[0, 0].size <= 4:
        kind = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        large = cv2.resize(part, (width * per, height * per), interpolation=kind)
    else:
        large = part.repeat(per, axis=0).repeat(per, axis=1)
    whole = large.reshape(height * per, width * per, *part.shape[2:])
    return np.ascontiguousarray(whole[: shape[0], : shape[1]])
