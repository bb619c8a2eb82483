"""Resize, scale and rotate pictures: `warp` with a matrix that fits the picture."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_texture.arguments import whole_pair
from resample_texture.geometry.matrices import (
    resizing,
    scaled_shape,
    scaling,
    turned_shape,
    turning,
)
from resample_texture.types import Method, Warped
from resample_texture.warping import warp


def resize(
    image: NDArray[Any],
    shape: tuple[int, int],
    *,
    method: str | Method = "hybrid",
    edge: str = "clamp",
    linear_light: bool | None = None,
    alpha: str | None = None,
    **choices: Any,
) -> Warped:
    """Resize a picture so that it fills the target exactly.

    Parameters
    ----------
    image
        As `warp` takes it.
    shape
        Height and width of the result, px.
    method
        Name, or an object with its own options, such as `Hybrid(filter="gaussian:sigma=0.5")`.
    edge, linear_light, alpha
        As `warp` takes them.
    choices
        Its other options, such as `nodata`, `fill` or `threads`.

    Raises
    ------
    ValueError, LookupError
        As `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import resize
    >>> resize(np.uint8([[1, 3, 5, 7]]), (1, 2)).image.tolist()  # means of two texels each
    [[2, 6]]
    >>> resize(np.zeros((48, 64, 3), np.uint8), (30, 40))
    Warped(30 × 40 × 3 uint8, 100 % covered)
    """
    target = whole_pair(shape, "height", "width")
    matrix = resizing(_shape_of(image), target)
    light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
    return warp(image, matrix, target, method, edge=edge, **light, **choices)


def scale(
    image: NDArray[Any],
    factor: float | tuple[float, float],
    *,
    method: str | Method = "hybrid",
    edge: str = "clamp",
    linear_light: bool | None = None,
    alpha: str | None = None,
    **choices: Any,
) -> Warped:
    """Scale a picture by an exact factor; its size is rounded to whole px.

    Parameters
    ----------
    image, method, edge, linear_light, alpha, choices
        As `resize` takes them.
    factor
        Above 0; one factor, or two for x and y.

    Raises
    ------
    ValueError, LookupError
        A factor is not above 0, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import scale
    >>> scale(np.ones((15, 21)), 0.5).image.shape
    (8, 11)
    >>> scale(np.ones((15, 21)), (2, 0.5)).image.shape  # along x and y
    (8, 42)
    """
    both = factor if isinstance(factor, tuple) else (factor, factor)
    target = scaled_shape(_shape_of(image), both)
    matrix = scaling(both)
    light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
    return warp(image, matrix, target, method, edge=edge, **light, **choices)


def rotate(
    image: NDArray[Any],
    degrees: float,
    shape: tuple[int, int] | None = None,
    *,
    method: str | Method = "hybrid",
    edge: str = "transparent",
    linear_light: bool | None = None,
    alpha: str | None = None,
    **choices: Any,
) -> Warped:
    """Rotate a picture counterclockwise about its center; multiples of 90° copy values.

    Parameters
    ----------
    image, method, edge, linear_light, alpha, choices
        As `resize` takes them.
    degrees
        Angle; negative angles turn clockwise.
    shape
        Height and width of the result, px; the centers of picture and result coincide. By default
        the result holds the whole picture.

    Raises
    ------
    ValueError, LookupError
        The angle is not a finite number, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import rotate
    >>> rotate(np.uint8([[1, 2], [3, 4]]), 90).image.tolist()
    [[2, 4], [1, 3]]
    >>> rotate(np.ones((30, 40)), 30)
    Warped(46 × 50 float64, 56.3 % covered)
    """
    source = _shape_of(image)
    target = (
        turned_shape(source, degrees) if shape is None else whole_pair(shape, "height", "width")
    )
    matrix = turning(source, degrees, target)
    light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
    return warp(image, matrix, target, method, edge=edge, **light, **choices)


def _shape_of(image: NDArray[Any]) -> tuple[int, int]:
    """Return height and width of a picture, or of a batch's pictures."""
    shape = np.shape(image)
    height, width = shape[1:3] if len(shape) == 4 else shape[:2] if len(shape) > 1 else (0, 0)
    if min(height, width) < 1:
        raise ValueError(f"a picture has one texel or more in two dimensions, not {shape}")
    return height, width
