"""New sizes of pictures: given in px or as a share, and how a picture fills them."""

import math
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from resample.words import doubles_of, shortly
from resample_texture.arguments import check_shape, whole_pair
from resample_texture.geometry.mappings import Homography
from resample_texture.geometry.matrices import resizing, scaled_shape

Fit = Literal["contain", "cover", "stretch", "pad"]
AnySize = tuple[int, int] | int | float  # height and width; longer side; share


def resized(
    source_shape: tuple[float, float],
    size: AnySize | None = None,
    *,
    height: int | None = None,
    width: int | None = None,
    fit: Fit | None = None,
    box: Sequence[float] | None = None,
) -> tuple[Homography, tuple[int, int]]:
    """Return the map from a picture (height, width) to its new size, and that size.

    `size` and the others are as `resample_texture.resize` takes its shape and the others.
    """
    if box is not None:
        left, top, right, bottom = _checked(box, source_shape, fit)
        part = bottom - top, right - left
        placed, shape = resized(part, size, height=height, width=width, fit=fit)
        return Homography(placed.matrix @ [[1, 0, -left], [0, 1, -top], [0, 0, 1]]), shape
    fit, (down, across) = _filled(source_shape, size, height, width, fit)
    if fit == "stretch":
        return resizing(source_shape, (down, across)), (down, across)
    factors = down / source_shape[0], across / source_shape[1]
    factor = max(factors) if fit == "cover" else min(factors)
    shown = _rounded(source_shape[0] * factor), _rounded(source_shape[1] * factor)
    if fit == "contain":
        return resizing(source_shape, shown), shown
    matrix = resizing(source_shape, shown).matrix
    matrix[:2, 2] = (across - shown[1]) // 2, (down - shown[0]) // 2  # whole px stay sharp
    return Homography(matrix), (down, across)


def _filled(
    source_shape: tuple[float, float],
    size: Any,
    height: int | None,
    width: int | None,
    fit: Fit | None,
) -> tuple[Fit, tuple[int, int]]:
    """Return how a picture fills a height and a width, px, and these."""
    if (size is None) == (width is None and height is None):
        raise ValueError("give a size, or a width, a height or both")
    if fit not in (None, "contain", "cover", "stretch", "pad"):
        raise ValueError(f"fit {fit!r}; known: contain, cover, stretch, pad")
    is_share = isinstance(size, float | np.floating)
    if fit is not None and (is_share or (size is None and None in (width, height))):
        raise ValueError("fit needs a width and a height in px, or one number for both")
    if isinstance(size, float | np.floating):
        return "stretch", scaled_shape(source_shape, (float(size), float(size)))
    if size is not None:
        usual: Fit = "stretch" if np.ndim(size) else "contain"
        box = whole_pair(size if np.ndim(size) else (size, size), "height", "width")
        check_shape(box)
        return fit or usual, box
    rows, columns = source_shape
    down = _side("height", height, rows * (width or 0) / columns)
    return fit or "stretch", (down, _side("width", width, columns * (height or 0) / rows))


def _checked(
    box: Sequence[float], source_shape: tuple[float, float], fit: Fit | None
) -> tuple[float, float, float, float]:
    """Return left, top, right and bottom of a part of a picture (height, width)."""
    sides = doubles_of("box", box, "left, top, right and bottom, px").ravel().tolist()
    height, width = source_shape
    if len(sides) != 4 or not (
        0 <= sides[0] < sides[2] <= width and 0 <= sides[1] < sides[3] <= height
    ):
        raise ValueError(
            f"box {shortly(box)} of a picture of {width} × {height} px; give left, top, right and"
            " bottom of a part of it"
        )
    if fit == "pad":
        raise ValueError("pad fills up around whole pictures; leave box out, or cut it out first")
    left, top, right, bottom = sides
    return left, top, right, bottom


def _side(name: str, given: int | None, following: float) -> int:
    """Return a side, px: as given, or else in proportion to the other."""
    if given is not None and not (hasattr(given, "__index__") and given > 0):
        raise ValueError(f"{name} {shortly(given)}; give a whole number of px, 1 or more")
    return _rounded(following) if given is None else int(given)


def _rounded(side: float) -> int:
    return max(1, math.floor(side + 0.5))
