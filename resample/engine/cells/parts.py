"""The loop over parts of a source: each is placed cell by cell on its own pixels.

The application says what a part is and how its cells are placed: for its own bundle it plays
the roles `begun`, `lines` and `fill`, and `stamp` where a line holds more than cells.
"""

import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, beyond, new_batch, offsets
from resample.engine.cells.taps import FilterTaps, add
from resample.engine.jit import (
    Counter,
    called_role,
    inner_kernel,
    kernel,
    making_role,
    parallel_kernel,
    plays,
    role,
    tasks,
)
from resample.engine.surfaces import (
    CURVE,
    HIGH,
    MASS,
    PEAK,
    REST,
    RIM,
    ROWS,
    SIDE,
    SLOPE,
    UNIT,
    WIDE,
    Ground,
    X,
    Y,
    add_splats,
    blurred_ellipse,
)
from resample.types import Doubles, Floats

Integers = NDArray[np.int64]
Source = Any  # a bundle of the application; its class selects the roles' bodies
Work = Any  # likewise, of one part; its field `batch` is a `Batch`

BATCH = 1 << 25  # numbers that parts may hold at a time


class SourceParts(NamedTuple):
    """Parts of a source, and the pixels of the target that belong to each."""

    bounds: Integers  # (B, 4) px that the cells of a part may meet: see `bands.LEFT`
    start: Integers  # (B + 1,) where the sums of each begin
    sums: Floats  # all parts' pixels, channels and weight interleaved


@making_role
def begun(source: Source, part: int) -> Work:
    """Set up a part for placing its cells, and scratch for a batch of them."""
    raise NotImplementedError


@role
def lines(source: Source, part: int) -> int:
    """Number of batches of a part's cells."""
    raise NotImplementedError


@role
def fill(
    source: Source, part: int, line: int, box: Integers, spread: FilterTaps, work: Work
) -> int:
    """Place a batch of cells within the pixels `box` (4,) of their part; return their count."""
    raise NotImplementedError


@called_role
def stamp(work: Work, ground: Ground) -> None:
    """Add the splats that were placed with a batch of cells."""
    raise NotImplementedError


@plays(stamp, object)
def _stamp(work: Work, ground: Ground) -> None:
    pass


@inner_kernel
def _paint_part(
    source: Source, part: int, spread: FilterTaps, parts: SourceParts, work: Work
) -> None:
    """Add the cells of one part to its pixels."""
    # Clear the part's pixels.
    box, begin, sums = parts.bounds[part], parts.start[part], parts.sums
    for n in range(begin, parts.start[part + 1]):
        sums[n] = np.float32(0)
    width, batch = box[RIGHT] - box[LEFT], work.batch
    ground = Ground(sums, begin, width, box[BOTTOM] - box[TOP])
    # Place and add its cells, batch by batch.
    for line in range(lines(source, part)):
        count = fill(source, part, line, box, spread, work)
        stamp(work, ground)
        add(sums, begin, width, batch, count, spread)


@kernel
def paint_parts(counter: Counter, source: Source, spread: FilterTaps, parts: SourceParts) -> None:
    """Add every part to its own pixels; for an application's parallel kernel."""
    for n in tasks(counter, parts.bounds.shape[0]):
        _paint_part(source, n, spread, parts, begun(source, n))


def parts_of(bounds: Integers, lanes: int) -> SourceParts:
    """Allocate the sums of parts that meet the pixels `bounds` (B, 4)."""
    # Lay the parts out one behind the other.
    start = offsets(bounds, lanes)
    return SourceParts(bounds, start, np.empty(start[-1], np.float32))


def batches(bounds: Integers, lanes: int) -> Iterator[slice]:
    """Yield groups of consecutive parts with pixels that fit in memory together."""
    start = offsets(bounds, lanes)
    first = 0
    while first < len(bounds):
        # Find the last part that fits; one part is always taken.
        last = int(np.searchsorted(start, start[first] + BATCH, side="right")) - 1
        last = min(max(last, first + 1), len(bounds))
        yield slice(first, last)
        first = last


def channel_groups(channels: int) -> list[tuple[int, int]]:
    """Split channels into groups (first, count) of three, and the rest one by one, for kernels."""
    threes = [(first, 3) for first in range(0, channels - 2, 3)]
    return threes + [(first, 1) for first in range(3 * len(threes), channels)]


WIDEST = 512.0  # px; of splats that reach farther the mass follows from a formula, to 1e-6


class Scattered(NamedTuple):
    """N samples in B parts."""

    place: Doubles  # (N, 2) px
    jacobian: Doubles  # (N, 2, 2) px per unit; its columns span what a sample covers
    is_splat: NDArray[np.bool_]  # (N,)
    values: Floats  # (1 or 3, N)
    first: NDArray[np.int64]  # (B + 1,) first sample of each part
    variances: tuple[float, float]  # of a splat, in its own units, and of the pixel filter, px²


@kernel
def _fill_cell(batch: Batch, n: int, place: Doubles, j: Doubles, box: tuple[int, int, int]) -> None:
    """Place a sample as cell n; `box` is the left, top and width of its part's pixels, px.

    Under the area filter it is an axis-aligned box as wide and high as the sample on average, at
    most a pixel.
    """
    left, top, width = box
    # Box around the position, as wide and high as the Jacobian's rows are long.
    x, y = place[0] - left, place[1] - top
    wide = min(1.0, math.hypot(j[0, 0], j[0, 1]))
    high = min(1.0, math.hypot(j[1, 0], j[1, 1]))
    x, y = x - 0.5 * wide, y - 0.5 * high
    # First pixel, and the shares of the second one along both axes.
    column, row = math.floor(x), math.floor(y)
    right, below = beyond(x, wide, column), beyond(y, high, row)
    batch.along_x[n] = min(right, 1.0) if wide > 0.0 else 0.0
    batch.along_y[n] = min(below, 1.0) if high > 0.0 else 0.0
    batch.pixel[n] = row * width + column


@kernel
def _fill_point(batch: Batch, n: int, place: Doubles, taps: int, box: tuple[int, int, int]) -> None:
    """As `_fill_cell`, under a filter that meets `taps` pixels per side."""
    left, top, width = box
    # The first tap lies half the filter before the position.
    before = 0.5 * taps - 0.5
    x, y = place[0] - left - before, place[1] - top - before
    column, row = math.floor(x), math.floor(y)
    batch.along_x[n], batch.along_y[n] = x - column, y - row
    batch.pixel[n] = row * width + column


@kernel
def _fill_splat(
    line: Floats,
    place: tuple[float, float],
    j: Doubles,
    mass: float,
    variances: tuple[float, float],
) -> None:
    """Fill in a line (ROWS, 1) that holds one splat."""
    variance, filter_variance = variances
    # Ellipse of the sample's Gaussian, convolved with the pixel filter.
    along_u, along_v = (j[0, 0], j[1, 0]), (j[0, 1], j[1, 1])
    ellipse, both = blurred_ellipse(along_u, along_v, mass, variance, filter_variance)
    # Write the form, its extents, and the peak that gives it the mass.
    line[X, 0], line[Y, 0] = place
    line[WIDE, 0] = math.sqrt(RIM * ellipse.wide)
    line[HIGH, 0] = math.sqrt(RIM * ellipse.high)
    line[SLOPE, 0], line[CURVE, 0] = ellipse.slope, ellipse.curve
    line[REST, 0] = 1.0 / ellipse.high
    line[PEAK, 0], line[MASS, 0] = UNIT * mass / math.sqrt(both), mass


@kernel
def _weigh_exactly(line: Floats, weight: Floats) -> None:
    """Scale a splat so that its weights at the centers of all pixels sum to its mass."""
    wide, high = line[WIDE, 0], line[HIGH, 0]
    if max(wide, high) > WIDEST:
        return
    # Paint it on its own canvas, moved by whole pixels so that its weights are the same.
    x, y = line[X, 0], line[Y, 0]
    columns, rows = int(2.0 * wide) + 3, int(2.0 * high) + 3
    line[X, 0] = x - np.float32(math.floor(x - wide))
    line[Y, 0] = y - np.float32(math.floor(y - high))
    sums, ones = np.zeros(2 * columns * rows, np.float32), np.ones((1, 1), np.float32)
    add_splats(Ground(sums, 0, columns, rows), ones, line, 1, weight)
    # Sum the weights, move it back, and scale its peak.
    total = 0.0
    for n in range(columns * rows):
        total += sums[2 * n + 1]
    line[X, 0], line[Y, 0] = x, y
    if total > 0.0:
        line[PEAK, 0] *= line[MASS, 0] / total


@kernel
def _scatter_part(source: Scattered, part: int, spread: FilterTaps, parts: SourceParts) -> None:
    """Add the samples of a part to its pixels."""
    box, begin = parts.bounds[part], parts.start[part]
    # Clear the part's pixels, and allocate a batch and a line.
    left, top, width, height = box[LEFT], box[TOP], box[RIGHT] - box[LEFT], box[BOTTOM] - box[TOP]
    parts.sums[begin : parts.start[part + 1]] = np.float32(0)
    first, last = source.first[part], source.first[part + 1]
    ground = Ground(parts.sums, begin, width, height)
    batch = new_batch(source.values.shape[0], last - first)
    line, weight = np.empty((ROWS, 1), np.float32), np.empty(SIDE * SIDE, np.float32)
    value, count = np.empty((source.values.shape[0], 1), np.float32), 0
    for n in range(first, last):
        # Area that the sample covers on the screen.
        place, j = source.place[n], source.jacobian[n]
        mass = abs(j[0, 0] * j[1, 1] - j[0, 1] * j[1, 0])
        # Large samples: add a splat of exact mass.
        if source.is_splat[n]:
            at = place[0] - left, place[1] - top
            _fill_splat(line, at, j, mass, source.variances)
            _weigh_exactly(line, weight)
            value[:, 0] = source.values[:, n]
            add_splats(ground, value, line, 1, weight)
            continue
        # Small samples: collect cells in the batch.
        if spread.taps > 0:
            _fill_point(batch, count, place, spread.taps, (left, top, width))
        else:
            _fill_cell(batch, count, place, j, (left, top, width))
        batch.mass[count] = mass
        batch.values[:, count] = source.values[:, n]
        count += 1
    # Add all cells at once.
    add(parts.sums, begin, width, batch, count, spread)


@parallel_kernel
def scatter_parts(
    counter: Counter, source: Scattered, spread: FilterTaps, parts: SourceParts
) -> None:
    """Add the samples of every part to its own pixels."""
    for part in tasks(counter, parts.bounds.shape[0]):
        _scatter_part(source, part, spread, parts)
