"""Bands of rows of the target, each painted by one thread, and what meets a band."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, tasks

Bounds = NDArray[Any]  # (..., 4) whole numbers, px: see `LEFT`

# Columns of bounds on the screen; the last two are exclusive.
LEFT, TOP, RIGHT, BOTTOM = range(4)


@kernel
def bands(counter: Counter, height: int, band: int) -> Iterator[tuple[int, int]]:
    """Yield the rows of the bands that a thread paints, first and last + 1."""
    for n in tasks(counter, -(-height // band)):
        yield n * band, min(height, (n + 1) * band)


@kernel
def overlapping(bounds: Bounds, rows: tuple[int, int], width: int) -> NDArray[np.int32]:
    """Indices, in order, of those bounds (N, 4) that meet a band's rows, `width` px wide."""
    found = np.empty(bounds.shape[0], np.int32)
    count = 0
    for n in range(bounds.shape[0]):
        is_met = (bounds[n, TOP] < rows[1]) & (bounds[n, BOTTOM] > rows[0])
        is_met &= (bounds[n, LEFT] < width) & (bounds[n, RIGHT] > 0)
        if is_met:
            found[count] = n
            count += 1
    return found[:count]
