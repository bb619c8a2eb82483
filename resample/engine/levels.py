"""Levels of integers to numbers and back by tables, on all threads."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, parallel_kernel, tasks
from resample.types import Floats

STRETCH = 1 << 15  # numbers that one thread takes at a time


class ShortOrLong(NamedTuple):
    """Levels of one of two types; there are none of the other."""

    short: NDArray[np.uint8]  # (N,) or (0,)
    long: NDArray[np.uint16]  # (0,) or (N,)


def levels_of(given: NDArray[Any]) -> ShortOrLong:
    """Levels (N,) of either type, as one kernel takes both."""
    if given.dtype == np.uint8:
        return ShortOrLong(given, np.empty(0, np.uint16))
    return ShortOrLong(np.empty(0, np.uint8), given)


@parallel_kernel
def look_up(counter: Counter, table: Floats, levels: ShortOrLong, values: Floats) -> None:
    """Put what levels (N,) stand for by a table into values (N,)."""
    for n in tasks(counter, -(-values.size // STRETCH)):
        first, last = n * STRETCH, min((n + 1) * STRETCH, values.size)
        if levels.short.size > 0:
            for k in range(first, last):
                values[k] = table[np.uint64(levels.short[k])]
        else:
            for k in range(first, last):
                values[k] = table[np.uint64(levels.long[k])]


@parallel_kernel
def put_levels(
    counter: Counter, table: NDArray[np.uint8], values: Floats, levels: NDArray[np.uint8]
) -> None:
    """Put levels (N,) of values (N,), cut off at 0 and 1, for which a table has equal steps."""
    most = np.float32(table.size - 1)
    for n in tasks(counter, -(-values.size // STRETCH)):
        for k in range(n * STRETCH, min((n + 1) * STRETCH, values.size)):
            value = min(max(values[k], np.float32(0)), np.float32(1))  # not a number is 0
            levels[k] = table[np.uint64(np.int32(value * most + np.float32(0.5)))]
