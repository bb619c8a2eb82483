"""The loop over parts of a source: each is placed cell by cell on pixels of its own.

The application says what a part is and how its cells are placed: for a bundle of its own it plays
the roles `begun`, `lines` and `fill`, and `stamp` where a line holds more than cells.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.cells.sums import offsets
from resample.engine.cells.taps import FilterTaps, add
from resample.engine.jit import Counter, inner_kernel, kernel, tasks
from resample.engine.roles import called_role, making_role, plays, role
from resample.engine.surfaces.stamps import Ground
from resample.types import Floats

Integers = NDArray[np.int64]
Source = Any  # a bundle of the application's, whose class selects what the roles do
Work = Any  # likewise, of one part; its field `batch` is a `Batch`

BATCH = 1 << 25  # numbers that parts may hold at a time


class SourceParts(NamedTuple):
    """Parts of a source, and the pixels of the target that belong to each."""

    bounds: Integers  # (B, 4) px that the cells of a part may meet: see `bands.LEFT`
    start: Integers  # (B + 1,) where the sums of each begin
    sums: Floats  # all parts' pixels, channels and weight interleaved


@making_role
def begun(source: Source, part: int) -> Work:
    """Set up what a part's cells are placed with, and scratch for a batch of them."""
    raise NotImplementedError


@role
def lines(source: Source, part: int) -> int:
    """Number of batches that the cells of a part come in."""
    raise NotImplementedError


@role
def fill(
    source: Source, part: int, line: int, box: Integers, spread: FilterTaps, work: Work
) -> int:
    """Place a batch of cells within the pixels `box` (4,) of their part; return how many."""
    raise NotImplementedError


@called_role
def stamp(work: Work, ground: Ground) -> None:
    """Add the splats that were placed with a batch of cells."""
    raise NotImplementedError


@plays(stamp, object)
def _stamp(work: Work, ground: Ground) -> None:
    pass


@inner_kernel
def _paint_part(
    source: Source, part: int, spread: FilterTaps, parts: SourceParts, work: Work
) -> None:
    """Add the cells of one part to its pixels."""
    # Clear the part's pixels.
    box, begin, sums = parts.bounds[part], parts.start[part], parts.sums
    for n in range(begin, parts.start[part + 1]):
        sums[n] = np.float32(0)
    width, batch = box[RIGHT] - box[LEFT], work.batch
    ground = Ground(sums, begin, width, box[BOTTOM] - box[TOP])
    # Place and add its cells, batch by batch.
    for line in range(lines(source, part)):
        count = fill(source, part, line, box, spread, work)
        stamp(work, ground)
        add(sums, begin, width, batch, count, spread)


@kernel
def paint_parts(counter: Counter, source: Source, spread: FilterTaps, parts: SourceParts) -> None:
    """Add every part to its own pixels; for an application's parallel kernel."""
    for n in tasks(counter, parts.bounds.shape[0]):
        _paint_part(source, n, spread, parts, begun(source, n))


def parts_of(bounds: Integers, lanes: int) -> SourceParts:
    """Allocate the sums of parts that meet the pixels `bounds` (B, 4)."""
    # Lay the parts out one behind the other.
    start = offsets(bounds, lanes)
    return SourceParts(bounds, start, np.empty(start[-1], np.float32))


def batches(bounds: Integers, lanes: int) -> Iterator[slice]:
    """Yield consecutive parts whose pixels fit in memory together."""
    start = offsets(bounds, lanes)
    first = 0
    while first < len(bounds):
        # Find the last part that fits; one part is always taken.
        last = int(np.searchsorted(start, start[first] + BATCH, side="right")) - 1
        last = min(max(last, first + 1), len(bounds))
        yield slice(first, last)
        first = last


def channel_groups(channels: int) -> list[tuple[int, int]]:
    """Split channels into groups (first, count) of three, and the rest one by one, for kernels."""
    threes = [(first, 3) for first in range(0, channels - 2, 3)]
    return threes + [(first, 1) for first in range(3 * len(threes), channels)]
