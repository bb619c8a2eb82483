"""Levels of integers to numbers and back by tables, on all threads."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, parallel_kernel, tasks
from resample.types import Floats

STRETCH = 1 << 15  # numbers that one thread takes at a time


@parallel_kernel
def look_up(counter: Counter, table: Floats, levels: NDArray[Any], values: Floats) -> None:
    """Put what levels (N,) stand for by a table into values (N,)."""
    for n in tasks(counter, -(-levels.size // STRETCH)):
        for k in range(n * STRETCH, min((n + 1) * STRETCH, levels.size)):
            values[k] = table[np.uint64(levels[k])]


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
