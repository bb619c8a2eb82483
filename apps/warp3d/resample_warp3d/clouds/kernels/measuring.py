"""Normals and discs of all points of a cloud, by the neighbours of each."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_warp3d.clouds.kernels.cells import Nearest, Spaced, measure
from resample_warp3d.clouds.kernels.lines import no_lines
from resample_warp3d.clouds.kernels.neighbours import GROUP, PointBlocks, look_around, search

TOGETHER = 2048  # points that a thread takes at a time
MARGIN = 1.15  # times the square of a distance that was enough, the next may need


class Wanted(NamedTuple):
    """How many neighbours are looked up, each point its own first one."""

    few: int
    many: int  # of points around which the few leave a gap


@kernel
def _measure_blocks(
    blocks: PointBlocks, wanted: Wanted, chunk: int, normal: Floats, discs: Spaced, nearest: Nearest
) -> None:
    """Measure the points of some blocks that follow each other."""
    few, many = search(wanted.few), search(wanted.many)
    lines, likely, wider = no_lines(), 0.0, 0.0
    place, is_last = blocks.place, wanted.few == wanted.many
    start = int(np.int64(chunk)) * TOGETHER
    for first in range(start, min(start + TOGETHER, place.shape[0]), GROUP):
        count, gaps = min(GROUP, place.shape[0] - first), 0
        for row in range(count):
            few.which[row] = first + row
        likely = MARGIN * look_around(blocks, count, likely, few)
        for row in range(count):
            for k in range(nearest.shape[1]):
                nearest[first + row, k] = few.found[row, k + 1]
            if measure(place, few.found, row, is_last, lines, normal, discs) and not is_last:
                many.which[gaps] = first + row
                gaps += 1
        if gaps > 0:
            wider = MARGIN * look_around(blocks, gaps, wider, many)
            for row in range(gaps):
                measure(place, many.found, row, True, lines, normal, discs)


@parallel_kernel
def measure_all(
    counter: Counter,
    blocks: PointBlocks,
    wanted: Wanted,
    normal: Floats,
    discs: Spaced,
    nearest: Nearest,
) -> None:
    """Find normals and discs of all points.

    Parameters
    ----------
    blocks
        N points along a curve.
    wanted
        At most N neighbours.
    normal
        (N, 3) made unit length; filled where it is 0, with either of both signs.
    discs
        Filled.
    nearest
        (N, few − 1) filled: the neighbours of each point, without itself.
    """
    for chunk in tasks(counter, (blocks.place.shape[0] + TOGETHER - 1) // TOGETHER):
        _measure_blocks(blocks, wanted, chunk, normal, discs, nearest)
