"""The sub-pixels of a tile as pairs of rows, of which sixteen are processed at a time.

A pair of rows holds nine planes, one per number of a sub-pixel; within a plane the two rows
alternate, column by column. As planes lie at fixed distances, the compiler sees that they do not
overlap, and vectorizes over eight columns of both rows. Indices are unsigned, as signed ones would
need a test for negative values.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.compositing import VISIBLE
from resample.engine.ellipsoids.outlines import BLUE as LIT_BLUE
from resample.engine.ellipsoids.outlines import (
    BOTTOM,
    EXTINCTION,
    HOME,
    LEFT,
    RIGHT,
    SIZE,
    TOP,
    A,
    B,
    C,
)
from resample.engine.ellipsoids.outlines import DEPTH as FAR
from resample.engine.ellipsoids.outlines import GREEN as LIT_GREEN
from resample.engine.ellipsoids.outlines import RED as LIT_RED
from resample.engine.ellipsoids.splats import clipped_span, cut_integral
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed
from resample.engine.subpixels import Home
from resample.types import (
    MOST_COLUMNS,
    Ellipsoid,
    Film,
    Floats,
    Place,
    Single,
    Stage,
    View,
)

COLUMNS = 8  # painted at once
LANES = 2 * COLUMNS
_STRIDE = 2 * (MOST_COLUMNS + COLUMNS)  # painting may overrun the last column
# Planes of a pair of rows.
RED, GREEN, BLUE, ALPHA, DEPTH, WEIGHT, FIRST, RAY, CHORD = (
    np.uint64(number * _STRIDE) for number in range(9)
)
PAIR = 9 * _STRIDE  # numbers in a pair of rows

# expm1(x) / x - 1 over -1..0 by powers of x: least squares, within 1e-7.
_X = -np.linspace(1e-3, 1.0, 2000)
_SERIES = np.linalg.lstsq(_X[:, None] ** np.arange(1, 6), np.expm1(_X) / _X - 1.0, rcond=None)[0]
E1, E2, E3, E4, E5 = (np.float32(power) for power in _SERIES)
DEEPEST = np.float32(-16.0)  # negated optical depth that counts as opaque
PER_DEEPEST = np.float32(1.0 / 16.0)

Groups = NDArray[np.uint32]  # ((h + 1) // 2,) per pair of rows, a bit for every eight columns
Members = NDArray[np.int32]


class SplatLimits(NamedTuple):
    """Constants that all splats of a tile share."""

    opaque: Single  # transmittance below which nothing is painted
    per_layer: Single  # coverage of a line integral of 1
    widest: Single  # value of the quadratic form at the rim, at most
    linear_layer: Single  # scene units, thickness that linear opacities refer to; 0: exact


@kernel
def index_of(row: int, column: int) -> np.uint64:
    """Index of a sub-pixel in the first plane."""
    return np.uint64((row >> 1) * PAIR + 2 * column + (row & 1))


@kernel
def bounds_at(room: Floats, s: np.uint64) -> tuple[int, int, int, int]:
    """Bounds of a sample of a batch: rows and columns, each first and one past the last."""
    return (
        int(room[s + TOP]),
        int(room[s + BOTTOM]),
        int(room[s + LEFT]),
        int(room[s + RIGHT]),
    )


@kernel
def new_rows(height: int, width: int) -> Floats:
    """Allocate empty sub-pixels; those beyond the end are opaque."""
    zero, one, far = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
    pairs = (height + 1) // 2
    rows = np.empty(pairs * PAIR, np.float32)
    # Opaque sub-pixels beyond the end let loops overrun without a test.
    for row in range(2 * pairs):
        for column in range(width + COLUMNS):
            k = index_of(row, column)
            rows[k + RED] = zero
            rows[k + GREEN] = zero
            rows[k + BLUE] = zero
            rows[k + ALPHA] = zero if (row < height) & (column < width) else one
            rows[k + DEPTH] = zero
            rows[k + WEIGHT] = zero
            rows[k + FIRST] = far
            rows[k + RAY] = zero
            rows[k + CHORD] = zero
    return rows


@kernel
def cast_rays_of_rows(
    rows: Floats, height: int, width: int, place: Place, view: View, ellipsoid: Ellipsoid
) -> Single:
    """Set up the ray of each sub-pixel for exact footprints; return the least 1 / |w|²."""
    n, unit, least = place.subpixels, ellipsoid.to_unit, np.float32(np.inf)
    for row in range(height):
        # Direction of the ray per unit of depth, or its position where rays are parallel.
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(width):
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            if not view.perspective:
                x, y = 0.0, 0.0
            # Squared length of the direction in the space of the unit sphere.
            squared = 0.0
            for axis in range(3):
                across = unit[axis, 0] * x + unit[axis, 1] * y + unit[axis, 2]
                squared += across * across
            # Store 1 / |w|², and the factor of line integrals along this ray.
            k = index_of(row, column)
            rows[k + RAY] = 1.0 / squared
            rows[k + CHORD] = ellipsoid.scale * math.sqrt((1.0 + x * x + y * y) / squared)
            least = min(least, rows[k + RAY])
    return least


@kernel
def groups_between(left: int, right: int) -> np.uint32:
    """Bits of the groups of eight columns that overlap columns left..right."""
    first, last = np.uint64(left // COLUMNS), np.uint64((right - 1) // COLUMNS)
    return np.uint32((np.uint64(2) << last) - (np.uint64(1) << first))


@kernel
def narrowed(
    a: float, b: float, rest: float, bounds: tuple[int, int], across: float, step: float
) -> tuple[int, int]:
    """First column of a row that a splat may touch, and one past the last.

    There its form a dx² + 2 b dx + rest is below 0; `bounds` are those of all its rows, and
    `across` is the offset of column 0 in px. Float64, as products may be tiny.
    """
    # Without real roots the row misses the ellipse.
    steep, slope = np.float64(a), np.float64(b)
    inside = slope * slope - steep * np.float64(rest)
    if not inside > 0.0:
        return bounds[1], bounds[0]
    # Columns of the two roots.
    half, per_column, shift = math.sqrt(inside), 1.0 / (steep * step), across / step
    first = np.floor((-slope - half) * per_column - shift)
    last = np.ceil((-slope + half) * per_column - shift) + 1.0
    # Order matters: min and max with NaN return their first argument.
    low, high = float(bounds[0]), float(bounds[1])
    return int(min(high, max(low, first))), int(max(low, min(high, last)))


@kernel
def paint_cut_splat_on_rows(
    rows: Floats,
    open_groups: Groups,
    room: Floats,
    offset: int,
    place: Place,
    stage: Stage,
    limits: SplatLimits,
) -> int:
    """Composite the visible part of a sphere that a plane cuts; its form holds its center, size 1.

    Return 1 if it is at home in the tile and not hidden.
    """
    n, one, s = place.subpixels, np.float32(1.0), np.uint64(offset)
    view, ellipsoid, planes = stage.camera, stage.ellipsoid, stage.screen.planes
    partial, thick = stage.tables.partial, limits.linear_layer
    # Cull by the open groups of sub-pixels.
    top, bottom, left, right = bounds_at(room, s)
    if left >= right or not is_open(open_groups, top, bottom, left, right):
        return 0
    # Scaled about the eye by 1 / size, the sphere has size 1 and looks the same.
    center, depth = (room[s + A], room[s + B], room[s + C]), room[s + FAR]
    extinction, per_size = room[s + EXTINCTION], 1.0 / float(room[s + SIZE])
    apart = 1.0 if view.perspective else per_size
    # Loop over the sub-pixels that are not opaque yet.
    for row in range(top, bottom):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(left, right):
            k = index_of(row, column)
            before = one - rows[k + ALPHA]
            if before <= limits.opaque:
                continue
            # Clip the ray to the planes, and integrate the sphere between them.
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            first, last = clipped_span(x, y, view, planes)
            seen = (per_size * first, per_size * last)
            integral = np.float32(
                cut_integral(center, apart * x, apart * y, seen, view, ellipsoid, partial)
            )
            if integral <= np.float32(0.0):
                continue
            # Convert the line integral to opacity, exact or by the classic model.
            alpha = absorbed(extinction * (thick if thick > 0.0 else integral))
            alpha = min(one, alpha * integral / thick) if thick > 0.0 else alpha
            # Composite under what the sub-pixel holds.
            share = before * alpha
            rows[k + RED] += share * room[s + LIT_RED]
            rows[k + GREEN] += share * room[s + LIT_GREEN]
            rows[k + BLUE] += share * room[s + LIT_BLUE]
            rows[k + ALPHA] += share
            rows[k + DEPTH] += share * depth
            rows[k + WEIGHT] += integral * limits.per_layer
            # Note the depth where it first becomes visible.
            if rows[k + FIRST] == np.inf and rows[k + ALPHA] > np.float32(VISIBLE):
                rows[k + FIRST] = depth
    return int(room[s + HOME])


@kernel
def open_rows(height: int, width: int) -> Groups:
    """Mark all groups of columns as open."""
    return np.full((height + 1) // 2, groups_between(0, width), np.uint32)


@kernel
def close_rows(open_groups: Groups, rows: Floats, width: int, opaque: Single) -> bool:
    """Clear the bits of groups that have become opaque; return whether any is still open."""
    one, left_open = np.float32(1.0), np.uint32(0)
    # Visit the groups that are still open.
    for pair in range(open_groups.size):
        bits = open_groups[pair]
        if bits == np.uint32(0):
            continue
        for group in range((width + COLUMNS - 1) // COLUMNS):
            bit = np.uint32(1) << np.uint32(group)
            if bits & bit:
                # Close a group once all its sixteen sub-pixels are opaque.
                first, is_found = np.uint64(pair * PAIR + group * LANES) + ALPHA, False
                for lane in range(LANES):
                    is_found |= one - rows[first + np.uint64(lane)] > opaque
                if not is_found:
                    bits ^= bit
        open_groups[pair] = bits
        left_open |= bits
    return bool(left_open != np.uint32(0))


@kernel
def is_open(open_groups: Groups, top: int, bottom: int, left: int, right: int) -> bool:
    """Whether a rectangle of sub-pixels overlaps an open group; conservative."""
    # Merge the bits of all pairs of rows, then test the columns.
    found = np.uint32(0)
    for pair in range(top >> 1, (bottom + 1) >> 1):
        found |= open_groups[pair]
    return bool(found & groups_between(left, right) != np.uint32(0))


@kernel
def resolve_rows(rows: Floats, n: int, weight: Floats, home: Home, film: Film) -> None:
    """Filter the sub-pixels of a tile to its pixels of a film (H, W)."""
    height, width = film.depth.shape
    one, zero = np.float32(1.0), np.float32(0.0)
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    # Convolve the sub-pixels around each pixel with the filter.
    for row in range(home.top, min(home.top + home.size, height)):
        for column in range(home.left, min(home.left + home.size, width)):
            red = green = blue = alpha = far = cover = zero
            first = np.float32(np.inf)
            for down in range(weight.size):
                for right in range(weight.size):
                    k = index_of((row - home.top) * n + down, (column - home.left) * n + right)
                    share = weight[down] * weight[right]
                    red += share * rows[k + RED]
                    green += share * rows[k + GREEN]
                    blue += share * rows[k + BLUE]
                    alpha += share * rows[k + ALPHA]
                    far += share * rows[k + DEPTH]
                    # Coverage is what line integrals say, or the opacity where that is more.
                    cover += share * max(rows[k + ALPHA], min(one, rows[k + WEIGHT]))
                    # The nearest depth is the least within the pixel proper.
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, rows[k + FIRST])
            # Clamp what negative lobes of the filter leave, and store the pixel.
            film.rgba[row, column, 0] = max(zero, red)
            film.rgba[row, column, 1] = max(zero, green)
            film.rgba[row, column, 2] = max(zero, blue)
            film.rgba[row, column, 3] = min(one, max(zero, alpha))
            if alpha > zero:
                film.depth[row, column] = far / alpha
            film.first_depth[row, column] = first
            film.coverage[row, column] = min(one, max(zero, cover))
