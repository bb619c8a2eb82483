"""Looks at all voxels of a volume in bricks, some layers at a time: here, or by several."""

from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import NamedTuple, TypeVar

import numpy as np

from resample.watching import Executor, Progress, shared_out, told
from resample_volume.data.bricks import Asked, Bricks
from resample_volume.voxels.blocks import Lattice

PARTS = 8  # in which several processes look at a volume, at most
THICK = 2  # layers of bricks of a part, at least: slopes ask for those beside it, too

R = TypeVar("R")


class Looking(NamedTuple):
    """Who looks at voxels, and who is told of it."""

    executor: Executor | None = None  # does parts of it; None: all is done here
    threads: int | None = None  # that a process takes
    tell: Progress | None = None  # called with the share that was looked at


def passed(
    bricks: Bricks, lattice: Lattice, job: Callable[[Bricks], R], looking: Looking
) -> list[R]:
    """What a job finds in layers of blocks, in their order.

    Parameters
    ----------
    bricks
        Values; what is read of them is counted.
    lattice
        Of blocks.
    job
        Of bricks of which some layers are asked for. For other processes it has to pickle.
    looking
        Who does it.
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
    """Tells the share of a part of the work."""
    return lambda share: tell(first + (last - first) * share)


def _layers(bricks: Bricks, lattice: Lattice, parts: int) -> list[tuple[int, int]]:
    """Layers of blocks, from one to before another, that are looked at together."""
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
    """What a job finds in some layers of blocks, and how many bricks were read."""
    from resample.engine.jit import threads

    is_asked = np.zeros(lattice.blocks, bool)
    is_asked[layers[0] : layers[1]] = True
    part = bricks.within(Asked(lattice.side, is_asked))
    with threads(count):
        return job(part), part.reads
