"""Cells on the screen: boxes of pixels, their sums, and bands of rows, each painted by one thread.

Passes go batch by batch, in the order of the source. Visibility takes several: find the nearest
cells, the next ones, and the rest. The application plays `placed` for the source, which is
projected again in every pass, `take` for every kind of pass, and `skips` for passes that do not
need all members.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, plays, role, tasks
from resample.types import Doubles, Floats, Single

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
    """Index of the first sum of each part (B + 1,)."""
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
    """First and last + 1 of a row's pixels with filters, `reach` px wide, inside all lines."""
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
        # Columns with filters within the source.
        inner = _inner_columns(border, border.row + row + 0.5, border.column + picture.shape[1])
        for column in range(picture.shape[1]):
            weight = picture[row, column, weight_at]
            is_inner = inner[0] <= border.column + column < inner[1]
            # Full pixels have coverage 1, others their weight.
            is_full = weight > zero and (weight >= border.full or is_inner)
            coverage[row, column] = one if is_full else min(max(weight, zero), one)
            # Divide where the weight differs from the coverage: in full pixels, and above 1.
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


Number = Any  # float32 or float64; results have the type of the arguments
Pixel = Any  # a number kept in int32
Places = NDArray[np.int32]


@inner_kernel
def pixel_of(place: Single) -> Pixel:
    """Pixel that a position lies in; `math.floor` of a float32 is a function call."""
    # Truncate, and correct negative numbers.
    whole = np.int32(place)
    return np.int32(whole - np.int32(place < np.float32(whole)))


@inner_kernel
def length(a: Single, b: Single) -> Single:
    """Length of (a, b): extent of a box along an axis, from the extents of its two sides."""
    return np.float32(math.sqrt(a * a + b * b))


@inner_kernel
def beyond(start: Number, extent: Number, pixel: Number) -> Number:
    """Share of a box, along an axis, beyond the pixel where it starts."""
    return max(np.float32(0), (start + extent - pixel - np.float32(1)) / extent)


@inner_kernel
def within(start: Number, end: Number, pixel: Number) -> tuple[Number, Number]:
    """Where a box begins and ends within a pixel along an axis; in reverse order if it misses."""
    return max(start, pixel), min(end, pixel + np.float32(1))


class Batch(NamedTuple):
    """Columns of N cells; possibly only the first few are in use."""

    pixel: Places  # (N,) first pixel that a cell meets: row × width + column in its part's pixels
    # (N,) share of the second pixel (area filter), or the distance from the first tap to where the
    # filter starts, 0..1 px.
    along_x: Floats
    along_y: Floats
    mass: Floats  # (N,) px² that a cell covers; 0 if it meets no pixel
    values: NDArray[Any]  # (channels, N)


@kernel
def new_batch(channels: int, count: int) -> Batch:
    """Allocate a batch of `count` cells."""
    return Batch(
        np.empty(count, np.int32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty(count, np.float32),
        np.empty((channels, count), np.float32),
    )


Bounds = NDArray[Any]  # (..., 4) whole numbers, px: see `LEFT`

# Columns of bounds on the screen; the last two are exclusive.
LEFT, TOP, RIGHT, BOTTOM = range(4)

Source = Any  # bundles of the application; their classes select the roles' bodies
Pass = Any
Members = Any


@inner_kernel  # as `tasks`
def bands(counter: Counter, height: int, band: int) -> Iterator[tuple[int, int]]:
    """Yield the rows of the bands that a thread paints, first and last + 1."""
    for n in tasks(counter, -(-height // band)):
        yield n * band, min(height, (n + 1) * band)


@kernel
def overlapping(bounds: Bounds, rows: tuple[int, int], width: int) -> NDArray[np.int32]:
    """Indices, in order, of bounds (N, 4) that meet a band's rows, `width` px wide."""
    found = np.empty(bounds.shape[0], np.int32)
    count = 0
    for n in range(bounds.shape[0]):
        is_met = (bounds[n, TOP] < rows[1]) & (bounds[n, BOTTOM] > rows[0])
        is_met &= (bounds[n, LEFT] < width) & (bounds[n, RIGHT] > 0)
        if is_met:
            found[count] = n
            count += 1
    return found[:count]


@role
def placed(source: Source, member: int, batch: Members) -> int:
    """Place the cells of a member of the source in a batch; return the number of runs."""
    raise NotImplementedError


@role
def skips(look: Pass, source: Source, member: int, nth: int) -> bool:
    """Whether a pass can skip a member, the `nth` that meets the band."""
    raise NotImplementedError


@plays(skips, object)
def _skips_none(look: Pass, source: Source, member: int, nth: int) -> bool:  # noqa: ARG001
    return False


@role
def take(look: Pass, source: Source, member: int, nth: int, run: int, batch: Members) -> None:
    """Process a run of the cells of a batch."""
    raise NotImplementedError


@inner_kernel
def walk(look: Pass, source: Source, members: NDArray[np.int32], batch: Members) -> None:
    """Run a pass over all members of a source that meet a band."""
    # Project only members that the pass needs.
    for nth in range(members.size):
        member = members[nth]
        if not skips(look, source, member, nth):
            for run in range(placed(source, member, batch)):
                take(look, source, member, nth, run, batch)
