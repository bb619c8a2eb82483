"""Normals and discs of all points of a cloud, by the neighbours of each."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats
from resample_warp3d.clouds.kernels.cells import Nearest, Spaced, measure
from resample_warp3d.clouds.kernels.neighbours import BLOCK, PointBlocks, look_around, search
from resample_warp3d.clouds.kernels.polygons import WIDTH

TOGETHER = 64  # blocks that a thread takes at a time


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
    polygon = np.zeros((4, WIDTH))
    place, start = blocks.place, int(np.int64(chunk)) * TOGETHER
    for block in range(start, min(start + TOGETHER, blocks.first[1])):
        first = block * BLOCK
        count, gaps = min(BLOCK, place.shape[0] - first), 0
        for row in range(count):
            few.which[row] = first + row
        look_around(blocks, block, count, few)
        for row in range(count):
            for k in range(nearest.shape[1]):
                nearest[first + row, k] = few.found[row, k + 1]
            is_last = wanted.few == wanted.many
            if measure(place, few.found, row, is_last, polygon, normal, discs) and not is_last:
                many.which[gaps] = first + row
                gaps += 1
        if gaps > 0:
            look_around(blocks, block, gaps, many)
            for row in range(gaps):
                measure(place, many.found, row, True, polygon, normal, discs)


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
    for chunk in tasks(counter, (blocks.first[1] + TOGETHER - 1) // TOGETHER):
        _measure_blocks(blocks, wanted, chunk, normal, discs, nearest)
