"""Where a warp shrinks a picture: tiles with a pixel that is longer than its kernel's limit.

Lengths are squared, texels². Up to the limit a pixel is what another library's kernel reads at its
center; beyond it, it is a mean.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

TILE = 32  # px per side
STEP = 8  # px between places at which a map is looked at
# Of kernels that reproduce parabolas, and of linear ones, which blur as much as a box of √3 texels.
# To leave out the mean over what is longer by 5 % changes less than OpenCV's rounding of positions.
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
