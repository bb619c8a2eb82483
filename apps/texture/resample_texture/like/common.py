"""Shared by the drop-ins: draw over a background, fill given output arrays."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample import registry
from resample.profiles.interpolation import Nearest
from resample_texture.arguments import check_shape, method_named
from resample_texture.drawing import Drawing, drawn
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
        return Hybrid(interpolation=kernel, average="always" if _averages(kernel) else "shrinking")
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


def _averages(kernel: Any) -> bool:
    """Whether an interpolation is one of means, or of blocks."""
    return bool(getattr(kernel, "is_mean", False)) or isinstance(kernel, Nearest)


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
    drawing = drawing._replace(behind=behind)
    return drawn(image, drawing, linear_light=linear_light, alpha="none").image


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


def _finite(values: NDArray[Any]) -> NDArray[Any]:
    return np.asarray(np.nan_to_num(values, posinf=2.0**70, neginf=-(2.0**70)))
