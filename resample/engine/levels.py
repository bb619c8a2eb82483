"""Convert integer levels to values and back by tables, on all threads."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, parallel_kernel, tasks
from resample.types import Floats

STRETCH = 1 << 15  # numbers per task
ONE, INFINITE = 0x3F800000, 0x7F800000  # bits of float32


class ShortOrLong(NamedTuple):
    """Levels of one of two types; the other array is empty."""

    short: NDArray[np.uint8]  # (N,) or (0,)
    long: NDArray[np.uint16]  # (0,) or (N,)


def levels_of(given: NDArray[Any]) -> ShortOrLong:
    """Put levels (N,) of either type into one bundle for one kernel."""
    if given.dtype == np.uint8:
        return ShortOrLong(given, np.empty(0, np.uint16))
    return ShortOrLong(np.empty(0, np.uint8), given)


@parallel_kernel
def decode(counter: Counter, table: Floats, levels: ShortOrLong, values: Floats) -> None:
    """Look levels (N,) up in a table, into values (N,)."""
    for n in tasks(counter, -(-values.size // STRETCH)):
        first, last = n * STRETCH, min((n + 1) * STRETCH, values.size)
        # One loop per type; the other array is empty.
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
    """Quantize values (N,), clamped to 0..1, to levels (N,) by a table of equal steps."""
    most = np.float32(table.size - 1)
    for n in tasks(counter, -(-values.size // STRETCH)):
        for k in range(n * STRETCH, min((n + 1) * STRETCH, values.size)):
            # Clamp; NaN becomes 0.
            value = min(max(values[k], np.float32(0)), np.float32(1))
            levels[k] = table[np.uint64(np.int32(value * most + np.float32(0.5)))]


@parallel_kernel
def put_encoded(
    counter: Counter, bounds: NDArray[np.int32], starts: NDArray[np.uint8],
    bits: NDArray[np.int32], levels: NDArray[np.uint8],
) -> None:  # fmt: skip
    """Quantize float32 values (N,), given by their bits, to levels (N,) with any bounds.

    `bounds`: bits of the least value above each level, (256,). `starts`: the level of values by
    their leading 16 bits; each bin holds one bound at most.
    """
    for n in tasks(counter, -(-levels.size // STRETCH)):
        for k in range(n * STRETCH, min((n + 1) * STRETCH, levels.size)):
            # Clamp to 0..1; NaN becomes 0.
            value = min(bits[k], ONE) if 0 < bits[k] <= INFINITE else 0
            level = np.uint64(starts[np.uint64(value >> 16)])
            levels[k] = level + np.uint64(value >= bounds[level])


@parallel_kernel
def bend(counter: Counter, table: Floats, values: Floats, bent: Floats) -> None:
    """Look values (N,) up in a table over 0..1, linear between its steps and beyond its ends."""
    last = table.size - 2
    for n in tasks(counter, -(-values.size // STRETCH)):
        for k in range(n * STRETCH, min((n + 1) * STRETCH, values.size)):
            place = values[k] * np.float32(table.size - 1)
            step = min(max(int(place), 0), last)
            part = place - np.float32(step)
            bent[k] = table[step] + part * (table[step + 1] - table[step])
