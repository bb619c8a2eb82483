"""Rows of pixels: what the means of those that read few samples need, in lanes.

Where pixels lie, how long they are and which weights they take does not depend on the samples, so
it is worked out for a whole row of a tile at once.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, kernel, lane_kernel
from resample.engine.windows.boxes import (
    FEW,
    LONGEST,
    ONES,
    PHASES,
    Integral,
    Whole,
    WindowSide,
    low_end,
)
from resample.engine.windows.edges import TRANSPARENT
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

MOST = 32  # px of a row, at most
PLACE, MOMENT, REACH = 0, MOST, 2 * MOST  # of one axis in `RowScratch.shape`
DOWN = 3 * MOST  # from one axis to the other, in all arrays
FITS = 6 * MOST  # in `RowScratch.whole`


class RowScratch(NamedTuple):
    """Scratch for a row of pixels."""

    shape: Doubles  # (6 × MOST,) of both axes: source coordinates, squares of sides, half extents
    whole: Integers32  # (7 × MOST,) of both axes: first sample, both ends in the table; and fit
    share: Floats  # (6 × MOST,) of both axes: fractions of both ends, 1 / side


@kernel
def row_scratch() -> RowScratch:
    """Allocate scratch for a row of pixels."""
    whole, share = np.empty(7 * MOST, np.int32), np.empty(6 * MOST, np.float32)
    return RowScratch(np.empty(6 * MOST), whole, share)


@lane_kernel
def measure_row(
    geometry: PixelGeometry, view: GridView, row: int, first: int, count: int, is_apart: bool,
    pixels: RowScratch,
) -> None:  # fmt: skip
    """Measure the pixels of a row from a column on, and find those that `fits` is true for.

    Parameters
    ----------
    is_apart
        The tile has no limits in common; then none fits.
    """
    is_few = view.plate.channels in (1, 4)
    if is_apart or view.points.taps > 0 or not is_few:
        for n in range(count):
            pixels.whole[np.uint64(FITS + n)] = 0
        return
    _put_footprints(geometry, row, first, count, view.finest, pixels)
    most = 0.5 * LIMITED if view.limits.excess >= 0.0 else math.inf
    plate, integral, is_open = view.plate, view.integral, view.edge != TRANSPARENT
    extent = plate.left, plate.columns, float(view.size[1])
    _put_sides(integral, 0, count, extent, most, is_open, pixels)
    extent = plate.top, plate.rows, float(view.size[0])
    _put_sides(integral, DOWN, count, extent, most, is_open, pixels)


@lane_kernel
def _put_footprints(
    geometry: PixelGeometry, row: int, first: int, count: int, finest: float, pixels: RowScratch
) -> None:
    """Places and sides of pixels; those fit that need no more than one box."""
    shape, whole, lean, leanest = pixels.shape, pixels.whole, LEAN * finest, LEANEST * finest
    for n in range(count):
        k, footprint = np.uint64(n), footprint_at(geometry, row, first + n)
        m = k + np.uint64(DOWN)
        (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
        shape[k], shape[m] = footprint.u, footprint.v
        shape[k + np.uint64(MOMENT)] = ux * ux + uy * uy
        shape[m + np.uint64(MOMENT)] = vx * vx + vy * vy
        shape[k + np.uint64(REACH)] = 0.5 * (abs(ux) + abs(uy))
        shape[m + np.uint64(REACH)] = 0.5 * (abs(vx) + abs(vy))
        # As `is_box` has it, and for a single one.
        is_upright = (max(abs(ux * vx), abs(uy * vy)) <= leanest) & (abs(ux * vx + uy * vy) <= lean)
        is_upright &= max(abs(ux * uy), abs(vx * vy)) <= finest
        whole[k + np.uint64(FITS)] = np.int32(is_upright)


@lane_kernel
def _put_sides(
    integral: Integral, axis: int, count: int, extent: tuple[float, int, float], most: float,
    is_open: bool, pixels: RowScratch,
) -> None:  # fmt: skip
    """Windows along an axis, which fit if they are small and no edge of the source crosses them.

    Parameters
    ----------
    axis
        0 or `DOWN`.
    extent
        First sample of the plate, its samples, and those of the source.
    most
        Half the extent of a pixel, at most.
    is_open
        Whether the source is continued beyond its edges.
    """
    shape, whole, share = pixels
    first, size, end = extent
    stride, few = np.int32(integral.stride), np.int32(FEW - integral.taps)
    before: Whole = np.int32(integral.before)
    shortest, longest = np.float32(integral.shortest), np.float32(LONGEST)
    one, two = np.uint64(MOST), np.uint64(2 * MOST)
    for n in range(count):
        k = np.uint64(n + axis)
        place, reach = shape[k], shape[k + np.uint64(REACH)]
        length: Single = np.sqrt(np.float32(shape[k + np.uint64(MOMENT)]))
        side = min(max(shortest, length), longest)
        # Split both ends into samples, table rows and fractions between rows, as `weights` does.
        low = low_end(integral, place - first, float(side), size)
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
        fits = is_within & (apart <= few) & (reach <= most)
        whole[np.uint64(n + FITS)] &= np.int32(fits)


@inner_step
def fits(pixels: RowScratch, n: int) -> bool:
    """Whether one box stands for the nth pixel, and reads at most `FEW` samples along both axes."""
    return bool(pixels.whole[np.uint64(FITS + n)] != 0)


@inner_step
def place_of(pixels: RowScratch, n: int) -> tuple[float, float]:
    """Source coordinates of the nth pixel."""
    return pixels.shape[np.uint64(n)], pixels.shape[np.uint64(DOWN + n)]


@inner_step
def side_of(pixels: RowScratch, n: int, axis: int) -> WindowSide:
    """Window of the nth pixel along an axis, 0 or `DOWN`."""
    k, one, two = np.uint64(n + axis), np.uint64(MOST), np.uint64(2 * MOST)
    whole, share = pixels.whole, pixels.share
    low, high = np.uint64(whole[k + one]), np.uint64(whole[k + two])
    return WindowSide(whole[k], low, high, share[k], share[k + one], share[k + two])
