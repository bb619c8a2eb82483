"""Means of an interpolated grid over axis-aligned boxes, as weighted sums of samples in windows.

The mean over a box of a separable kernel k's interpolation is a sum over samples. Weights
are, along each axis, (K(b − n) − K(a − n)) / (b − a), with K the integral of k and a to b the side
of the box. K is tabulated and interpolated linearly; a window is a few dozen products.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, inner_step
from resample.types import Floats, Single

TRANSPARENT, CLAMP, WRAP, MIRROR = range(4)


@inner_kernel
def mapped(index: int, size: int, edge: int) -> int:
    """Index of the sample that continues the grid at an index beyond its edges."""
    if 0 <= index < size:
        return index
    if edge == CLAMP:
        return 0 if index < 0 else size - 1
    if edge == WRAP:
        return index % size
    # Mirror; at a transparent edge too, where it serves interpolation only, so that sums are kept.
    index %= 2 * size
    return index if index < size else 2 * size - 1 - index


@inner_kernel
def folded(place: float, size: float, edge: int, margin: float) -> tuple[float, float]:
    """Equivalent position in the grid or within `margin` of it; and −1 if mirrored, else 1."""
    if edge == WRAP:
        return place - math.floor(place / size) * size, 1.0
    if edge == MIRROR:
        place -= math.floor(place / (2.0 * size)) * (2.0 * size)
        return (place, 1.0) if place <= size else (2.0 * size - place, -1.0)
    return min(max(place, -margin), size + margin), 1.0


PHASES = 256  # rows of a table of integrals
ONES = 8  # entries of 1 before, and of 0 after, those in between
LONGEST = 192.0  # samples, of a box's side
SHORTEST = 0.05  # samples; shorter sides are widened to it, which leaves the mean as it is
POINTLIKE = 0.01  # samples; shorter sides are points, if the interpolation is of point values
FINE_PHASES = 1024  # rows of a table of weights at points
WIDE = 224  # weights along an axis, at most
SPARE = 8  # numbers that may be read beyond a grid's last
FEW, FEWER = 8, 6  # samples along an axis of windows that are summed without loops

Place = Any  # an index kept in uint64, which needs no test for negative values
Whole = Any  # a number kept in int32, to which a float is converted in one instruction


class Integral(NamedTuple):
    """The integral of an interpolation's kernel, tabulated."""

    # (PHASES + 2) × stride: the row of a phase holds ONES ones, `taps` integrals up to phase −
    # shift + before, and one less each, and ONES zeros.
    table: Floats
    stride: int
    taps: int
    before: int
    shift: float
    shortest: float = SHORTEST  # samples; shorter sides are widened to it, or are points


class PointTaps(NamedTuple):
    """Weights of the samples around a point, tabulated by the point's fraction of a sample."""

    table: Floats  # (FINE_PHASES + 2) × stride; padded with zeros
    stride: int  # a multiple of eight
    taps: int  # 0: short sides are widened boxes
    own: float  # samples², extent that a sample has already along an axis, as interpolated


class Plate(NamedTuple):
    """A part of a source for kernels: coefficients, and their continuation at edges."""

    flat: Floats  # rows × columns × channels, and `SPARE` more
    left: float  # source coordinates of its first corner
    top: float
    rows: int
    columns: int
    channels: int
    # Of a plate with only a rectangle in memory:
    stride: int  # columns in memory
    before: int  # numbers missing before the first one, if all rows had that many columns


class GridBox(NamedTuple):
    """An axis-aligned box in a grid: its center and its sides, samples."""

    u: float
    v: float
    wide: float
    high: float


class WindowSide(NamedTuple):
    """One side of a box, as the weights of a window of at most `FEW` samples are computed."""

    start: Whole  # first sample
    low: Place  # both ends, in the table of integrals
    high: Place
    f: Single  # fractions of a row of the table, beyond them
    g: Single
    share: Single  # 1 / its length


@inner_kernel
def _far_weights(
    integral: Integral,
    rows: tuple[int, int],
    parts: tuple[Single, Single],
    apart: int,
    share: Single,
    scratch: Floats,
    first: int,
) -> None:
    """As `weights`, for a side so long that the tables' transitions at its ends do not overlap."""
    table, stride, taps = integral.table, integral.stride, integral.taps
    low, high = rows[0] * stride + ONES, rows[1] * stride + ONES
    # Clamp both ends' entries to their rows: 1 before the transition, 0 after it.
    for k in range(taps + apart):
        a, b = low + min(k, taps), high + max(k - apart, -1)
        start = table[a] + parts[0] * (table[a + stride] - table[a])
        end = table[b] + parts[1] * (table[b + stride] - table[b])
        scratch[first + k] = share * (end - start)
    _clear(scratch, first + taps + apart)


@inner_step
def _clear(scratch: Floats, first: int) -> None:
    """Zero the weights up to the next multiple of eight."""
    for k in range(first, first + 7):
        scratch[k] = np.float32(0)


@inner_step
def _point_weights(
    points: PointTaps, place: float, size: int, share: Single, scratch: Floats, first: int
) -> int:
    """Compute the weights of the samples around a point, into `scratch`; return the first sample.

    `place`: samples from the start of a grid with `size` of them; the window is kept on the grid.
    """
    table, stride, taps = points.table, points.stride, points.taps
    # Split the distance from the sample before into samples, table rows and a fraction of a row.
    before = taps // 2 - 1
    low = min(max(float(before), place - 0.5), float(size - taps + before))
    at: Whole = np.int32(low)
    f = np.float32(low - at) * np.float32(FINE_PHASES)
    row: Whole = np.int32(f)
    f -= np.float32(row)
    k = np.uint64(row * stride)
    for n in range(stride):
        o = k + np.uint64(n)
        step = table[o + np.uint64(stride)] - table[o]
        scratch[first + n] = share * (table[o] + f * step)
    return int(at - before)


@inner_step
def weights(
    integral: Integral,
    points: PointTaps,
    side: tuple[float, float],
    size: int,
    share: Single,
    scratch: Floats,
    first: int,
) -> tuple[int, int]:
    """Compute weights of the samples along an axis for one side of a box, into `scratch`.

    `side`: center and length, samples from the start of a grid with `size` of them; the window is
    kept on the grid. `share`: what the weights sum to. `first`: where in `scratch` they begin.
    Returns first sample, and how many. Weights up to the next multiple of eight are 0.
    """
    table, stride, taps = integral.table, integral.stride, integral.taps
    if points.taps > 0 and side[1] < integral.shortest:
        return _point_weights(points, side[0], size, share, scratch, first), points.taps
    extent = min(max(integral.shortest, side[1]), LONGEST)
    low = low_end(integral, side[0], extent, size)
    # Split both ends into samples, table rows and fractions between rows.
    at_low: Whole = np.int32(low)
    f = np.float32(low - at_low)
    g = f + np.float32(extent)
    apart: Whole = np.int32(g)
    f, g = f * np.float32(PHASES), (g - np.float32(apart)) * np.float32(PHASES)
    row_low: Whole = np.int32(f)
    row_high: Whole = np.int32(g)
    parts = f - np.float32(row_low), g - np.float32(row_high)
    factor, start = share / np.float32(extent), at_low - integral.before
    # Long sides need no table between their ends.
    if apart > ONES:
        _far_weights(integral, (row_low, row_high), parts, apart, factor, scratch, first)
        return start, taps + apart
    # Short ones: differences of two rows of the table, eight weights at a time.
    a = np.uint64(row_low * stride + ONES)
    b = np.uint64(row_high * stride + ONES - apart)
    _eight_weights(table, (a, b), np.uint64(stride), parts, factor, scratch, np.uint64(first))
    for eight in range(1, (taps + apart + 7) >> 3):
        o = np.uint64(eight << 3)
        at = a + o, b + o
        _eight_weights(table, at, np.uint64(stride), parts, factor, scratch, np.uint64(first) + o)
    # The last eight may have read the tables' next rows.
    if taps + apart > ONES:
        _clear(scratch, first + taps + apart)
    return start, taps + apart


@inner_step
def low_end(integral: Integral, middle: float, extent: float, size: int) -> float:
    """Low end of a side on a grid of `size` samples, in table units; its window stays on it.

    Constants come first, as min and max with NaN return their first argument.
    """
    low = max(float(integral.before), middle - 0.5 * extent - integral.shift)
    return min(float(size - integral.taps) + integral.before - extent - 1.0, low)


@inner_step
def _difference(
    table: Floats, at: tuple[Place, Place], stride: Place, parts: tuple[Single, Single], n: int
) -> Single:
    """Integral over a side, times its length, for the nth sample of eight."""
    k = np.uint64(n)
    a, b = at[0] + k, at[1] + k
    start = table[a] + parts[0] * (table[a + stride] - table[a])
    return table[b] + parts[1] * (table[b + stride] - table[b]) - start


@inner_step
def _eight_weights(
    table: Floats,
    at: tuple[Place, Place],
    stride: Place,
    parts: tuple[Single, Single],
    factor: Single,
    scratch: Floats,
    first: Place,
) -> None:
    """Compute eight weights, all read before any is written, so that they are vectorized."""
    a = factor * _difference(table, at, stride, parts, 0)
    b = factor * _difference(table, at, stride, parts, 1)
    c = factor * _difference(table, at, stride, parts, 2)
    d = factor * _difference(table, at, stride, parts, 3)
    e = factor * _difference(table, at, stride, parts, 4)
    f = factor * _difference(table, at, stride, parts, 5)
    g = factor * _difference(table, at, stride, parts, 6)
    h = factor * _difference(table, at, stride, parts, 7)
    _put_eight(scratch, first, (a, b, c, d, e, f, g, h))


@inner_step
def _put_eight(scratch: Floats, first: Place, eight: tuple[Single, ...]) -> None:
    a, b, c, d, e, f, g, h = eight
    scratch[first], scratch[first + np.uint64(1)] = a, b
    scratch[first + np.uint64(2)], scratch[first + np.uint64(3)] = c, d
    scratch[first + np.uint64(4)], scratch[first + np.uint64(5)] = e, f
    scratch[first + np.uint64(6)], scratch[first + np.uint64(7)] = g, h


@inner_step
def _eight_columns(
    flat: Floats, at: Place, stride: Place, scratch: Floats, count: int
) -> tuple[Single, ...]:
    """Column sums of eight contiguous numbers over a window's rows, weighted by room[WIDE:]."""
    # Eight accumulators stay in registers.
    a = b = c = d = e = f = g = h = np.float32(0)
    for row in range(count):
        w = scratch[np.uint64(WIDE) + np.uint64(row)]
        a += w * flat[at]
        b += w * flat[at + np.uint64(1)]
        c += w * flat[at + np.uint64(2)]
        d += w * flat[at + np.uint64(3)]
        e += w * flat[at + np.uint64(4)]
        f += w * flat[at + np.uint64(5)]
        g += w * flat[at + np.uint64(6)]
        h += w * flat[at + np.uint64(7)]
        at += stride
    return a, b, c, d, e, f, g, h


@inner_step
def _dot_of_eight(scratch: Floats, first: Place, eight: tuple[Single, ...]) -> Single:
    """Weighted sum of eight numbers; pairwise, for shorter dependency chains."""
    a, b, c, d, e, f, g, h = eight
    a, b = a * scratch[first], b * scratch[first + np.uint64(1)]
    c, d = c * scratch[first + np.uint64(2)], d * scratch[first + np.uint64(3)]
    e, f = e * scratch[first + np.uint64(4)], f * scratch[first + np.uint64(5)]
    g, h = g * scratch[first + np.uint64(6)], h * scratch[first + np.uint64(7)]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner_step
def _add_columns(scratch: Floats, count: int, channels: int, total: Floats) -> None:
    """Add a window's column sums, weighted along u, to a pixel's channels."""
    for channel in range(channels):
        a = np.float32(0)
        for n in range(count):
            a += scratch[n] * scratch[2 * WIDE + n * channels + channel]
        total[channel] += a


@inner_step
def add_mean(
    plate: Plate,
    integral: Integral,
    points: PointTaps,
    box: GridBox,
    share: Single,
    scratch: Floats,
    total: Floats,
) -> None:
    """Add the mean of a grid over a box, times a share, to the channels `total`.

    `box`: in the grid's own coordinates: its first sample covers 0..1. It is moved onto the grid.
    `scratch`: scratch of `scratch_size` numbers.
    """
    # Weights along both axes; the share is in those along v.
    flat, _, _, rows, columns, channels, there, before = plate
    one = np.float32(1)
    left, wide = weights(integral, points, (box.u, box.wide), columns, one, scratch, 0)
    top, high = weights(integral, points, (box.v, box.high), rows, share, scratch, WIDE)
    # First number of the window.
    at = np.uint64((top * there + left) * channels - before)
    stride = np.uint64(there * channels)
    # One channel: columns need no buffer.
    if channels == 1:
        for eight in range((wide + 7) >> 3):
            o = np.uint64(eight << 3)
            total[0] += _dot_of_eight(
                scratch, o, _eight_columns(flat, at + o, stride, scratch, high)
            )
        return
    # Several channels: sum the columns into the scratch, then across them.
    for eight in range((wide * channels + 7) >> 3):
        o = np.uint64(eight << 3)
        sums = _eight_columns(flat, at + o, stride, scratch, high)
        _put_eight(scratch, np.uint64(2 * WIDE) + o, sums)
    _add_columns(scratch, wide, channels, total)


@inner_step
def _eight(numbers: Floats, at: Place) -> tuple[Single, ...]:
    """Eight contiguous numbers."""
    one, two, three = np.uint64(1), np.uint64(2), np.uint64(3)
    other = at + np.uint64(4)
    return (
        numbers[at], numbers[at + one], numbers[at + two], numbers[at + three],
        numbers[other], numbers[other + one], numbers[other + two], numbers[other + three],
    )  # fmt: skip


@inner_step
def _sum_of_fewer(flat: Floats, at: Place, stride: Place, weights: tuple[Single, ...]) -> Single:
    """Weighted sum of a number in each of `FEWER` rows, in two chains."""
    one = weights[0] * flat[at]
    at += stride
    two = weights[1] * flat[at]
    at += stride
    one += weights[2] * flat[at]
    at += stride
    two += weights[3] * flat[at]
    at += stride
    one += weights[4] * flat[at]
    at += stride
    two += weights[5] * flat[at]
    return one + two


@inner_step
def _sum_of_few(flat: Floats, at: Place, stride: Place, weights: tuple[Single, ...]) -> Single:
    """Weighted sum of a number in each of `FEW` rows."""
    last = at + stride * np.uint64(FEWER)
    rest = weights[6] * flat[last] + weights[7] * flat[last + stride]
    return _sum_of_fewer(flat, at, stride, weights) + rest


@inner_step
def _eight_of_fewer(
    flat: Floats, at: Place, stride: Place, weights: tuple[Single, ...]
) -> tuple[Single, ...]:
    """Sums of eight contiguous numbers over `FEWER` rows, times weights."""
    return (
        _sum_of_fewer(flat, at, stride, weights),
        _sum_of_fewer(flat, at + np.uint64(1), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(2), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(3), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(4), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(5), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(6), stride, weights),
        _sum_of_fewer(flat, at + np.uint64(7), stride, weights),
    )


@inner_step
def _eight_of_few(
    flat: Floats, at: Place, stride: Place, weights: tuple[Single, ...]
) -> tuple[Single, ...]:
    """Sums of eight contiguous numbers over `FEW` rows, times weights."""
    return (
        _sum_of_few(flat, at, stride, weights),
        _sum_of_few(flat, at + np.uint64(1), stride, weights),
        _sum_of_few(flat, at + np.uint64(2), stride, weights),
        _sum_of_few(flat, at + np.uint64(3), stride, weights),
        _sum_of_few(flat, at + np.uint64(4), stride, weights),
        _sum_of_few(flat, at + np.uint64(5), stride, weights),
        _sum_of_few(flat, at + np.uint64(6), stride, weights),
        _sum_of_few(flat, at + np.uint64(7), stride, weights),
    )


@inner_step
def _times_pair(sums: tuple[Single, ...], scratch: Floats, n: int) -> tuple[Single, ...]:
    """Two samples of four numbers, times the weights across of the nth two."""
    a, b, c, d, e, f, g, h = sums
    v, w = scratch[np.uint64(n + n)], scratch[np.uint64(n + n + 1)]
    return v * a, v * b, v * c, v * d, w * e, w * f, w * g, w * h


@inner_step
def _plus(one: tuple[Single, ...], other: tuple[Single, ...]) -> tuple[Single, ...]:
    """Sum of eight numbers and others."""
    a, b, c, d, e, f, g, h = one
    i, j, k, m, n, o, p, q = other
    return a + i, b + j, c + k, d + m, e + n, f + o, g + p, h + q


@inner_step
def put_mean_of_few(
    plate: Plate, integral: Integral, across: WindowSide, down: WindowSide, is_fewer: bool,
    scratch: Floats, total: Floats,
) -> None:  # fmt: skip
    """Put the mean over a box with a window of at most `FEW` samples along both axes.

    The plate has one number for each sample, or four. `is_fewer`: there are at most `FEWER`.
    """
    # Compute the weights along both axes; those beyond the window are 0.
    table, stride, first = integral.table, np.uint64(integral.stride), np.uint64(WIDE)
    start, a, b, f, g, share = across
    _eight_weights(table, (a, b), stride, (f, g), share, scratch, np.uint64(0))
    above, a, b, f, g, share = down
    _eight_weights(table, (a, b), stride, (f, g), share, scratch, first)
    flat, weights = plate.flat, _eight(scratch, first)
    at = np.uint64((above * plate.stride + start) * plate.channels - plate.before)
    step, eight = np.uint64(plate.stride * plate.channels), np.uint64(8)
    if plate.channels == 1:
        sums = _eight_of_few(flat, at, step, weights)
        total[0] = _dot_of_eight(scratch, np.uint64(0), sums)
        return
    # Sum down two samples at a time, and add them up across.
    first += first
    if is_fewer:
        one = _times_pair(_eight_of_fewer(flat, at, step, weights), scratch, 0)
        at += eight
        two = _times_pair(_eight_of_fewer(flat, at, step, weights), scratch, 1)
        at += eight
        three = _times_pair(_eight_of_fewer(flat, at, step, weights), scratch, 2)
        _put_eight(scratch, first, _plus(_plus(one, two), three))
    else:
        one = _times_pair(_eight_of_few(flat, at, step, weights), scratch, 0)
        at += eight
        two = _times_pair(_eight_of_few(flat, at, step, weights), scratch, 1)
        at += eight
        three = _times_pair(_eight_of_few(flat, at, step, weights), scratch, 2)
        at += eight
        four = _times_pair(_eight_of_few(flat, at, step, weights), scratch, 3)
        _put_eight(scratch, first, _plus(_plus(one, two), _plus(three, four)))
    a, b, c, d, e, f, g, h = _eight(scratch, first)
    total[0], total[1], total[2], total[3] = a + e, b + f, c + g, d + h


@inner_kernel
def scratch_size(channels: int) -> int:
    """Size of the scratch that `add_mean` needs."""
    return 2 * WIDE + WIDE * channels + SPARE
