"""Steepest slope of a volume in bricks, by which transfer functions of gradients are scaled."""

from functools import cache, partial
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.bricks import Box
from resample.outofcore.passes import DIGIT, PassContext, counts_by_digit, ranked
from resample_volume.classification.transfer import Transfer
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.classified import candidates_by_bricks
from resample_volume.types import Volume
from resample_volume.voxels.blocks import lattice_for, passed
from resample_volume.voxels.streaming import Candidates
from resample_volume.voxels.visible import steep_between, steep_rank

Counts = NDArray[np.int64]


class Slopes(NamedTuple):
    """Volume whose slopes are scanned."""

    volume: Volume  # in bricks
    transfer: Transfer  # which may show voxels by their value
    gradient: str


def steepness_by_bricks(slopes: Slopes, context: PassContext) -> float:
    """Compute `steepness` of all gradients, without holding them all in memory.

    Lengths are not negative, so they sort as their bits do.
    """

    @cache
    def counted(prefix: int, digit: int) -> Counts:
        part = context.portion(0.5 * (1 - digit), 0.5 * (2 - digit))
        bricks, nothing = bricks_of(slopes.volume), cast("Any", None)  # bricks are given to the job
        own = slopes._replace(volume=slopes.volume._replace(values=nothing))
        job = partial(_counted, own, prefix, digit)
        return np.asarray(sum(passed(bricks, lattice_for(bricks.shape), job, part)))

    total = int(counted(0, 1).sum())
    if not total:
        return 0.0
    first, share = steep_rank(total)
    bits = ranked([first, min(first + 1, total - 1)], counted, 2)
    low, high = np.array(bits, np.uint32).view(np.float32).tolist()
    return steep_between(low, high, share)


def _counted(slopes: Slopes, prefix: int, digit: int, bricks: Bricks) -> Counts:
    """Count lengths in some bricks by 16 of their bits, see `ranked`."""
    volume = with_bricks(slopes.volume, bricks)

    def bits(found: Candidates, _: Box) -> Counts:
        length = np.asarray(np.linalg.norm(found.slope, axis=1), np.float32)
        return counts_by_digit(length.view(np.uint32), prefix, digit)

    parts = candidates_by_bricks(volume, slopes.transfer, slopes.gradient, bits)
    return sum(parts, np.zeros(1 << DIGIT, np.int64))
