"""Shared by the drop-ins: draw over a background, fill given output arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_texture.arguments import check_shape, method_named
from resample_texture.drawing import Drawing, continued, copied, run
from resample_texture.geometry.shifts import Picks
from resample_texture.texels.encoding import check_picture, decoded, encoded
from resample_texture.texels.gaps import LEAST, kept, masked
from resample_texture.types import Method

NEAREST = "nearest"  # the interpolation that copies texels, done by the method of that name
ORDERS = {0: NEAREST, 1: "bilinear", 2: "spline", 3: "spline", 4: "spline", 5: "spline"}


def method_for(interpolation: str, method: str | Method | None) -> Method:
    """Return a method with an interpolation, by default `hybrid` or `nearest`."""
    if method is None:
        method = NEAREST if interpolation == NEAREST else "hybrid"
    chosen = method_named(method)
    if hasattr(chosen, "interpolation"):
        chosen = method_named(chosen, interpolation=interpolation)
    return chosen


def draw(
    image: NDArray[Any], drawing: Drawing, behind: NDArray[Any], *, linear_light: bool = False
) -> NDArray[Any]:
    """Draw a picture (h, w) or (h, w, C) over a background; missing values stay missing.

    Parameters
    ----------
    image
        (H, W) or (H, W, C), masked or not.
    linear_light
        Filter linear light, not the encoded levels.
    """
    check_shape(drawing.shape)
    check_picture(np.ma.getdata(image))
    image, drawing = continued(image, drawing)
    picks = copied(image, drawing)
    if picks is not None:
        return _copies(image, picks, behind)
    texels, encoding = decoded(image, linear_light=linear_light, alpha="none")
    plain = kept(run(drawing, texels), encoding.gaps)
    return encoded(plain.image, plain.coverage, encoding, missing=plain.missing, behind=behind)


def color_behind(
    value: float | tuple[float, ...], image: NDArray[Any], name: str = "borderValue"
) -> NDArray[Any]:
    """Return a background color (1, 1, C) in the picture's type."""
    values = np.atleast_1d(np.asarray(value, np.float64))
    channels = image.shape[2] if image.ndim == 3 else 1
    if values.ndim > 1 or (values.size != 1 and values.size < channels):
        raise ValueError(f"{name} {value}: give one number, or {channels}")
    if image.dtype.kind in "iu":
        limits = np.iinfo(image.dtype)
        exact = [min(max(round(float(v)), limits.min), limits.max) for v in _finite(values)]
        level = np.array(exact, image.dtype)
    else:
        with np.errstate(over="ignore"):
            level = values.astype(image.dtype)
    level = np.broadcast_to(level, channels) if level.size == 1 else level[:channels]
    return level.reshape(1, 1, channels)


def into(given: NDArray[Any] | None, result: NDArray[Any]) -> NDArray[Any]:
    """Return the result, stored in the given array if that fits."""
    if given is None or given.shape != result.shape or given.dtype != result.dtype:
        return result
    given[...] = result
    return given


def _copies(image: NDArray[Any], picks: Picks, behind: NDArray[Any]) -> NDArray[Any]:
    """Copy texels, value for value, over a background."""
    planes = image.reshape(*image.shape[:2], -1)
    form = (*picks.coverage.shape, *image.shape[2:])
    is_there = (picks.coverage >= LEAST)[..., None]
    row, column = np.broadcast_arrays(picks.row, picks.column)
    values = np.ma.getdata(planes)[row, column]
    shown = np.where(is_there, values, behind).astype(image.dtype, copy=False).reshape(form)
    if not isinstance(image, np.ma.MaskedArray):
        return shown
    hidden = (np.ma.getmaskarray(planes)[row, column] & is_there).reshape(form)
    return masked(shown, hidden, image.fill_value)


def _finite(values: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.nan_to_num(values, posinf=2.0**70, neginf=-(2.0**70))
