"""The loop over parts of a source: each is placed cell by cell on pixels of its own.

What a part is and how its cells are placed is the application's, which plays the roles `begun`,
`lines` and `fill` for a bundle of its own.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.batch import Batch
from resample.engine.cells.taps import Spread, add
from resample.engine.cells.tiles import LEFT, RIGHT
from resample.engine.jit import Counter, inner_kernel, kernel, tasks
from resample.engine.roles import making_role, role
from resample.types import Floats

Integers = NDArray[np.int64]
Source = Any  # a bundle of the application's, whose class settles what the roles do
Work = Any  # likewise, of one part; its field `batch` is a `Batch`


class Parts(NamedTuple):
    """Parts of a source, and the pixels of the target that belong to each."""

    bounds: Integers  # (B, 4) px that the cells of a part may meet: see `tiles.LEFT`
    start: Integers  # (B + 1,) where the sums of each begin
    sums: Floats  # room for all parts' pixels, interleaved channels and weight


@making_role
def begun(source: Source, part: int, spread: Spread) -> Work:
    """What is needed to place a part's cells, with room for a batch of them."""
    raise NotImplementedError


@role
def lines(source: Source, part: int) -> int:
    """How many batches the cells of a part come in."""
    raise NotImplementedError


@role
def fill(source: Source, part: int, line: int, box: Integers, spread: Spread, work: Work) -> int:
    """Place a batch of cells within the pixels `box` (4,) of their part; gives how many."""
    raise NotImplementedError


@inner_kernel
def _clear(sums: Floats, start: int, end: int) -> None:
    for n in range(start, end):
        sums[n] = np.float32(0)


@kernel
def paint_parts(counter: Counter, source: Source, spread: Spread, parts: Parts) -> None:
    """Add the cells of every part to pixels of its own; for an application's parallel kernel."""
    bounds, start, sums = parts
    for n in tasks(counter, bounds.shape[0]):
        box, begin = bounds[n], start[n]
        _clear(sums, begin, start[n + 1])
        work = begun(source, n, spread)
        batch: Batch = work.batch
        for line in range(lines(source, n)):
            count = fill(source, n, line, box, spread, work)
            add(sums, begin, box[RIGHT] - box[LEFT], batch, count, spread)
