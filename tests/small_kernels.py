"""Kernels of every kind of argument and result, for tests of the library and of the cache."""

from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import kernel, making_kernel


class Pair(NamedTuple):
    """Two parts of any kind."""

    first: Any
    second: Any


class Sums(NamedTuple):
    """What `sums` finds."""

    total: float
    count: int
    is_large: bool


@kernel
def sums(pair: Any, factor: Any, most: Any = 3) -> Sums:
    """Sum of a bundle's arrays, times a factor."""
    total = 0.0
    for number in pair.first.ravel():
        total += number
    for number in pair.second:
        total += number
    count = pair.first.size + pair.second.size
    return Sums(total * factor, count, total > most)


@making_kernel
def steps(count: int, first: float) -> Any:
    """Numbers from `first` on, in float32, and the same as rows of two."""
    made = np.empty(2 * count, np.float32)
    for n in range(2 * count):
        made[n] = first + n
    return made, made.reshape(count, 2)


@kernel
def copy_into(target: Any, source: Any) -> None:
    """Copy an array; sizes that differ are an error."""
    target[:] = source


@kernel
def nothing(value: Any) -> None:
    """Take anything."""
