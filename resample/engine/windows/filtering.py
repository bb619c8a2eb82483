"""Symmetric separable filters on a grid, band by band."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import bands
from resample.engine.jit import Counter, inner_kernel, kernel, packed_kernel
from resample.types import Floats

Integers = NDArray[np.int64]

BAND = 32  # rows that a thread filters at a time
BLOCK = 1024  # numbers of a row that are summed at a time


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
    for tap in range(1, middle + 1):
        places = start - tap * step, start + tap * step
        _add_pair(line, source, places, count, taps[middle + tap])


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
    result: Floats,
) -> None:
    """Filter some rows of a plate, down and then across, where all taps lie on the plate."""
    _, columns, channels = shape
    width, margin = columns * channels, filters.across.size // 2
    inner, count = width - 2 * margin * channels, rows[1] - rows[0]
    tall = np.empty((count, width), np.float32)
    # Filter down, block by block, so that the rows of a block stay in the cache.
    for first in range(0, width, BLOCK):
        size = min(BLOCK, width - first)
        for row in range(count):
            start = (rows[0] + row + filters.down.size // 2) * width + first
            _filter_stretch(tall[row, first:], flat, start, width, size, filters.down)
    # Filter across, where all taps lie on the plate.
    for row in range(count):
        line = result[(rows[0] + row) * inner :]
        for first in range(0, inner, BLOCK):
            start = margin * channels + first
            size = min(BLOCK, inner - first)
            _filter_stretch(line[first:], tall[row], start, channels, size, filters.across)


@packed_kernel
def filter_plate(
    counter: Counter,
    flat: Floats,
    shape: tuple[int, int, int],
    filters: Filters,
    result: Floats,
) -> None:
    """Filter a plate along both axes.

    Parameters
    ----------
    flat
        Rows × columns × channels, given by `shape`.
    filters
        K taps across and L down.
    result
        As `flat`, filled, with L // 2 rows and K // 2 columns less on each side; it may be longer.
    """
    height = shape[0] - 2 * (filters.down.size // 2)
    for rows in bands(counter, height, BAND):
        _filter_rows(flat, shape, filters, rows, result)
