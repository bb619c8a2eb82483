"""Shared by the drop-ins: draw over a background, or some tiles alone; find missing values.

A warp shrinks a picture in tiles with a pixel that is longer than its kernel's limit; lengths are
squared, texels². Up to the limit a pixel is what another library's kernel reads at its center;
beyond it, it is a mean.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample import registry
from resample.profiles.interpolation import Nearest
from resample_texture.arguments import check_shape, method_named, within
from resample_texture.drawing import MOST_AT_ONCE, Drawing, drawn
from resample_texture.methods.forward import Hybrid
from resample_texture.types import Method

NEAREST = "nearest"  # the interpolation that copies texels, done by the method of that name
SPLINES = {order: f"spline:degree={order}" for order in (2, 3, 4, 5)}
ORDERS = {0: NEAREST, 1: "bilinear", **SPLINES}
TILE = 32  # px per side
STEP = 8  # px between places at which a map is looked at
# Of kernels that reproduce parabolas, and of linear ones, which blur as much as a box of √3 texels.
# Pixels longer by 5 % change less without a mean than by OpenCV's rounding of positions.
SHARP, LINEAR = 1.1, 3.1

Tiles = NDArray[np.bool_]  # (rows, columns) of tiles, whether they shrink
Places = tuple[NDArray[Any], NDArray[Any]]  # x and y in the source, pixel centers at integers


def by_matrix(back: tuple[float, ...], shape: tuple[int, int], most: float) -> Tiles | None:
    """Return the tiles of a target (height, width) that shrink by a matrix; None: none does.

    `back`: nine numbers, target to source, pixel centers at integers, positive in front. Tiles that
    reach behind the horizon count as shrinking.
    """
    # The source's steps per px, times the square of the third coordinate w, are linear, so that
    # their length over w is largest at a corner; so is 1 / w. The product is a bound.
    height, width = shape
    is_even = back[6] == back[7] == 0.0
    ends = ((0,), (0,)) if is_even else ((0, width - 1), (0, height - 1))
    corner = [_scaled(back, x, y) for x in ends[0] for y in ends[1]]
    least = min(w for _, w in corner)
    if least > 0.0 and max(long / (w * w) for long, w in corner) <= most * least * least:
        return None
    if is_even:
        return np.ones((-(-height // TILE), -(-width // TILE)), np.bool_)
    # The same for each tile.
    left, top = np.arange(0, width, TILE), np.arange(0, height, TILE)[:, None]
    right, bottom = np.minimum(left + TILE, width) - 1, np.minimum(top + TILE, height) - 1
    corner = [_scaled(back, x, y) for x in (left, right) for y in (top, bottom)]
    long, w = (np.stack(one) for one in zip(*corner, strict=True))
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        is_sure = (w > 0.0).all(axis=0)
        is_sure &= (long / w**2).max(axis=0) <= most * w.min(axis=0) ** 2
    # Look at all pixels of tiles that neither this bound nor their corners tell.
    some = np.nonzero(~is_sure & ((w > 0.0) & (long <= most * w**4)).all(axis=0))
    inside = np.arange(TILE)
    x = np.minimum(left[some[1], None, None] + inside, width - 1)
    y = np.minimum(top[some[0], :, None] + inside[:, None], height - 1)
    long, w = _scaled(back, x, y)
    is_sure[some] = (long <= most * w**4).all(axis=(1, 2))
    return None if is_sure.all() else ~is_sure


def by_nodes(places: Callable[[int], Places], shape: tuple[int, int], most: float) -> Tiles | None:
    """Return the tiles of a target (height, width) that shrink by a map; None: none does.

    `places`: source coordinates of every so many pixels along both axes. Tiles with one that is
    not a number count as shrinking; a single row or column of pixels has no neighbours.
    """
    step = next((step for step in (STEP, 4, 2) if min(shape) > step), 1)
    u, v = places(step)
    here, right, below = np.s_[:-1, :-1], np.s_[:-1, 1:], np.s_[1:, :-1]
    long = _longest(u[right] - u[here], v[right] - v[here], u[below] - u[here], v[below] - v[here])
    is_long = ~(long <= most * step**2)
    if not is_long.any():
        return None
    # Pixels after the last place are as those before it.
    is_long = np.pad(is_long, ((0, 1), (0, 1)), mode="edge")
    down, across = (np.arange(0, count, TILE // step) for count in is_long.shape)
    return np.logical_or.reduceat(np.logical_or.reduceat(is_long, down, axis=0), across, axis=1)


def _scaled(back: tuple[float, ...], x: Any, y: Any) -> tuple[Any, Any]:
    """Squared longer axis of a pixel, times w⁴, and w, of numbers or arrays."""
    a, b, c, d, e, f, g, h, i = back
    turn_u, turn_v = a * h - b * g, d * h - e * g
    ux, vx = turn_u * y + (a * i - c * g), turn_v * y + (d * i - f * g)
    uy, vy = (b * i - c * h) - turn_u * x, (e * i - f * h) - turn_v * x
    return _longest(ux, vx, uy, vy), g * x + h * y + i


def _longest(ux: Any, vx: Any, uy: Any, vy: Any) -> Any:
    """Squared longer axis of the ellipse of steps in the source, (u, v) along x and y."""
    across, down, both = ux * ux + vx * vx, uy * uy + vy * vy, ux * uy + vx * vy
    half = 0.5 * (across - down)
    return 0.5 * (across + down) + (half * half + both * both) ** 0.5


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
    return drawn(image, drawing._replace(linear_light=linear_light, alpha="none")).image


def tiles_drawn(
    image: NDArray[Any], drawing: Drawing, tiles: Tiles
) -> tuple[tuple[slice, slice], Tiles, NDArray[Any]]:
    """Draw some tiles, see `draw`.

    Returns
    -------
    The part of the target around them; which of its pixels (h, w) are theirs; and the picture.
    """
    # Find the rectangle around the tiles, and their pixels in it and in the margin drawn with it.
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
