"""Shared by the drop-ins: draw over a background, or some tiles alone; find missing values."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample import registry
from resample.profiles.interpolation import Nearest
from resample_texture.arguments import check_shape, method_named, within
from resample_texture.drawing import MOST_AT_ONCE, Drawing, drawn
from resample_texture.like.shrinking import TILE, Tiles
from resample_texture.methods.forward import Hybrid
from resample_texture.types import Method

NEAREST = "nearest"  # the interpolation that copies texels, done by the method of that name
SPLINES = {order: f"spline:degree={order}" for order in (2, 3, 4, 5)}
ORDERS = {0: NEAREST, 1: "bilinear", **SPLINES}


def method_for(interpolation: str, method: str | Method | None = None) -> Method:
    """Return a method with an interpolation, by default `hybrid` or `nearest`.

    Kernels of other libraries interpolate between values at points, and pixels are averaged only
    where they cover more than a texel; what takes texels for means, as `area-spline` does, averages
    always.
    """
    if method is None:
        if interpolation == NEAREST:
            return method_named(NEAREST)
        kernel = registry.build("interpolations", interpolation)
        is_mean = getattr(kernel, "is_mean", False) or isinstance(kernel, Nearest)
        return Hybrid(interpolation=kernel, average="always" if is_mean else "shrinking")
    chosen = method_named(method)
    if hasattr(chosen, "interpolation"):
        chosen = method_named(chosen, interpolation=interpolation)
    return chosen


def method_of_order(
    order: int, interpolation: str | None, method: str | Method | None, splines: bool = True
) -> Method:
    """Return the method of an order of SciPy's or scikit-image's, or of an interpolation.

    Without `splines` order 3 is scikit-image's cubic convolution.
    """
    if order not in ORDERS:
        raise ValueError(f"order {order!r}; known: 0 to 5")
    kernel = ORDERS[order] if splines or order != 3 else "catmull-rom"
    return method_for(interpolation or kernel, method)


def has_gaps(image: NDArray[Any]) -> bool:
    """Whether an array has a mask, or values that are not finite."""
    if isinstance(image, np.ma.MaskedArray) or image.dtype.kind not in "fc":
        return isinstance(image, np.ma.MaskedArray)
    flat = image.reshape(-1)
    with np.errstate(over="ignore", invalid="ignore"):  # the fastest pass over all values
        is_finite = np.isfinite(np.dot(flat, flat))
    return not (is_finite or np.isfinite(image).all())


def draw(image: NDArray[Any], drawing: Drawing, *, linear_light: bool = False) -> NDArray[Any]:
    """Draw a picture (h, w) or (h, w, C) over its background; missing values stay missing.

    Parameters
    ----------
    image
        (H, W) or (H, W, C), masked or not.
    linear_light
        Filter linear light, not the encoded levels.
    """
    check_shape(drawing.shape)
    return drawn(image, drawing, linear_light=linear_light, alpha="none").image


def tiles_drawn(
    image: NDArray[Any], drawing: Drawing, tiles: Tiles
) -> tuple[tuple[slice, slice], Tiles, NDArray[Any]]:
    """Draw some tiles, see `draw`.

    Returns
    -------
    The part of the target around them; which of its pixels (h, w) are theirs; and the picture.
    """
    # The rectangle around them, and the pixels of tiles in it and in what is drawn around it.
    height, width = drawing.shape
    columns, rows = (np.flatnonzero(tiles.any(axis=axis)) * TILE for axis in (0, 1))
    left, top = int(columns[0]), int(rows[0])
    right, bottom = min(int(columns[-1]) + TILE, width), min(int(rows[-1]) + TILE, height)
    roi = left, top, right - left, bottom - top
    method: Any = drawing.method
    geometry, shape, inner = within(drawing.geometry, drawing.shape, roi, method)
    y, x = top - (inner[0].start or 0), left - (inner[1].start or 0)
    part = np.s_[y : y + shape[0], x : x + shape[1]]
    wanted = tiles.repeat(TILE, axis=0).repeat(TILE, axis=1)[part]
    # Tiles are drawn alone, but for pictures so large that windows of them are.
    if image.size <= MOST_AT_ONCE:
        method = method.partly(wanted)
    behind: Any = drawing.behind
    if behind.shape[:2] != (1, 1):
        behind = behind[part]
    made = draw(image, Drawing(method, geometry, shape, drawing.edge, behind=behind))
    return np.s_[top:bottom, left:right], wanted[inner], made[inner]


def color_behind(
    value: complex | tuple[float, ...], image: NDArray[Any], name: str = "borderValue"
) -> NDArray[Any]:
    """Return a background color (1, 1, C) in the picture's type."""
    kind = np.dtype(np.complex128 if image.dtype.kind == "c" else np.float64)
    values: NDArray[Any] = np.atleast_1d(np.asarray(value, kind))
    channels = image.shape[2] if image.ndim == 3 else 1
    if values.ndim > 1 or (values.size != 1 and values.size < channels):
        raise ValueError(f"{name} {value}: give one number, or {channels}")
    if image.dtype.kind in "iu":
        limits = np.iinfo(image.dtype)
        finite = np.nan_to_num(values, posinf=2.0**70, neginf=-(2.0**70))
        exact = [min(max(round(float(v)), limits.min), limits.max) for v in finite]
        level = np.array(exact, image.dtype)
    else:
        with np.errstate(over="ignore"):
            level = values.astype(image.dtype)
    level = np.broadcast_to(level, channels) if level.size == 1 else level[:channels]
    return level.reshape(1, 1, channels)
