"""Footprints of pixels in a grid, and the boxes that approximate them.

A pixel covers about a parallelogram of the grid. A box with the same second moments has the same
mean of smooth samples, up to fourth order; a pixel in which the grid varies too much for that
is split into parts. A parallelogram along the grid's axes is such a box itself.

Where a pixel lies is up to the application, which plays the role `footprint_at`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, kernel, role
from resample.engine.windows.boxes import (
    FEW,
    FEWER,
    LONGEST,
    ONES,
    PHASES,
    TRANSPARENT,
    Integral,
    Plate,
    PointTaps,
    Whole,
    WindowSide,
    folded,
    low_end,
)
from resample.engine.windows.limits import Limits
from resample.types import Doubles, Floats, Single

MOST_CORNERS = 8  # of a quadrilateral clipped to a rectangle


@inner_kernel
def halve(
    polygon: Doubles, spare: Doubles, count: int, axis: int, bound: float, sign: float
) -> int:
    """Clip a convex polygon at a bound on one axis; return the number of its corners."""
    kept = 0
    # Sutherland-Hodgman: keep corners inside, and add where edges cross the bound.
    for k in range(count):
        m = (k + 1) % count
        here, there = sign * (polygon[k, axis] - bound), sign * (polygon[m, axis] - bound)
        if here >= 0.0:
            spare[kept, 0], spare[kept, 1] = polygon[k, 0], polygon[k, 1]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            share = here / (here - there)
            for c in range(2):
                spare[kept, c] = polygon[k, c] + share * (polygon[m, c] - polygon[k, c])
            kept += 1
    # Copy the result back.
    for k in range(kept):
        polygon[k, 0], polygon[k, 1] = spare[k, 0], spare[k, 1]
    return kept


@inner_kernel
def cut_to(
    polygon: Doubles, spare: Doubles, count: int, rectangle: tuple[float, float, float, float]
) -> int:
    """Clip a convex polygon to left, top, right, bottom; return the number of its corners."""
    count = halve(polygon, spare, count, 0, rectangle[0], 1.0)
    count = halve(polygon, spare, count, 1, rectangle[1], 1.0)
    count = halve(polygon, spare, count, 0, rectangle[2], -1.0)
    return halve(polygon, spare, count, 1, rectangle[3], -1.0)


@inner_kernel
def area(polygon: Doubles, count: int) -> float:
    """Area of a polygon of `count` corners, of either orientation."""
    # Shoelace formula.
    total = 0.0
    for k in range(count):
        m = (k + 1) % count
        total += polygon[k, 0] * polygon[m, 1] - polygon[m, 0] * polygon[k, 1]
    return float(0.5 * np.abs(total))


@kernel
def crossing(rim: Doubles, count: int, height: float) -> tuple[float, float]:
    """Left and right end of a level line in a convex polygon; not in order if none.

    Each edge is computed from its upper end, so that polygons which share it agree on it.
    """
    low, high = np.inf, -np.inf
    for k in range(count):
        m = (k + 1) % count
        # Intersect each edge that crosses the line.
        if (rim[k, 1] <= height) != (rim[m, 1] <= height):
            upper, lower = (k, m) if rim[k, 1] < rim[m, 1] else (m, k)
            share = (height - rim[upper, 1]) / (rim[lower, 1] - rim[upper, 1])
            x = rim[upper, 0] + share * (rim[lower, 0] - rim[upper, 0])
            low, high = min(low, x), max(high, x)
    return low, high


@kernel
def box(polygon: Doubles, count: int) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a polygon (count, 2)."""
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for k in range(count):
        left, right = min(left, polygon[k, 0]), max(right, polygon[k, 0])
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    return left, top, right, bottom


@kernel
def reach(polygon: Doubles, count: int) -> float:
    """Width and height of a polygon together."""
    left, top, right, bottom = box(polygon, count)
    return right - left + bottom - top


PixelGeometry = Any  # a bundle of the application; its class selects where pixels lie

LEAN = 0.1  # samples², 12 times a part's mixed moment, from which on two boxes stand for it
LEANEST = 0.5  # samples², mixed moment of one side of a part, at most
MOST_PARTS = 64.0  # of a pixel along an axis
LIMITED = 2.0  # samples along u and v up to which the limits at one position hold for a pixel
NEARLY = 1e-6  # samples, or share of a pixel, that count as nothing
OWN = 1.001  # samples², a sample's own extent along an axis, and rounding of maps in float32


class PixelFootprint(NamedTuple):
    """The footprint of a pixel: a parallelogram in source coordinates."""

    u: float  # its center; NaN: nothing
    v: float
    along_x: tuple[float, float]  # step (u, v) of a pixel to the right
    along_y: tuple[float, float]  # and down


class GridView(NamedTuple):
    """A grid, and how pixels gather from it."""

    plate: Plate
    integral: Integral
    points: PointTaps  # its weights at points; none: pixels are averaged over their footprints
    size: tuple[int, int]  # (height, width) of the source; the grid is a part of it, with margins
    edge: int
    margin: float  # samples around the source into which positions are folded; inf: they are not
    finest: float  # samples², tolerance of splitting pixels; see `parts_of`
    limits: Limits


@role
def footprint_at(geometry: PixelGeometry, row: int, column: int) -> PixelFootprint:
    """The footprint of a pixel."""
    raise NotImplementedError


@inner_step
def is_box(footprint: PixelFootprint, finest: float) -> bool:
    """Whether one or two boxes approximate a pixel well enough; see `parts_of`."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    leans = max(abs(ux * vx), abs(uy * vy)) <= LEANEST * finest
    return bool(leans and max(abs(ux * uy), abs(vx * vy)) <= finest)


@inner_kernel
def parts_of(footprint: PixelFootprint, finest: float) -> tuple[int, int]:
    """Parts of a pixel along x and y that boxes approximate up to a fourth moment.

    Along u, that moment of a parallelogram differs from a box's by (a b)² / 60, with a and b the
    extents of its sides, which falls with the square of the number of parts. Slanted parts become
    two boxes, which stand for about a sample along a diagonal at most.
    """
    # Split sides that slant too much.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    parts, leanest = max(abs(ux * uy), abs(vx * vy)) / finest, LEANEST * finest
    count_x = max(1.0, math.ceil(math.sqrt(abs(ux * vx) / leanest)))
    count_y = max(1.0, math.ceil(math.sqrt(abs(uy * vy) / leanest)))
    # If that is not enough, split further, the longer side first.
    if parts > count_x * count_y:
        longer = math.hypot(uy, vy) / max(math.hypot(ux, vx), 1e-30)
        count_x = max(count_x, math.ceil(min(math.sqrt(parts / longer), MOST_PARTS)))
        count_y = max(count_y, math.ceil(min(parts / count_x, MOST_PARTS)))
    return int(min(count_x, MOST_PARTS)), int(min(count_y, MOST_PARTS))


@inner_kernel
def nth_part(footprint: PixelFootprint, counts: tuple[int, int], n: int) -> PixelFootprint:
    """The nth part of a pixel."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    x = (n % counts[0] + 0.5) / counts[0] - 0.5
    y = (n // counts[0] + 0.5) / counts[1] - 0.5
    return PixelFootprint(
        footprint.u + x * ux + y * uy,
        footprint.v + x * vx + y * vy,
        (ux / counts[0], vx / counts[0]),
        (uy / counts[1], vy / counts[1]),
    )


@inner_kernel
def shrunk(footprint: PixelFootprint, own: float) -> PixelFootprint:
    """Excess of a footprint over a sample: their second moments' difference.

    A sample is already a mean over its own extent, which interpolation may widen, so only what a
    pixel covers beyond that is to be averaged: nothing where samples keep their size or grow.
    """
    # Second moments, times 12, and their eigenvalues.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    uu, vv, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    # Both are below a sample's own if its moments less these are those of an ellipse.
    if uu <= own and vv <= own and uv * uv <= (own - uu) * (own - vv):
        return PixelFootprint(footprint.u, footprint.v, (0.0, 0.0), (0.0, 0.0))
    middle, half = 0.5 * (uu + vv), 0.5 * (uu - vv)
    apart = math.sqrt(half * half + uv * uv)
    # Subtract the sample's own along both eigenvectors.
    longer = math.sqrt(max(middle + apart - own, 0.0))
    shorter = math.sqrt(max(middle - apart - own, 0.0))
    # Halve the angle 2 a of their axes: cos 2a = (uu − vv) / 2 apart.
    double = 0.5 * (uu - vv) / apart if apart > NEARLY else 1.0
    x = math.sqrt(max(0.5 + 0.5 * double, 0.0))
    y = math.copysign(math.sqrt(max(0.5 - 0.5 * double, 0.0)), uv)
    along_x, along_y = (longer * x, longer * y), (-shorter * y, shorter * x)
    return PixelFootprint(footprint.u, footprint.v, along_x, along_y)


@inner_step
def averaged(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """Area that a pixel averages: its footprint, or its excess over a sample."""
    return footprint if view.points.taps == 0 else shrunk(footprint, view.points.own)


@inner_step
def fold(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """Fold a pixel to the equivalent footprint within the grid."""
    if view.margin == math.inf:
        return footprint
    u, turn_u = folded(footprint.u, float(view.size[1]), view.edge, view.margin)
    v, turn_v = folded(footprint.v, float(view.size[0]), view.edge, view.margin)
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return PixelFootprint(u, v, (turn_u * ux, turn_v * vx), (turn_u * uy, turn_v * vy))


@inner_step
def is_small(footprint: PixelFootprint) -> bool:
    """Whether the samples around a pixel's center suffice for its limits."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return bool(max(abs(ux) + abs(uy), abs(vx) + abs(vy)) <= LIMITED)


Integers32 = NDArray[np.int32]

WIDE = 32  # px of a row, at most
ROWS = 4  # at a time
MOST = ROWS * WIDE  # px
MOMENT, REACH, APART = MOST, 2 * MOST, 3 * MOST  # of one axis in `RowScratch.shape`
DOWN = 4 * MOST  # from one axis to the other, in all arrays
OTHER = 8 * MOST  # from one box to the other, where two stand for a pixel
SMALLER = np.int32(4)
MIXED, FITS = 8 * MOST, 16 * MOST  # in `RowScratch.shape`, and in `RowScratch.whole`


class RowScratch(NamedTuple):
    """Scratch for `ROWS` rows of pixels, each `WIDE`."""

    # (9 × MOST,) of both axes: source coordinates, squares of sides, half extents, and distances of
    # boxes; and the mixed moment.
    shape: Doubles
    # (17 × MOST,) of both boxes and axes: first sample, both ends in the table; and how many boxes,
    # and `SMALLER` where windows have `FEWER`.
    whole: Integers32
    share: Floats  # (16 × MOST,) of both boxes and axes: fractions of both ends, 1 / side


@kernel
def row_scratch() -> RowScratch:
    """Allocate scratch for a few rows of pixels."""
    # All pixels are computed, also in shorter rows: none is uninitialized.
    whole, share = np.zeros(17 * MOST, np.int32), np.zeros(16 * MOST, np.float32)
    return RowScratch(np.zeros(9 * MOST), whole, share)


@inner_kernel
def measure_rows(
    geometry: PixelGeometry, view: GridView, rows: tuple[int, int], first: int, count: int,
    is_apart: bool, pixels: RowScratch,
) -> None:  # fmt: skip
    """Measure the pixels of rows from a column on, and find the boxes that approximate them.

    `rows`: first row, and last + 1; at most `ROWS`. `is_apart`: the tile has no limits in common;
    then there are none.
    """
    if is_apart or view.points.taps > 0 or view.plate.channels not in (1, 4):
        for n in range(MOST):
            pixels.whole[np.uint64(FITS + n)] = 0
        return
    leans = False
    for row in range(rows[0], rows[1]):
        start = (row - rows[0]) * WIDE
        leans |= _put_footprints(geometry, (row, first), start, count, view.finest, pixels)
    if leans:
        _part_in_two(pixels)
    most = 0.5 * LIMITED if view.limits.excess >= 0.0 else math.inf
    plate, integral, is_open = view.plate, view.integral, view.edge != TRANSPARENT
    across = plate.left, plate.columns, float(view.size[1])
    down = plate.top, plate.rows, float(view.size[0])
    # In loops of a known length, stretches of one array are known to be apart.
    _put_sides(integral, (0, 0), across, most, is_open, pixels)
    _put_sides(integral, (0, DOWN), down, most, is_open, pixels)
    if leans:
        _put_sides(integral, (1, 0), across, most, is_open, pixels)
        _put_sides(integral, (1, DOWN), down, most, is_open, pixels)


@inner_step
def _put_footprints(
    geometry: PixelGeometry, pixel: tuple[int, int], start: int, count: int, finest: float,
    pixels: RowScratch,
) -> bool:  # fmt: skip
    """Put places and sides of pixels from one (row, column) on; return whether any needs two boxes.

    `start`: where in `pixels` they begin.
    """
    found: Whole = np.int32(0)
    shape, whole, lean, leanest = pixels.shape, pixels.whole, LEAN * finest, LEANEST * finest
    for n in range(count):
        k, footprint = np.uint64(start + n), footprint_at(geometry, pixel[0], pixel[1] + n)
        m = k + np.uint64(DOWN)
        (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
        shape[k], shape[m] = footprint.u, footprint.v
        shape[k + np.uint64(MOMENT)] = ux * ux + uy * uy
        shape[m + np.uint64(MOMENT)] = vx * vx + vy * vy
        shape[k + np.uint64(REACH)] = 0.5 * (abs(ux) + abs(uy))
        shape[m + np.uint64(REACH)] = 0.5 * (abs(vx) + abs(vy))
        shape[k + np.uint64(APART)] = shape[m + np.uint64(APART)] = 0.0
        shape[k + np.uint64(MIXED)] = mixed = ux * vx + uy * vy
        # As `is_box` has it.
        is_box = max(abs(ux * vx), abs(uy * vy)) <= leanest
        is_box &= max(abs(ux * uy), abs(vx * vy)) <= finest
        boxes = np.int32(is_box) + np.int32(is_box & (abs(mixed) > lean))
        whole[k + np.uint64(FITS)] = boxes | SMALLER
        found |= boxes
    return bool(found > 1)


@inner_step
def _part_in_two(pixels: RowScratch) -> None:
    """Represent the mixed moment by two boxes' distance; the rest stays in their sides."""
    shape, whole = pixels.shape, pixels.whole
    for n in range(MOST):
        k = np.uint64(n)
        m, is_two = k + np.uint64(DOWN), (whole[k + np.uint64(FITS)] & np.int32(2)) > np.int32(0)
        uu, vv = shape[k + np.uint64(MOMENT)], shape[m + np.uint64(MOMENT)]
        mixed = shape[k + np.uint64(MIXED)]
        ratio, slant = math.sqrt(uu / vv), abs(mixed)
        apart = math.copysign(math.sqrt(slant / ratio / 12.0), mixed)
        shape[k + np.uint64(APART)] = math.sqrt(slant * ratio / 12.0) if is_two else 0.0
        shape[m + np.uint64(APART)] = apart if is_two else 0.0
        shape[k + np.uint64(MOMENT)] = max(uu - slant * ratio, 0.0) if is_two else uu
        shape[m + np.uint64(MOMENT)] = max(vv - slant / ratio, 0.0) if is_two else vv


@inner_step
def _put_sides(
    integral: Integral, which: tuple[int, int], extent: tuple[float, int, float],
    most: float, is_open: bool, pixels: RowScratch,
) -> None:  # fmt: skip
    """Put windows along an axis; pixels with large windows, or crossed by an edge, get no boxes.

    `which`: box, 0 or 1, and axis, 0 or `DOWN`. `extent`: first sample of the plate, its samples,
    and the source. `most`: half the extent of a pixel, at most. `is_open`: whether the
    source is continued beyond its edges.
    """
    shape, whole, share = pixels
    first, size, end = extent
    stride, few = np.int32(integral.stride), np.int32(FEW - integral.taps)
    before: Whole = np.int32(integral.before)
    shortest, longest = np.float32(integral.shortest), np.float32(LONGEST)
    one, two = np.uint64(MOST), np.uint64(2 * MOST)
    box, axis = which
    sign = 1.0 - 2.0 * box
    for n in range(MOST):  # also those beyond a row's end
        m, k = np.uint64(n + axis), np.uint64(n + axis + box * OTHER)
        place, reach = shape[m], shape[m + np.uint64(REACH)]
        length: Single = np.sqrt(np.float32(shape[m + np.uint64(MOMENT)]))
        middle = place + sign * shape[m + np.uint64(APART)]
        side = min(max(shortest, length), longest)
        # Split both ends into samples, table rows and fractions between rows, as `weights` does.
        low = low_end(integral, middle - first, float(side), size)
        start: Whole = np.int32(low)
        f = np.float32(low - start)
        g = f + side
        apart: Whole = np.int32(g)
        f, g = f * np.float32(PHASES), (g - np.float32(apart)) * np.float32(PHASES)
        row_low: Whole = np.int32(f)
        row_high: Whole = np.int32(g)
        whole[k] = start - before
        whole[k + one] = row_low * stride + np.int32(ONES)
        whole[k + two] = row_high * stride + np.int32(ONES) - apart
        share[k], share[k + one] = f - np.float32(row_low), g - np.float32(row_high)
        share[k + two] = np.float32(1) / side
        # NaN is outside of everything.
        inner = reach - NEARLY
        is_within = (place >= inner) & (place + inner <= end)
        is_within |= is_open & (abs(place) <= math.inf)
        is_few = is_within & (apart <= few) & (reach <= most)
        o = np.uint64(n + FITS)
        smaller = np.int32(apart <= few - np.int32(FEW - FEWER))
        whole[o] = whole[o] * np.int32(is_few) & (SMALLER - np.int32(1) + SMALLER * smaller)


@inner_step
def boxes_of(pixels: RowScratch, n: int) -> int:
    """Number of the nth pixel's boxes, which read at most `FEW` samples along both axes.

    0: it needs more.
    """
    return int(pixels.whole[np.uint64(FITS + n)] & (SMALLER - np.int32(1)))


@inner_step
def has_fewer(pixels: RowScratch, n: int) -> bool:
    """Whether the nth pixel's boxes read at most `FEWER` samples along both axes."""
    return bool(pixels.whole[np.uint64(FITS + n)] >= SMALLER)


@inner_step
def place_of(pixels: RowScratch, n: int) -> tuple[float, float]:
    """Source coordinates of the nth pixel."""
    return pixels.shape[np.uint64(n)], pixels.shape[np.uint64(DOWN + n)]


@inner_step
def side_of(pixels: RowScratch, n: int, axis: int) -> WindowSide:
    """Window of the nth pixel along an axis, 0 or `DOWN`, plus `OTHER` of its second box."""
    k, one, two = np.uint64(n + axis), np.uint64(MOST), np.uint64(2 * MOST)
    whole, share = pixels.whole, pixels.share
    low, high = np.uint64(whole[k + one]), np.uint64(whole[k + two])
    return WindowSide(whole[k], low, high, share[k], share[k + one], share[k + two])
