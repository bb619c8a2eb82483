"""View-independent facts about a look, found by one scan of all voxels."""

from collections.abc import Callable, Iterator
from functools import partial, reduce
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.passes import PassContext
from resample.types import Doubles
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.types import Volume
from resample_volume.voxels.blocks import Indices, Lattice, lattice_for, passed
from resample_volume.voxels.cropping import Steeps, merged_steeps, steeps_of
from resample_volume.voxels.framing import bounds

FINE = 8  # voxels per side of the bricks that give the order of voxels in memory

Finish = Callable[[Indices, Any], Any]  # of flat indices, and their `Voxels` or `Mixed` voxels
Classified = Callable[[Volume, Finish], Iterator[Any]]  # runs a job on the voxels of bricks


class VisibleBlocks(NamedTuple):
    """What all pictures of one look depend on."""

    steep: Steeps  # of voxels that have gradients
    number: Indices  # (N,) blocks with visible voxels, by flat indices
    visible: Indices  # (N,) how many these are


class VisibleOutline(NamedTuple):
    """Where voxels are visible."""

    blocks: VisibleBlocks
    fine: Indices  # (M,) bricks of `FINE` voxels per side with visible ones, by flat indices
    fine_visible: Indices  # (M,) how many these are
    low: Doubles  # (3,) least coordinates of all, scene units; inf if nothing is visible
    high: Doubles  # (3,) greatest; -inf
    first: Indices  # (3,) least indices along z, y and x
    last: Indices  # (3,) greatest
    densest: float  # greatest optical depth per scene unit

    @property
    def total(self) -> int:
        """Visible voxels."""
        return int(self.blocks.visible.sum())


class OutlineQuery(NamedTuple):
    """Volumes to scan."""

    volume: Volume  # as of `Work`
    classified: Classified
    clip: Doubles  # (M, 4) planes


def outlined(seen: OutlineQuery, context: PassContext) -> VisibleOutline:
    """Scan all voxels once and return where they are visible; a process holds few at a time."""
    bricks = bricks_of(seen.volume)
    lattice = lattice_for(bricks.shape)
    parts = passed(bricks, lattice, partial(_outlined, seen, lattice), context)
    return reduce(_both, parts)


def _outlined(seen: OutlineQuery, lattice: Lattice, bricks: Bricks) -> VisibleOutline:
    """Return the outline of bricks, of the requested layers."""
    fine = lattice._replace(side=FINE)
    steeps: list[Steeps] = []
    count = np.zeros(int(np.prod(fine.blocks)), np.int32)
    low, high = np.full(3, np.inf), np.full(3, -np.inf)

    first, last, densest = np.array(lattice.size), np.full(3, -1), 0.0

    def found(place: Indices, voxels: Any) -> tuple[Any, ...]:
        position, at = voxels.position, np.unravel_index(place, lattice.size)
        sides = np.array([(n.min(), n.max()) for n in at]).T if place.size else None
        box = bounds(position) if place.size else None
        most = float(voxels.extinction.max(initial=0.0))
        return fine.counted(place), box, sides, most, steeps_of(voxels.parts, seen.clip)

    every = seen.classified(with_bricks(seen.volume, bricks), found)
    for (index, more), box, sides, most, own in every:
        count[index] += more.astype(np.int32)
        if box is not None:
            low, high = np.minimum(low, box[0]), np.maximum(high, box[1])
            first, last = np.minimum(first, sides[0]), np.maximum(last, sides[1])
        densest = max(densest, most)
        steeps.append(own)
    small = np.flatnonzero(count)
    steep: Steeps = reduce(merged_steeps, steeps) if steeps else ()
    looked = VisibleBlocks(steep, *_in_blocks(lattice, fine, small, count[small]))
    return VisibleOutline(
        looked, small, count[small].astype(np.int64), low, high, first, last, densest
    )


def _in_blocks(
    lattice: Lattice, fine: Lattice, small: Indices, count: NDArray[np.int32]
) -> tuple[Indices, Indices]:
    """Return a lattice's blocks with visible voxels, and their counts, from a finer lattice."""
    at = [n * fine.side // lattice.side for n in np.unravel_index(small, fine.blocks)]
    total = np.bincount(np.ravel_multi_index(at, lattice.blocks), count)
    number = np.flatnonzero(total)
    return number, total[number].astype(np.int64)


def _both(one: VisibleOutline, other: VisibleOutline) -> VisibleOutline:
    """Merge two outlines."""
    looked, more = one.blocks, other.blocks
    pairs = [
        _summed((looked.number, looked.visible), (more.number, more.visible)),
        _summed((one.fine, one.fine_visible), (other.fine, other.fine_visible)),
    ]
    steep = (
        merged_steeps(looked.steep, more.steep)
        if looked.steep and more.steep
        else (looked.steep or more.steep)
    )
    ends = np.minimum(one.low, other.low), np.maximum(one.high, other.high)
    sides = np.minimum(one.first, other.first), np.maximum(one.last, other.last)
    densest = max(one.densest, other.densest)
    return VisibleOutline(VisibleBlocks(steep, *pairs[0]), *pairs[1], *ends, *sides, densest)


def _summed(
    one: tuple[Indices, Indices], other: tuple[Indices, Indices]
) -> tuple[Indices, Indices]:
    """Add up the counts of equal ascending numbers."""
    index, home = np.unique(np.concatenate([one[0], other[0]]), return_inverse=True)
    total = np.zeros(index.size, np.int64)
    np.add.at(total, home, np.concatenate([one[1], other[1]]))
    return index, total
