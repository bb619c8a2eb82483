"""Sizes of pictures, and windows of them."""

import operator
from collections.abc import Sequence
from typing import Any

import numpy as np

from resample.messages import check_threads, shortly

Window = tuple[int, int, int, int]  # x0, y0, x1, y1, px of the whole picture; the end is exclusive
LARGEST_PICTURE = 2**28  # px


def shape_of(size: Sequence[int] | int) -> tuple[int, int]:
    """Height and width from a size, which is width and height, or both of a square, px."""
    both = (size, size) if isinstance(size, int | np.integer) else size
    width, height = pair_of("size", both, "width and height")
    check_size(height, width)
    return height, width


def pair_of(name: str, given: Any, wanted: str) -> tuple[int, int]:
    """Two whole numbers of px."""
    try:
        first, second = (operator.index(number) for number in given)
    except (TypeError, ValueError):
        raise ValueError(
            f"{name} {shortly(given)}; give {wanted}, two whole numbers of px"
        ) from None
    return first, second


def check_call(camera: Any, height: Any, width: Any, threads: Any) -> None:
    """Check a camera, the size of a picture and the number of threads."""
    check_size(*pair_of("height and width", (height, width), "both"))
    check_threads(threads)
    if isinstance(camera, np.ndarray) or not callable(getattr(camera, "view", None)):
        raise TypeError(
            f"a camera of {type(camera).__name__}; give a Camera or another with a view, such as "
            "Camera.from_fov(60, height, width)"
        )


def check_size(height: int, width: int) -> None:
    """Reject an invalid size of a picture, px."""
    if height < 1 or width < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a picture of {width} x {height} pixels; both sides must be at least 1 and there can "
            f"be at most {LARGEST_PICTURE} pixels"
        )
