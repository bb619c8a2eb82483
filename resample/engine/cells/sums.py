"""Sums of parts, added up band by band; and sums resolved to pixels.

Every part adds its cells to pixels of its own, so parts may run on any thread; then each band of
rows adds the parts' pixels in the order of the parts. So the bits never depend on the number of
threads.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, bands, overlapping
from resample.engine.jit import Counter, kernel, parallel_kernel
from resample.types import Doubles, Floats

Integers = NDArray[np.int64]

BAND = 16  # rows of the image that one thread sums at a time


class Border(NamedTuple):
    """Where a source fills pixels completely, so that sums may be divided by their weights."""

    lines: Doubles  # (N, 3) its edges on screen; the product with (x, y, 1) is positive inside
    reach: float  # px, radius of the pixel filter
    full: float  # weight from which on a pixel counts as filled wherever it lies
    column: int = 0  # where on the lines' screen the image begins
    row: int = 0


class Means(NamedTuple):
    """Arrays that means are written to."""

    image: Floats  # (height, width, C)
    coverage: Floats  # (height, width)
    first: int  # channel of the image


def offsets(bounds: Integers, lanes: int) -> Integers:
    """Index where the sums of each part begin (B + 1,)."""
    start = np.zeros(len(bounds) + 1, np.int64)
    pixels = (bounds[:, BOTTOM] - bounds[:, TOP]) * (bounds[:, RIGHT] - bounds[:, LEFT])
    np.cumsum(pixels * lanes, out=start[1:])
    return start


@kernel
def _collect_band(
    bounds: Integers, start: Integers, sums: Floats, picture: Floats, rows: tuple[int, int]
) -> None:
    """Add the sums of all parts to some rows of the image, in the order of the parts."""
    lanes, columns = picture.shape[2], picture.shape[1]
    for n in overlapping(bounds, rows, columns):
        # Clip the part's pixels to the band.
        left, top = bounds[n, LEFT], bounds[n, TOP]
        width = bounds[n, RIGHT] - left
        from_column, to_column = max(left, 0), min(bounds[n, RIGHT], columns)
        for row in range(max(top, rows[0]), min(bounds[n, BOTTOM], rows[1])):
            # Index of the row's column 0, which need not be in the part.
            at = start[n] + ((row - top) * width - left) * lanes
            for column in range(from_column, to_column):
                for lane in range(lanes):
                    picture[row, column, lane] += sums[at + column * lanes + lane]


@parallel_kernel
def collect(
    counter: Counter, bounds: Integers, start: Integers, sums: Floats, picture: Floats
) -> None:
    """Add all parts' pixels to the image (height, width, lanes)."""
    for rows in bands(counter, picture.shape[0], BAND):
        _collect_band(bounds, start, sums, picture, rows)


@kernel
def _inner_columns(border: Border, y: float, width: int) -> tuple[int, int]:
    """First and last + 1 of a row's pixels whose filters, `reach` px wide, are inside all lines."""
    lines, reach = border.lines, border.reach
    first, last = 0.0, float(width)
    # Each line bounds the columns from one side, by the sign of its slope.
    for line in range(lines.shape[0]):
        a = lines[line, 0]
        rest = lines[line, 1] * y + lines[line, 2] - reach * (abs(a) + abs(lines[line, 1]))
        if a > 0.0:
            first = max(first, math.floor(min(max(-rest / a - 0.5, -1.0), last)) + 1.0)
        elif a < 0.0:
            last = min(last, math.ceil(min(max(-rest / a - 0.5, 0.0), last)))
        elif rest <= 0.0:
            return 0, 0
    return int(min(first, width)), int(max(last, 0.0))


@kernel
def _finish_band(
    picture: Floats, border: Border, is_sum: bool, rows: tuple[int, int], means: Means
) -> None:
    """Divide some rows by their weights, where the filter lies on the source alone."""
    image, coverage, first = means
    weight_at = picture.shape[2] - 1
    zero, one = np.float32(0), np.float32(1)
    for row in range(rows[0], rows[1]):
        # Columns whose filters lie within the source.
        inner = _inner_columns(border, border.row + row + 0.5, border.column + picture.shape[1])
        for column in range(picture.shape[1]):
            weight = picture[row, column, weight_at]
            is_inner = inner[0] <= border.column + column < inner[1]
            # Pixels that are full have coverage 1, others that of their weight.
            is_full = weight > zero and (weight >= border.full or is_inner)
            coverage[row, column] = one if is_full else min(max(weight, zero), one)
            # Divide where the weight is no coverage: in full pixels, and where it is above 1.
            is_mean = (is_full or weight > one) and not is_sum
            share = one / weight if is_mean else one
            for lane in range(weight_at):
                image[row, column, first + lane] = picture[row, column, lane] * share


@parallel_kernel
def finish(counter: Counter, picture: Floats, border: Border, is_sum: bool, means: Means) -> None:
    """Resolve sums to means: pixels filled by the source are divided by their weights.

    `picture`: (height, width, lanes) sums of some channels and, last, of weights. `is_sum`: keep
    sums as they are.
    """
    for rows in bands(counter, picture.shape[0], BAND):
        _finish_band(picture, border, is_sum, rows, means)
