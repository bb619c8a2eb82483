"""Rows of pixels: what the means of those that read few samples need, in lanes.

Where pixels lie, how long they are and which weights they take does not depend on the samples, so
it is worked out for a few rows of a tile at once.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, kernel
from resample.engine.windows.boxes import (
    FEW,
    FEWER,
    LONGEST,
    ONES,
    PHASES,
    TRANSPARENT,
    Integral,
    Whole,
    WindowSide,
    low_end,
)
from resample.engine.windows.footprints import (
    LEAN,
    LEANEST,
    LIMITED,
    NEARLY,
    GridView,
    PixelGeometry,
    footprint_at,
)
from resample.types import Doubles, Floats, Single

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
    # All pixels are worked out, also those of rows that are shorter: none is uninitialized.
    whole, share = np.zeros(17 * MOST, np.int32), np.zeros(16 * MOST, np.float32)
    return RowScratch(np.zeros(9 * MOST), whole, share)


@inner_kernel
def measure_rows(
    geometry: PixelGeometry, view: GridView, rows: tuple[int, int], first: int, count: int,
    is_apart: bool, pixels: RowScratch,
) -> None:  # fmt: skip
    """Measure the pixels of rows from a column on, and find the boxes that stand for them.

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
    """Let two boxes carry the mixed moment by their distance; the rest stays in their sides."""
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
    """Put windows along an axis; where they are large, or an edge crosses a pixel, has it no boxes.

    `which`: box, 0 or 1, and axis, 0 or `DOWN`. `extent`: first sample of the plate, its samples,
    and those of the source. `most`: half the extent of a pixel, at most. `is_open`: whether the
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
        # What is not a number is within nothing.
        inner = reach - NEARLY
        is_within = (place >= inner) & (place + inner <= end)
        is_within |= is_open & (abs(place) <= math.inf)
        is_few = is_within & (apart <= few) & (reach <= most)
        o = np.uint64(n + FITS)
        smaller = np.int32(apart <= few - np.int32(FEW - FEWER))
        whole[o] = whole[o] * np.int32(is_few) & (SMALLER - np.int32(1) + SMALLER * smaller)


@inner_step
def boxes_of(pixels: RowScratch, n: int) -> int:
    """How many boxes that read at most `FEW` samples along both axes stand for the nth pixel.

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
