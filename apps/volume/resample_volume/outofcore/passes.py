"""Passes over all voxels of a volume in bricks, layer by layer, in one or several processes."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from resample.watching import Executor, Progress, shared_out, told
from resample_volume.data.bricks import BrickRequest, Bricks
from resample_volume.voxels.fields import Lattice

PARTS = 8  # parts of a pass over a volume by several processes, at most
THICK = 2  # layers of bricks per part, at least: slopes also read the adjacent layers

R = TypeVar("R")


class PassContext(NamedTuple):
    """Executor, threads and progress of a pass."""

    executor: Executor | None = None  # runs parts; None: all run in this process
    threads: int | None = None  # of each process
    tell: Progress | None = None  # called with the fraction done, 0 to 1


def passed(
    bricks: Bricks, lattice: Lattice, job: Callable[[Bricks], R], looking: PassContext
) -> list[R]:
    """Run a job on layers of blocks, and return its results in their order.

    Parameters
    ----------
    job
        Called with bricks restricted to some layers. Must be picklable for other processes.
    """
    several = max(1, min(PARTS, bricks.count[0] // THICK))
    layers = _layers(bricks, lattice, 1 if looking.executor is None else several)
    common = partial(_found, job, bricks, lattice, looking.threads)
    found, parts = [], shared_out(looking.executor, common, layers)
    for n in range(len(layers)):
        first, last = (at / len(layers) for at in (n, n + 1))
        with told(None if looking.tell is None else between(looking.tell, first, last)):
            made, reads = next(parts)
        bricks.reads += reads
        found.append(made)
    return found


def between(tell: Progress, first: float, last: float) -> Progress:
    """Return a progress callback for a part of the work."""
    return lambda share: tell(first + (last - first) * share)


def _layers(bricks: Bricks, lattice: Lattice, parts: int) -> list[tuple[int, int]]:
    """Return ranges of layers of blocks that are scanned together."""
    count = bricks.count[0]
    cuts = [count * n // parts * bricks.side[0] // lattice.side for n in range(parts)]
    ends = [*sorted(set(cuts)), lattice.blocks[0]]
    return [(first, last) for first, last in pairwise(ends) if first < last]


def _found(
    job: Callable[[Bricks], R],
    bricks: Bricks,
    lattice: Lattice,
    count: int | None,
    layers: tuple[int, int],
) -> tuple[R, int]:
    """Run a job on some layers of blocks; also return the number of bricks read."""
    from resample.engine.jit import threads

    is_requested = np.zeros(lattice.blocks, bool)
    is_requested[layers[0] : layers[1]] = True
    part = bricks.within(BrickRequest(lattice.side, is_requested))
    with threads(count):
        return job(part), part.reads
