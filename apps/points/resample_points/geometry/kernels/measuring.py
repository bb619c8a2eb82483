"""Normals and discs of all points of a cloud, from the neighbours of each."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_points.geometry.kernels.cells import Nearest, Spaced, measure
from resample_points.geometry.kernels.lines import no_lines
from resample_points.geometry.kernels.neighbours import (
    GROUP,
    PointBlocks,
    nearest_neighbours,
    search,
)

BATCH_SIZE = 2048  # points that a thread takes at a time
MARGIN = 1.15  # factor from the squared distance that was enough to the next guess


class NeighbourCounts(NamedTuple):
    """Numbers of neighbours to find, each point included as its own first one."""

    few: int
    many: int  # for points around which the few leave a gap


@kernel
def _measure_blocks(
    blocks: PointBlocks,
    wanted: NeighbourCounts,
    chunk: int,
    normal: Floats,
    discs: Spaced,
    nearest: Nearest,
) -> None:
    """Measure the points of consecutive blocks."""
    few, many = search(wanted.few), search(wanted.many)
    lines, likely, wider = no_lines(), 0.0, 0.0
    place, is_last = blocks.place, wanted.few == wanted.many
    start = int(np.int64(chunk)) * BATCH_SIZE
    for first in range(start, min(start + BATCH_SIZE, place.shape[0]), GROUP):
        # Find few neighbours of a group of points.
        count, gaps = min(GROUP, place.shape[0] - first), 0
        for row in range(count):
            few.which[row] = first + row
        likely = MARGIN * nearest_neighbours(blocks, count, likely, few)
        # Measure the points, and collect those with a gap around.
        for row in range(count):
            for k in range(nearest.shape[1]):
                nearest[first + row, k] = few.found[row, k + 1]
            if measure(place, few.found, row, is_last, lines, normal, discs) and not is_last:
                many.which[gaps] = first + row
                gaps += 1
        # Measure these with more neighbours.
        if gaps > 0:
            wider = MARGIN * nearest_neighbours(blocks, gaps, wider, many)
            for row in range(gaps):
                measure(place, many.found, row, True, lines, normal, discs)


@parallel_kernel
def measure_all(
    counter: Counter,
    blocks: PointBlocks,
    wanted: NeighbourCounts,
    normal: Floats,
    discs: Spaced,
    nearest: Nearest,
) -> None:
    """Measure the normals and discs of all points.

    `blocks`: N points along a Morton curve. `wanted`: at most N neighbours. `normal`: (N, 3) scaled
    to unit length; filled where it is 0, with an arbitrary sign. `discs`: filled. `nearest`: (N,
    few − 1) filled: the neighbours of each point, without itself.
    """
    for chunk in tasks(counter, (blocks.place.shape[0] + BATCH_SIZE - 1) // BATCH_SIZE):
        _measure_blocks(blocks, wanted, chunk, normal, discs, nearest)
