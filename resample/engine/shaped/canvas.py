"""The sub-pixels of a tile, in planes at fixed distances, so that eight are painted at once."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, kernel
from resample.engine.lookup import VISIBLE
from resample.engine.shaped.records import (
    D_X,
    D_XX,
    D_XY,
    D_Y,
    D_YY,
    LIMIT,
    N_1,
    N_X,
    N_XX,
    N_XY,
    N_Y,
    N_YY,
    T_1,
    T_X,
    T_Y,
    X,
    Y,
    span_of,
)
from resample.types import Floats, Single

SIDE = 32  # sub-pixels per side of a tile
LANES = 8  # sub-pixels of a row that are painted at once
GROUPS = SIDE // LANES
PLANE = SIDE * SIDE
# Planes of a canvas; the last holds the share of light that passes.
RED, GREEN, BLUE, DEPTH, MEDIAN, FIRST, SHARE = (np.uint64(n * PLANE) for n in range(7))
SIZE = 7 * PLANE
OPAQUE = np.float32(1e-4)  # share of light that counts as none
HALF = np.float32(0.5)

Open = NDArray[np.uint32]  # (SIDE,) per row, a bit for each group that is not opaque


class TilePlace(NamedTuple):
    """Position and resolution of a tile."""

    left: float  # px
    top: float
    step: Single  # px between sub-pixels
    near: Single  # scene units: only farther ellipsoids are painted


class Line(NamedTuple):
    """A record's three polynomials along a row of sub-pixels, in px from its reference."""

    start: Single  # px, of the row's first sub-pixel
    n0: Single
    n1: Single
    n2: Single
    d0: Single
    d1: Single
    d2: Single
    t0: Single
    t1: Single


class PaintedShapes(NamedTuple):
    """Pictures that tiles are written to."""

    rgba: Floats  # (H, W, 4) premultiplied
    depth: Floats  # (H, W) mean, inf where empty
    median: Floats  # (H, W) where half of the light is stopped; inf where less is
    first_depth: Floats  # (H, W)
    coverage: Floats  # (H, W)


@kernel
def clear(canvas: Floats, is_open: Open) -> None:
    """Empty the sub-pixels."""
    zero, one, far = np.float32(0), np.float32(1), np.float32(np.inf)
    for k in range(PLANE):
        place = np.uint64(k)
        canvas[place + RED] = canvas[place + GREEN] = canvas[place + BLUE] = zero
        canvas[place + DEPTH] = zero
        canvas[place + MEDIAN] = canvas[place + FIRST] = far
        canvas[place + SHARE] = one
    for row in range(SIDE):
        is_open[row] = (1 << GROUPS) - 1


@inner_kernel
def close_groups(canvas: Floats, is_open: Open) -> bool:
    """Close groups with only opaque sub-pixels; return whether one is still open."""
    any_open = False
    for row in range(SIDE):
        bits = np.uint32(0)
        if is_open[row] == np.uint32(0):
            continue
        for group in range(GROUPS):
            most = np.float32(0)
            first = np.uint64(row * SIDE + group * LANES) + SHARE
            for lane in range(LANES):
                most = max(most, canvas[first + np.uint64(lane)])
            if most >= OPAQUE:
                bits |= np.uint32(1) << np.uint32(group)
        is_open[row] = bits
        any_open = any_open or bits != np.uint32(0)
    return any_open


@inner_step
def subpixels_of(record: Floats, axis: int, begin: float, step: Single) -> tuple[int, int]:
    """First of a tile's columns or rows in a record's box, and one past the last."""
    per = 1.0 / float(step)
    low, high = span_of(record, axis)
    first = math.ceil(max((low - begin) * per - 0.5, 0.0))
    last = math.floor(min((high - begin) * per - 0.5, SIDE - 1.0))
    return int(first), int(last) + 1


@inner_step
def line_at(record: Floats, start: Single, dy: Single) -> Line:
    """Evaluate the parts of a record's polynomials in dy, px below its reference."""
    one = np.float32(1)
    return Line(
        start,
        record[N_1] + dy * (record[N_Y] + dy * record[N_YY]),
        record[N_X] + dy * record[N_XY],
        record[N_XX],
        one + dy * (record[D_Y] + dy * record[D_YY]),
        record[D_X] + dy * record[D_XY],
        record[D_XX],
        record[T_1] + dy * record[T_Y],
        record[T_X],
    )


@inner_step
def line_of(record: Floats, spot: TilePlace, row: int) -> Line:
    """Evaluate a record's polynomials along a row of sub-pixels."""
    start = np.float32(spot.left + 0.5 * float(spot.step) - float(record[X]))
    dy = np.float32(spot.top + (row + 0.5) * float(spot.step) - float(record[Y]))
    return line_at(record, start, dy)


@inner_step
def groups_of(
    record: Floats, line: Line, spot: TilePlace, columns: tuple[int, int]
) -> tuple[int, int]:
    """First group of a row that a record's ellipse may meet, and one past the last."""
    first, last = columns
    if last - first <= LANES:
        return first // LANES, (last + LANES - 1) // LANES
    # The roots of n(x) / limit − d(x) along the row bound the ellipse.
    per_limit = 1.0 / float(record[LIMIT])
    a = per_limit * float(line.n2) - float(line.d2)
    b = 0.5 * (per_limit * float(line.n1) - float(line.d1))
    c = per_limit * float(line.n0) - float(line.d0)
    if a > 0.0:
        under = b * b - a * c
        if under <= 0.0:
            return 0, 0
        root, per = math.sqrt(under), 1.0 / float(spot.step)
        low, high = (-b - root) / a - float(line.start), (-b + root) / a - float(line.start)
        first = max(first, math.floor(max(low * per, 0.0)))
        last = min(last, math.ceil(min(high * per, float(SIDE))) + 1)
    return first // LANES, (min(last, SIDE) + LANES - 1) // LANES if last > first else 0


@inner_step
def lay(
    canvas: Floats, k: np.uint64, alpha: Single, t: Single, light: tuple[Single, Single, Single]
) -> None:
    """Composite light of an opacity at a depth behind a sub-pixel's content."""
    zero = np.float32(0)
    share = canvas[k + SHARE]
    w = alpha * (share if share >= OPAQUE else zero)
    after = share - w
    canvas[k + RED] += w * light[0]
    canvas[k + GREEN] += w * light[1]
    canvas[k + BLUE] += w * light[2]
    canvas[k + DEPTH] += w * t
    # Depths where the sub-pixel becomes visible, and where half of its light is stopped.
    first, median = canvas[k + FIRST], canvas[k + MEDIAN]
    canvas[k + FIRST] = t if (first == np.inf) & (after < np.float32(1.0 - VISIBLE)) else first
    canvas[k + MEDIAN] = t if (median == np.inf) & (after <= HALF) else median
    canvas[k + SHARE] = after


@inner_kernel
def write_tile(canvas: Floats, origin: tuple[int, int], fine: int, picture: PaintedShapes) -> None:
    """Average each pixel's sub-pixels; `origin`: row and column of the tile in the picture."""
    height, width = picture.depth.shape
    across = SIDE // fine
    per = np.float32(1.0 / (fine * fine))
    one, zero = np.float32(1), np.float32(0)
    for i in range(min(across, height - origin[0])):
        for j in range(min(across, width - origin[1])):
            red = green = blue = depth = alpha = middle = passed = covered = zero
            first = np.float32(np.inf)
            for v in range(i * fine, i * fine + fine):
                for u in range(j * fine, j * fine + fine):
                    k = np.uint64(v * SIDE + u)
                    red += canvas[k + RED]
                    green += canvas[k + GREEN]
                    blue += canvas[k + BLUE]
                    depth += canvas[k + DEPTH]
                    share = one - canvas[k + SHARE]
                    alpha += share
                    covered += one if share > zero else zero
                    first = min(first, canvas[k + FIRST])
                    # The median of the sub-pixels that stop half of their light.
                    if canvas[k + MEDIAN] < np.inf:
                        middle += canvas[k + MEDIAN]
                        passed += one
            y, x = origin[0] + i, origin[1] + j
            picture.rgba[y, x, 0], picture.rgba[y, x, 1] = per * red, per * green
            picture.rgba[y, x, 2], picture.rgba[y, x, 3] = per * blue, per * alpha
            picture.depth[y, x] = depth / alpha if alpha > zero else np.float32(np.inf)
            half = 2 * passed >= np.float32(fine * fine)
            picture.median[y, x] = middle / passed if half else np.float32(np.inf)
            picture.first_depth[y, x] = first
            picture.coverage[y, x] = per * covered
