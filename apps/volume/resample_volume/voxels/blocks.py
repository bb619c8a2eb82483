"""Small blocks of a volume, and passes over layers of them in one or several processes."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.outofcore import passes
from resample.outofcore.bricks import BrickRequest, Step
from resample.outofcore.passes import PassContext
from resample.types import Doubles
from resample_volume.data.bricks import Bricks

SIDE = 8  # voxels, at least
MOST = 1 << 18  # blocks at most; otherwise their side is doubled
PARTS = 8  # parts of a pass over a volume by several processes, at most
THICK = 2  # layers of bricks per part, at least: slopes also read the adjacent layers

R = TypeVar("R")
Indices = NDArray[np.int64]


class Lattice(NamedTuple):
    """Partition of a volume into blocks."""

    size: Step  # voxels along z, y and x
    side: int  # voxels of a block along each axis

    @property
    def blocks(self) -> Step:
        """Blocks along z, y and x."""
        z, y, x = (-(-size // self.side) for size in self.size)
        return z, y, x

    def counted(self, place: Indices) -> tuple[Indices, Indices]:
        """Return the blocks that contain voxels, by flat index, and their counts."""
        if not place.size:
            return place, place
        at = np.unravel_index(place, self.size)
        z, y, x = (_in_steps(n, self.side) for n in at)
        number = np.ravel_multi_index((z, y, x), self.blocks)
        first = int(number.min())
        count = np.bincount(number - first)
        found = np.flatnonzero(count)
        return found + first, count[found]

    def request(self, number: Indices) -> BrickRequest:
        """Return a request for some of the blocks, as bricks take it."""
        is_requested = np.zeros(self.blocks, bool)
        is_requested.reshape(-1)[number] = True
        return BrickRequest(self.side, is_requested)


def _in_steps(index: Indices, side: int) -> Indices:
    """Divide indices (N,) by a side, fast for powers of two."""
    bits = side.bit_length() - 1
    return index >> bits if side == 1 << bits else index // side


def lattice_for(size: Step) -> Lattice:
    """Partition a volume (Z, Y, X) into a limited number of blocks."""
    lattice = Lattice(size, SIDE)
    while np.prod(lattice.blocks, dtype=float) > MOST:
        lattice = Lattice(size, 2 * lattice.side)
    return lattice


def ends_of(lattice: Lattice, index: Indices) -> tuple[Doubles, Doubles]:
    """Return the first and last voxels (N, 3) of blocks (N,), along x, y and z."""
    at = np.stack(np.unravel_index(index, lattice.blocks)[::-1], axis=1)
    low = (at * lattice.side).astype(np.float64)
    return low, np.minimum(low + lattice.side, lattice.size[::-1]) - 1


def passed(
    bricks: Bricks, lattice: Lattice, job: Callable[[Bricks], R], context: PassContext
) -> list[R]:
    """Run a job on bricks restricted to layers of blocks; return its results in their order."""
    several = max(1, min(PARTS, bricks.count[0] // THICK))
    layers = _layers(bricks, lattice, 1 if context.executor is None else several)
    found = []
    for made, reads in passes.passed(partial(_found, job, bricks, lattice), layers, context):
        bricks.reads += reads
        found.append(made)
    return found


def _layers(bricks: Bricks, lattice: Lattice, parts: int) -> list[tuple[int, int]]:
    """Return ranges of layers of blocks that are scanned together."""
    count = bricks.count[0]
    cuts = {count * n // parts * bricks.side[0] // lattice.side for n in range(parts)}
    ends = [*sorted(cuts), lattice.blocks[0]]
    return [(first, last) for first, last in pairwise(ends) if first < last]


def _found(
    job: Callable[[Bricks], R], bricks: Bricks, lattice: Lattice, layers: tuple[int, int]
) -> tuple[R, int]:
    """Run a job on some layers of blocks; also return the number of bricks read."""
    is_requested = np.zeros(lattice.blocks, bool)
    is_requested[layers[0] : layers[1]] = True
    part = bricks.within(BrickRequest(lattice.side, is_requested))
    return job(part), part.reads
