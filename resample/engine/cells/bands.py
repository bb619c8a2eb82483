"""Bands of rows, each painted by one thread, and passes over the cells that meet a band.

Passes go batch by batch, in the order of the source. Visibility takes several: find the nearest
cells, the next ones, and what these leave. The application plays `placed` for the source, which is
projected again in every pass, `take` for every kind of pass, and `skips` for passes that do not
need all members.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, tasks
from resample.engine.roles import plays, role

Bounds = NDArray[Any]  # (..., 4) whole numbers, px: see `LEFT`

# Columns of bounds on the screen; the last two are exclusive.
LEFT, TOP, RIGHT, BOTTOM = range(4)

Source = Any  # bundles of the application's, whose classes select what the roles do
Pass = Any
Batch = Any


@inner_kernel  # as `tasks`
def bands(counter: Counter, height: int, band: int) -> Iterator[tuple[int, int]]:
    """Yield the rows of the bands that a thread paints, first and last + 1."""
    for n in tasks(counter, -(-height // band)):
        yield n * band, min(height, (n + 1) * band)


@kernel
def overlapping(bounds: Bounds, rows: tuple[int, int], width: int) -> NDArray[np.int32]:
    """Indices, in order, of those bounds (N, 4) that meet a band's rows, `width` px wide."""
    found = np.empty(bounds.shape[0], np.int32)
    count = 0
    for n in range(bounds.shape[0]):
        is_met = (bounds[n, TOP] < rows[1]) & (bounds[n, BOTTOM] > rows[0])
        is_met &= (bounds[n, LEFT] < width) & (bounds[n, RIGHT] > 0)
        if is_met:
            found[count] = n
            count += 1
    return found[:count]


@role
def placed(source: Source, member: int, batch: Batch) -> int:
    """Place the cells of a member of the source in a batch; return the number of runs."""
    raise NotImplementedError


@role
def skips(look: Pass, source: Source, member: int, nth: int) -> bool:
    """Whether a pass needs nothing of a member, the `nth` that meets the band."""
    raise NotImplementedError


@plays(skips, object)
def _skips_none(look: Pass, source: Source, member: int, nth: int) -> bool:  # noqa: ARG001
    return False


@role
def take(look: Pass, source: Source, member: int, nth: int, run: int, batch: Batch) -> None:
    """Process a run of the cells of a batch."""
    raise NotImplementedError


@inner_kernel
def walk(look: Pass, source: Source, members: NDArray[np.int32], batch: Batch) -> None:
    """Run a pass over all members of a source that meet a band."""
    # Project only members that the pass needs.
    for nth in range(members.size):
        member = members[nth]
        if not skips(look, source, member, nth):
            for run in range(placed(source, member, batch)):
                take(look, source, member, nth, run, batch)
