"""Means of an interpolated grid over upright boxes, as sums of samples in a window around each.

The mean over a box of what a separable kernel k interpolates is a sum over samples whose weights
are, along each axis, (K(b − n) − K(a − n)) / (b − a), with K the integral of k and a to b the side
of the box. K comes from a table, linear between its rows; a window is a few dozen products.
"""

from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, inner_step
from resample.types import Floats, Single

PHASES = 256  # rows of a table of integrals
ONES = 8  # entries before and after those that differ from 0 and 1
LONGEST = 192.0  # samples, of a box's side
SHORTEST = 0.05  # samples; a box of less is taken for one of this, whose mean is the same
WIDE = 224  # weights along an axis, at most
SPARE = 8  # numbers that may be read beyond a grid's last

Place = Any  # a number kept in uint64, which needs no look at its sign
Whole = Any  # a number kept in int32, to which a float is turned in one operation


class Integral(NamedTuple):
    """The integral of an interpolation's kernel as a table."""

    # (PHASES + 2) × stride: a row has for its phase ONES ones, `taps` integrals up to phase −
    # shift + before, and one less each, and ONES zeros.
    table: Floats
    stride: int
    taps: int
    before: int
    shift: float


class Plate(NamedTuple):
    """A part of a source as kernels read it: coefficients, and what continues them at edges."""

    flat: Floats  # rows × columns × channels, and `SPARE` more
    left: float  # source coordinates of its first corner
    top: float
    rows: int
    columns: int
    channels: int
    # Of a plate of which only a rectangle is there:
    stride: int  # columns that there are
    before: int  # numbers that would come before the first one, if all its rows had that many


class Rect(NamedTuple):
    """A box in a grid: its middle and its sides, samples."""

    u: float
    v: float
    wide: float
    high: float


@inner_kernel
def _far_weights(
    integral: Integral,
    rows: tuple[int, int],
    parts: tuple[Single, Single],
    apart: int,
    share: Single,
    room: Floats,
    first: int,
) -> None:
    """As `weights`, of a box with so many samples inside that tables' rows do not meet."""
    table, stride, taps, _, _ = integral
    low, high = rows[0] * stride + ONES, rows[1] * stride + ONES
    for k in range(taps + apart):
        a, b = low + min(k, taps), high + max(k - apart, -1)
        start = table[a] + parts[0] * (table[a + stride] - table[a])
        end = table[b] + parts[1] * (table[b + stride] - table[b])
        room[first + k] = share * (end - start)
    _clear(room, first + taps + apart)


@inner_step
def _clear(room: Floats, first: int) -> None:
    """Make weights up to the next whole eight nothing."""
    for k in range(first, first + 7):
        room[k] = np.float32(0)


@inner_step
def weights(
    integral: Integral,
    side: tuple[float, float],
    size: int,
    share: Single,
    room: Floats,
    first: int,
) -> tuple[int, int]:
    """Weights of the samples along an axis for a side of a box, into `room` from `first` on.

    Parameters
    ----------
    side
        Middle and length, samples from the start of a grid with `size` of them, on which the
        window is kept.
    share
        What the weights sum to.

    Returns
    -------
    First sample, and how many. Weights after these, to a whole eight of them, are 0.
    """
    table, stride, taps, before, shift = integral
    extent = min(max(SHORTEST, side[1]), LONGEST)  # numbers come first, as what follows may be none
    low = max(float(before), side[0] - 0.5 * extent - shift)
    low = min(low, float(size - taps) + before - extent - 1.0)
    at_low: Whole = np.int32(low)
    f = np.float32(low - at_low)
    g = f + np.float32(extent)
    apart: Whole = np.int32(g)
    f, g = f * np.float32(PHASES), (g - np.float32(apart)) * np.float32(PHASES)
    row_low: Whole = np.int32(f)
    row_high: Whole = np.int32(g)
    f, g = f - np.float32(row_low), g - np.float32(row_high)
    factor = share / np.float32(extent)
    if apart > ONES:
        _far_weights(integral, (row_low, row_high), (f, g), apart, factor, room, first)
        return at_low - before, taps + apart
    a = np.uint64(row_low * stride + ONES)
    b = np.uint64(row_high * stride + ONES - apart)
    _eight_weights(table, (a, b), np.uint64(stride), (f, g), factor, room, np.uint64(first))
    for eight in range(1, (taps + apart + 7) >> 3):
        o = np.uint64(eight << 3)
        at = a + o, b + o
        _eight_weights(table, at, np.uint64(stride), (f, g), factor, room, np.uint64(first) + o)
    if taps + apart > ONES:  # the last eight may have gone on to tables' next rows
        _clear(room, first + taps + apart)
    return at_low - before, taps + apart


@inner_step
def _difference(
    table: Floats, at: tuple[Place, Place], stride: Place, parts: tuple[Single, Single], n: int
) -> Single:
    """Integral over a side, times its length, for the n-th sample of eight."""
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
    room: Floats,
    first: Place,
) -> None:
    """Eight weights in a row; all read before one is written, so that they are one operation."""
    a = factor * _difference(table, at, stride, parts, 0)
    b = factor * _difference(table, at, stride, parts, 1)
    c = factor * _difference(table, at, stride, parts, 2)
    d = factor * _difference(table, at, stride, parts, 3)
    e = factor * _difference(table, at, stride, parts, 4)
    f = factor * _difference(table, at, stride, parts, 5)
    g = factor * _difference(table, at, stride, parts, 6)
    h = factor * _difference(table, at, stride, parts, 7)
    _put_eight(room, first, (a, b, c, d, e, f, g, h))


@inner_step
def _put_eight(room: Floats, first: Place, eight: tuple[Single, ...]) -> None:
    a, b, c, d, e, f, g, h = eight
    room[first], room[first + np.uint64(1)] = a, b
    room[first + np.uint64(2)], room[first + np.uint64(3)] = c, d
    room[first + np.uint64(4)], room[first + np.uint64(5)] = e, f
    room[first + np.uint64(6)], room[first + np.uint64(7)] = g, h


@inner_step
def _eight_columns(
    flat: Floats, at: Place, stride: Place, room: Floats, count: int
) -> tuple[Single, ...]:
    """Sums over a window's rows of eight numbers side by side, weighted by room[WIDE:]."""
    a = b = c = d = e = f = g = h = np.float32(0)
    for row in range(count):
        w = room[np.uint64(WIDE) + np.uint64(row)]
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
def _dot_of_eight(room: Floats, first: Place, eight: tuple[Single, ...]) -> Single:
    """Sum of eight numbers, weighted by those in `room`."""
    a, b, c, d, e, f, g, h = eight
    a, b = a * room[first], b * room[first + np.uint64(1)]
    c, d = c * room[first + np.uint64(2)], d * room[first + np.uint64(3)]
    e, f = e * room[first + np.uint64(4)], f * room[first + np.uint64(5)]
    g, h = g * room[first + np.uint64(6)], h * room[first + np.uint64(7)]
    return ((a + e) + (c + g)) + ((b + f) + (d + h))


@inner_step
def _add_columns(room: Floats, count: int, channels: int, total: Floats) -> None:
    """Add a window's column sums, weighted along u, to a pixel's channels."""
    if channels == 3:
        a = b = c = np.float32(0)
        for n in range(count):
            at = np.uint64(2 * WIDE) + np.uint64(3) * np.uint64(n)
            w = room[np.uint64(n)]
            a += w * room[at]
            b += w * room[at + np.uint64(1)]
            c += w * room[at + np.uint64(2)]
        total[0] += a
        total[1] += b
        total[2] += c
        return
    for channel in range(channels):
        a = np.float32(0)
        for n in range(count):
            a += room[n] * room[2 * WIDE + n * channels + channel]
        total[channel] += a


@inner_step
def add_mean(
    plate: Plate, integral: Integral, box: Rect, share: Single, room: Floats, total: Floats
) -> None:
    """Add the mean of a grid over a box, times a share, to the channels `total`.

    Parameters
    ----------
    box
        In the grid's own coordinates: its first sample covers 0..1. It is kept on the grid.
    room
        As `room_for` makes it.
    """
    flat, _, _, rows, columns, channels, there, before = plate
    one = np.float32(1)
    left, wide = weights(integral, (box.u, box.wide), columns, one, room, 0)
    top, high = weights(integral, (box.v, box.high), rows, share, room, WIDE)
    at = np.uint64((top * there + left) * channels - before)
    stride = np.uint64(there * channels)
    if channels == 1:
        for eight in range((wide + 7) >> 3):
            o = np.uint64(eight << 3)
            total[0] += _dot_of_eight(room, o, _eight_columns(flat, at + o, stride, room, high))
        return
    for eight in range((wide * channels + 7) >> 3):
        o = np.uint64(eight << 3)
        sums = _eight_columns(flat, at + o, stride, room, high)
        _put_eight(room, np.uint64(2 * WIDE) + o, sums)
    _add_columns(room, wide, channels, total)


@inner_kernel
def room_for(channels: int) -> int:
    """Numbers that `add_mean` needs room for."""
    return 2 * WIDE + WIDE * channels + SPARE
