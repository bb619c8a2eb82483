"""List the existing chunks of an array, so that missing ones are not looked up one by one.

A missing chunk has the fill value. A folder or zip file lists all names at once, so that millions
of missing chunks cost nothing.
"""

import logging
import re
from collections.abc import Sequence
from functools import cache
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory import amount
from resample.reading.limits import SIMILAR_FRAMES, limits, refused

MOST = 1 << 32  # chunks in the table, of which only used pages take memory
FEW = 4  # if at most one chunk in so many exists, they are read one by one
NUMBER = re.compile(r"\d{1,12}")

Selection = Sequence[slice | int]  # along each axis; slices have both ends


class Holes(NamedTuple):
    """Missing chunks of an array."""

    missing: int  # chunks, or shards
    total: int  # number of all
    is_there: NDArray[np.bool_] | None  # by chunk index; None: all exist, or it is unknown

    def message(self, fill: Any) -> str:
        """Message about missing chunks; empty if there are none."""
        if not self.missing:
            return ""
        return (
            f"{self.missing} of {self.total} chunks are missing and are drawn as the fill value "
            f"{fill}"
        )


@cache
def warned(line: str) -> None:
    """Show a warning once, however often a picture is opened."""
    logging.getLogger("resample").warning("%s", line)


def holes_of(array: Any, name: str) -> Holes:
    """Find missing chunks of a zarr array in a folder or zip file.

    Other stores cannot list them.
    """
    sides = _sides(array)
    grid = tuple(-(-size // side) for size, side in zip(array.shape, sides, strict=True))
    count = prod(grid)
    names = array.store.names(array.path, len(grid) + 1)  # of a `GuardedStore`
    if names is None:
        return Holes(0, count, None)
    there = [index for index in (_index(array, name, grid) for name in names) if index is not None]
    missing = count - len(there)
    if not missing:
        return Holes(0, count, None)
    _check_claims(array, name, Holes(missing, count, None), there)
    if count > MOST:
        return Holes(missing, count, None)
    is_there = np.zeros(grid, np.bool_)
    if there:
        is_there[tuple(np.array(there).T)] = True
    return Holes(missing, count, is_there)


def values_of(array: Any, holes: Holes | None, chosen: Selection) -> NDArray[Any]:
    """Read a part of an array without looking up missing chunks."""
    if holes is None or holes.is_there is None:
        return np.asarray(array[tuple(chosen)])
    sides = _sides(array)
    ends = [(at.start, at.stop) if isinstance(at, slice) else (at, at + 1) for at in chosen]
    touched = tuple(
        slice(first // side, -(-last // side))
        for (first, last), side in zip(ends, sides, strict=True)
    )
    part = holes.is_there[touched]
    if part.size == 0 or part.sum() * FEW > part.size:
        return np.asarray(array[tuple(chosen)])
    fill = 0 if array.fill_value is None else array.fill_value
    found = np.full([last - first for first, last in ends], fill, array.dtype)
    for index in np.argwhere(part):
        own = [
            (max(first, (n + at.start) * side), min(last, (n + at.start + 1) * side))
            for n, at, side, (first, last) in zip(index.tolist(), touched, sides, ends, strict=True)
        ]
        target = tuple(
            slice(a - first, b - first) for (a, b), (first, _) in zip(own, ends, strict=True)
        )
        found[target] = array[tuple(slice(*pair) for pair in own)]
    alone = tuple(n for n, at in enumerate(chosen) if not isinstance(at, slice))
    return found.squeeze(alone)


def _sides(array: Any) -> tuple[int, ...]:
    """Elements of a chunk, or shard, along each axis."""
    sides: tuple[int, ...] = getattr(array, "shards", None) or array.chunks
    return sides


def _index(array: Any, name: str, grid: tuple[int, ...]) -> tuple[int, ...] | None:
    """Index of the chunk in a file of this name; None for other files."""
    index = tuple(int(word) for word in NUMBER.findall(name))[-len(grid) :]
    is_within = len(index) == len(grid) and all(
        n < size for n, size in zip(index, grid, strict=True)
    )
    return index if is_within and array.metadata.encode_chunk_key(index) == name else None


def _check_claims(array: Any, name: str, holes: Holes, there: list[tuple[int, ...]]) -> None:
    """Reject an array of gigabytes by its metadata, most of whose chunks are missing."""
    known = limits()
    claimed = holes.missing * prod(_sides(array)) * array.dtype.itemsize
    if claimed <= known.unpacked:
        return
    keys = (f"{array.path}/{array.metadata.encode_chunk_key(index)}" for index in there)
    stored = sum(array.store.size(key.lstrip("/")) or 0 for key in keys)
    if claimed > SIMILAR_FRAMES * known.ratio * max(1, stored):
        found = (
            f"{amount(stored)} exist of {holes.total} chunks; {holes.missing} "
            f"({amount(claimed)}) are missing"
        )
        raise refused(name, found, "ratio")
