"""Several volumes in bricks on one grid of bricks."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_in_file
from resample.outofcore.bricks import Box, BrickRequest, LruCache, Step
from resample.types import Doubles
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.media.lattices import CommonLattice, onto
from resample_volume.media.mixing import mixed_at
from resample_volume.outofcore.classified import Classifying, classified, on_grid
from resample_volume.types import Volume
from resample_volume.voxels.blocks import Indices
from resample_volume.voxels.streaming import (
    Candidates,
    map_bricks,
)
from resample_volume.voxels.visible import Voxels

R = TypeVar("R")


class CombinedBricks:
    """Bricks of several volumes on one grid, with the interface of `Bricks` that windows use."""

    def __init__(
        self,
        parts: Sequence[Bricks],
        found: dict[Any, Any] | None = None,
        recent: "tuple[LruCache, ...] | None" = None,
    ) -> None:
        self.parts, self.recent = tuple(parts), recent
        self.found = {} if found is None else found  # as of `Bricks`
        self._others = 0

    @property
    def reads(self) -> int:
        """Bricks read of all volumes, here and in other processes."""
        return self._others + sum(part.reads for part in self.parts)

    @reads.setter
    def reads(self, count: int) -> None:
        self._others += count - self.reads

    @property
    def shape(self) -> Step:
        """Voxels along z, y and x."""
        return self.parts[0].shape

    @property
    def side(self) -> Step:
        """Voxels of a brick."""
        return self.parts[0].side

    @property
    def count(self) -> Step:
        """Bricks along z, y and x."""
        return self.parts[0].count

    @property
    def bytes_each(self) -> int:
        """Bytes of a brick of all of them."""
        return sum(part.bytes_each for part in self.parts)

    def pin_bricks(self, most: int) -> None:
        """Do as `Bricks.pin_bricks`, with shares of these bytes."""
        for part in self.parts:
            part.pin_bricks(most // len(self.parts))

    @property
    def pinned_bytes(self) -> int:
        """Limit in bytes of the pinned bricks of all of them."""
        return sum(part.pinned_bytes for part in self.parts)

    def within(
        self, request: BrickRequest | None, recent: "LruCache | tuple[LruCache, ...] | None" = None
    ) -> "CombinedBricks":
        """Do as `Bricks.within`."""
        if isinstance(recent, LruCache):
            recent = tuple(LruCache(recent.most // len(self.parts)) for _ in self.parts)
        each = [None] * len(self.parts) if recent is None else recent
        parts = [part.within(request, own) for part, own in zip(self.parts, each, strict=True)]
        return CombinedBricks(parts, self.found, recent)

    def __getstate__(self) -> dict[str, Any]:
        return self.__dict__ | {"found": {}, "recent": None}


@dataclass(eq=False)
class InGrid(Bricks):
    """Bricks of a volume inside a larger lattice, in the lattice's coordinates."""

    own: Box = (slice(0, 0), slice(0, 0), slice(0, 0))  # of the lattice's voxels

    @property
    def limits(self) -> Box:
        return self.own

    def pin_bricks(self, most: int) -> None:
        self._inner.pin_bricks(most)

    @property
    def pinned_bytes(self) -> int:
        return self._inner.pinned_bytes

    @property
    def _inner(self) -> Bricks:
        """Bricks of the volume itself."""
        assembled: Any = self.read
        bricks: Bricks = assembled.bricks
        return bricks

    def box(self, index: Step) -> Box:
        parts = zip(super().box(index), self.own, strict=True)
        ends = [(max(box.start, own.start), min(box.stop, own.stop)) for box, own in parts]
        z, y, x = (slice(start, max(start, stop)) for start, stop in ends)
        return z, y, x


@dataclass(frozen=True, eq=False)
class Assembled:
    """Reads boxes of a lattice from bricks of a volume inside it."""

    bricks: Bricks
    first: Step  # of the lattice's voxels, where the volume begins

    def __call__(self, box: Box) -> NDArray[Any]:
        """Values (Z, Y, X) of a box."""
        shifts = zip(box, self.first, strict=True)
        return self.bricks.part(tuple(slice(p.start - n, p.stop - n) for p, n in shifts))


def in_grid(bricks: Bricks, first: Step, size: tuple[int, int, int], side: Step) -> Bricks:
    """Return bricks of a volume, whose first voxel is at an index, on the grid of a lattice."""
    if first == (0, 0, 0) and (size, side) == (bricks.shape, bricks.side):
        return bricks
    z, y, x = (slice(n, n + own) for n, own in zip(first, bricks.shape, strict=True))
    part = InGrid(
        Assembled(bricks, first),
        size,
        bricks.dtype,
        side,
        found=bricks.found,
        memory=bricks.memory,
        own=(z, y, x),
    )
    part.__dict__["ends"] = _ends(bricks, part)
    return part


def _ends(bricks: Bricks, part: InGrid) -> tuple[Doubles, Doubles]:
    """Return the least and greatest value of the bricks that overlap each brick of a grid."""
    least, greatest = bricks.ends
    for axis, (own, side, count) in enumerate(zip(part.own, part.side, part.count, strict=True)):
        rows = []
        for n in range(count):
            start = max(n * side, own.start) - own.start
            stop = min((n + 1) * side, own.stop) - own.start
            step = bricks.side[axis]
            rows.append(slice(start // step, (stop - 1) // step + 1) if start < stop else None)
        least = _joined(least, rows, axis, np.minimum, np.inf)
        greatest = _joined(greatest, rows, axis, np.maximum, -np.inf)
    return least, greatest


def _joined(
    ends: Doubles, rows: Sequence[slice | None], axis: int, join: np.ufunc, nothing: float
) -> Doubles:
    """Merge ends over ranges of rows along an axis; an empty range gives no values."""
    each = np.moveaxis(ends, axis, 0)
    none = np.full(each.shape[1:], nothing)
    found = [none if row is None else join.reduce(each[row], axis=0) for row in rows]
    return np.stack(found, axis)


@dataclass(frozen=True, eq=False)
class ArrayBoxes:
    """Reads boxes of an array of this process."""

    values: NDArray[Any]

    def __call__(self, box: Box) -> NDArray[Any]:
        """Values (Z, Y, X) of a box."""
        return np.ascontiguousarray(self.values[box])

    def __reduce__(self) -> str:
        raise ValueError(
            "a resampled volume can only be painted by the process that resampled it; leave "
            "workers out, or resample the volume beforehand"
        )


def resampled_bricks(volume: Volume, lattice: CommonLattice, most: int) -> Volume:
    """Resample a volume in bricks to a lattice, in a file with at most so many bytes in memory."""
    bricks = bricks_of(volume)
    values = array_in_file(bricks.shape, bricks.dtype, most, volume.name)
    bricks.put_into(values)
    there = onto(volume._replace(values=values), lattice)
    shape, kind = there.values.shape, there.values.dtype
    size = shape[0], shape[1], shape[2]
    in_file = Bricks(ArrayBoxes(there.values), size, kind, bricks.side, memory=bricks.memory)
    return with_bricks(there, in_file)


class Member(NamedTuple):
    """One of several volumes, and how it is classified."""

    volume: Volume  # in bricks, placed in the scene
    by: Classifying
    first: Step  # index of its first voxel in the common lattice


def classified_by_bricks(
    bricks: Sequence[Bricks],
    lattice: CommonLattice | None,
    members: Sequence[Member],
    cut: Callable[[Indices, Voxels], tuple[Indices, Voxels]],
    finish: Callable[[Indices, Any], R],
) -> Iterator[R]:
    """Run a job on the visible voxels of one volume, or of several on a lattice, brick by brick.

    `cut` removes voxels of one. The job gets flat indices (N,) and `Voxels`, or `MixedMedia`; it
    runs on several bricks at a time.
    """
    shape = bricks[0].shape
    parts = [
        on_grid(own, volume, by.transfer, by.gradient)
        for own, (volume, by, _) in zip(bricks, members, strict=True)
    ]

    def job(found: list[Candidates], boxes: list[Box]) -> R:
        each = []
        for (volume, by, first), part, seen, box in zip(members, parts, found, boxes, strict=True):
            own = tuple(slice(p.start - n, p.stop - n) for p, n in zip(box, first, strict=True))
            size, data_range = volume.values.shape, part.wanted.data_range
            moved = seen._replace(place=_moved(seen.place, shape, size, first, -1))
            place, voxels = cut(*classified(volume, by, data_range, moved, own))
            each.append((_moved(place, size, shape, first, 1), voxels))
        return finish(*(each[0] if lattice is None else mixed_at(each, lattice)))

    return map_bricks(parts, job)


def _moved(place: Indices, size: Step, to: Step, first: Step, sign: int) -> Indices:
    """Convert flat indices (N,) between lattices, one of which begins within the other."""
    if size == to:
        return place
    at = np.unravel_index(place, size)
    moved = [n + sign * start for n, start in zip(at, first, strict=True)]
    return np.asarray(np.ravel_multi_index(moved, to), np.int64)
