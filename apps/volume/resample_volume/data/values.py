"""Values of a volume, whether an array in memory or bricks in a file.

An array is one brick. Code that only reads values asks `values_of` for them; code that works brick
by brick asks for `bricks_of`.
"""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import prod
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from resample.memory import amount
from resample.memory.mapped import array_in_file, array_like, folder
from resample.outofcore.bricks import Box
from resample.painting.splines import bytes_of_field
from resample_volume.data.bricks import Bricks
from resample_volume.data.memory import require_memory
from resample_volume.data.parts import slabs
from resample_volume.data.scanning import count_codes, finite_outside, step_of
from resample_volume.types import Volume

LOG = logging.getLogger("resample")

Stored = NDArray[Any] | Bricks  # what a volume holds


@dataclass(frozen=True, eq=False)
class ArrayValues:
    """An array in memory, with what `Bricks` tell of their values."""

    array: NDArray[Any]
    bytes_to_load = 0

    @property
    def shape(self) -> tuple[int, int, int]:
        z, y, x = self.array.shape
        return z, y, x

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.array.dtype

    def read(self, box: Box, /) -> NDArray[Any]:
        return self.array[box]

    def whole(self) -> NDArray[Any]:
        return self.array

    def parts(self) -> Iterator[NDArray[Any]]:
        return slabs(self.array)

    def range(self) -> tuple[float, float]:
        low, high = np.inf, -np.inf
        for chunk in slabs(self.array):
            finite = chunk if self.dtype.kind in "iu" else chunk[np.isfinite(chunk)]
            if finite.size:
                low, high = min(low, float(finite.min())), max(high, float(finite.max()))
        return low, high

    def sample(self) -> NDArray[Any]:
        step = step_of(self.array.size)
        return self.array[::step, ::step, ::step]

    def border(self) -> NDArray[Any]:
        sides = [self.array.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
        return np.concatenate(sides)

    def outside(self, low: float, high: float) -> tuple[NDArray[Any], int]:
        return finite_outside(self.parts(), low, high)

    def codes(self) -> NDArray[np.int64]:
        total = np.zeros(1 << (self.dtype.itemsize * 8), np.int64)
        for part in self.parts():
            total += count_codes(part, of=prod(self.shape))
        return total

    def unique(self) -> set[int]:
        return {int(value) for part in self.parts() for value in np.unique(part)}

    def without(self, padding: Sequence[float], by: Any, name: str, /) -> NDArray[Any]:
        given, is_whole = self.array, self.dtype.kind in "iu"
        values = array_like(given, given.shape, given.dtype, name)
        for slab, with_padding in zip(slabs(values), slabs(given), strict=True):
            slab[:] = with_padding
            slab[np.isin(slab, padding)] = by
            if not is_whole:
                slab[np.isinf(slab)] = np.nan
        return values


def streamed(stored: object) -> Bricks | None:
    """Return values that stay in their file; None if these do not."""
    return stored if isinstance(stored, Bricks) else None


def values_of(stored: Stored) -> ArrayValues | Bricks:
    """Return values with what can be asked of arrays and of bricks alike."""
    bricks = streamed(stored)
    return ArrayValues(cast("NDArray[Any]", stored)) if bricks is None else bricks


def bricks_of(volume: Volume) -> Bricks:
    """Return the bricks of a volume."""
    stored: Any = volume.values
    if isinstance(stored, np.ndarray):
        raise TypeError(f"{volume.name} is in memory, not in bricks")
    return cast("Bricks", stored)


def with_bricks(volume: Volume, bricks: Any) -> Volume:
    """Return a volume with other bricks, or with what has their interface."""
    return volume._replace(values=bricks)


def is_streamed(volume: Volume) -> bool:
    """Return whether a volume's values stay in their file."""
    return streamed(volume.values) is not None


def as_arrays(volumes: Sequence[Volume]) -> list[Volume]:
    """Do as `as_array` for the volumes of a scene, which share the memory limit by their sizes."""
    sizes = [values_of(volume.values).bytes_to_load for volume in volumes]
    found = []
    for volume, size in zip(volumes, sizes, strict=True):
        bricks = streamed(volume.values)
        if bricks is not None and bricks.memory is not None:
            share = bricks.memory * size // sum(sizes)
            bricks = replace(bricks.anew(), memory=share)
        found.append(as_array(volume if bricks is None else with_bricks(volume, bricks)))
    return found


def as_array(volume: Volume) -> Volume:
    """Return the volume with its values as an array, also if they are bricks.

    If they and a field of them may not fit in memory, they are in a mapped file
    (`resample.memory.mapped`). Its pages get the memory that a field leaves, at least a quarter.
    """
    if not is_streamed(volume):
        return volume
    bricks = bricks_of(volume)
    size = bricks.bytes_to_load
    made = bytes_of_field(bricks.shape, bricks.dtype)
    if bricks.memory is None or size + made <= bricks.memory:
        require_memory(size, volume.name)
        return volume._replace(values=bricks.whole())
    beside = bytes_of_field(bricks.shape, bricks.dtype, bricks.memory)
    pages = bricks.memory - beside
    if pages < bricks.memory // 4:
        raise ValueError(
            f"{volume.name} is needed as a whole for this, with at least "
            f"{amount(beside * 4 // 3)} of memory and a file for the rest; "
            f"{amount(bricks.memory)} are allowed: give more memory or a coarser level"
        )
    most = pages // 2  # more are in memory until others are released
    values = array_in_file(bricks.shape, bricks.dtype, most, volume.name)
    LOG.info(
        "%s is needed as a whole and does not fit in %s of memory: it and its field are in a "
        "temporary file of %s",
        *(volume.name, amount(bricks.memory), folder()),
    )
    bricks.put_into(values)
    bricks.pin_bricks(0)  # they are all in the file now
    return volume._replace(values=values)
