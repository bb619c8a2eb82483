"""Symmetric separable filters on a grid, band by band."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import bands
from resample.engine.jit import Counter, inner_kernel, kernel, packed_kernel
from resample.types import Floats

Integers = NDArray[np.int64]

BAND = 32  # rows that a thread filters at a time
BLOCK = 960  # numbers of a row that are summed at a time: whole samples of up to four, and lanes
LANES = 64  # numbers of which loops over lanes leave no rest


@inner_kernel
def _add_pairs(
    line: Floats, source: Floats, start: int, steps: tuple[int, int], count: int, weights: Floats
) -> None:
    """Add whole `LANES` of the stretches on both sides of one, times four weights.

    A rest would be summed in another way, and its bits would depend on where a stretch ends.

    Parameters
    ----------
    steps
        From the middle to the nearest two stretches, and from one to the next; numbers.
    """
    s, t, u, v = weights[0], weights[1], weights[2], weights[3]
    step = np.uint64(steps[1])
    a, b = np.uint64(start - steps[0]), np.uint64(start + steps[0])
    for n in range(count // LANES * LANES):
        k = np.uint64(n)
        # One after the other, as `_add_pair` would.
        c, d, total = a + k, b + k, line[k]
        total += s * (source[c] + source[d])
        total += t * (source[c - step] + source[d + step])
        c, d = c - (step << np.uint64(1)), d + (step << np.uint64(1))
        total += u * (source[c] + source[d])
        total += v * (source[c - step] + source[d + step])
        line[k] = total


@inner_kernel
def _add_pair(line: Floats, source: Floats, at: tuple[int, int], count: int, weight: float) -> None:
    """Add two stretches of a source to a line, times one weight."""
    a, b, w = np.uint64(at[0]), np.uint64(at[1]), np.float32(weight)
    for n in range(count):
        k = np.uint64(n)
        line[k] += w * (source[a + k] + source[b + k])


@inner_kernel
def _filter_stretch(
    line: Floats, source: Floats, start: int, step: int, count: int, taps: Floats
) -> None:
    """Filter a stretch of numbers; the neighbours of taps are `step` numbers apart."""
    # The middle tap initializes the line.
    middle = taps.size // 2
    at, w = np.uint64(start), taps[middle]
    for n in range(count):
        k = np.uint64(n)
        line[k] = w * source[at + k]
    # Symmetric taps share a weight, and so a product.
    for tap in range(1, middle - 2, 4):
        weights = taps[middle + tap : middle + tap + 4]
        _add_pairs(line, source, start, (tap * step, step), count, weights)
    four, rest = middle // 4 * 4, count // LANES * LANES
    for tap in range(1, middle + 1):
        first = rest if tap <= four else 0
        places = start + first - tap * step, start + first + tap * step
        _add_pair(line[first:], source, places, count - first, taps[middle + tap])


class Filters(NamedTuple):
    """Symmetric taps (K,), K odd, along both axes of a plate."""

    across: Floats
    down: Floats


@kernel
def _filter_rows(
    flat: Floats,
    shape: tuple[int, int, int],
    filters: Filters,
    rows: tuple[int, int],
    lanes: int,
    result: Floats,
) -> None:
    """Filter some rows of a plate, down and then across, where all taps lie on the plate."""
    _, columns, channels = shape
    width, margin = columns * channels, filters.across.size // 2
    inner, count = width - 2 * margin * channels, rows[1] - rows[0]
    tall, line = np.empty((count, width), np.float32), np.empty(BLOCK, np.float32)
    # Filter down, block by block, so that the rows of a block stay in the cache.
    for first in range(0, width, BLOCK):
        size = min(BLOCK, width - first)
        for row in range(count):
            start = (rows[0] + row + filters.down.size // 2) * width + first
            _filter_stretch(tall[row, first:], flat, start, width, size, filters.down)
    # Filter across, where all taps lie on the plate.
    for row in range(count):
        to = (rows[0] + row) * (columns - 2 * margin) * lanes
        for first in range(0, inner, BLOCK):
            start, size = margin * channels + first, min(BLOCK, inner - first)
            if lanes == channels:
                _filter_stretch(result[to + first :], tall[row], start, channels, size,
                                filters.across)  # fmt: skip
            else:
                _filter_stretch(line, tall[row], start, channels, size, filters.across)
                _spread(line, 0, size // channels, channels, result, to)
                to += size // channels * lanes


@inner_kernel
def _spread(flat: Floats, at: int, count: int, channels: int, result: Floats, first: int) -> None:
    """Copy samples of two or three numbers to places four numbers apart, filled up with zeros."""
    k, to, step = np.uint64(at), np.uint64(first), np.uint64(channels)
    one, zero = np.uint64(1), np.float32(0)
    for _ in range(count):
        result[to], result[to + one] = flat[k], flat[k + one]
        result[to + one + one] = flat[k + one + one] if channels > 2 else zero
        result[to + one + one + one] = zero
        k += step
        to += np.uint64(4)


@packed_kernel
def filter_plate(
    counter: Counter,
    flat: Floats,
    shape: tuple[int, int, int],
    filters: Filters,
    lanes: int,
    result: Floats,
) -> None:
    """Filter a plate along both axes.

    Parameters
    ----------
    flat
        Rows × columns × channels, given by `shape`.
    filters
        K taps across and L down.
    lanes
        Numbers of a sample in the result: its channels, or four of which the last are zeros.
    result
        As `flat`, filled, with L // 2 rows and K // 2 columns less on each side; it may be longer.
    """
    height = shape[0] - 2 * (filters.down.size // 2)
    for rows in bands(counter, height, BAND):
        _filter_rows(flat, shape, filters, rows, lanes, result)
