"""Steepest slope of a volume in bricks, by which transfer functions of gradients are scaled."""

from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_volume.classification.transfer import Transfer
from resample_volume.data.bricks import Box, Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.classified import candidates_by_bricks
from resample_volume.outofcore.passes import PassContext, between, passed
from resample_volume.types import Volume
from resample_volume.voxels.fields import lattice_for
from resample_volume.voxels.streaming import Candidates
from resample_volume.voxels.visible import steep_between, steep_rank

HALF = 16  # bits of a float32 that are counted at a time

Counts = NDArray[np.int64]


class Slopes(NamedTuple):
    """Volume whose slopes are scanned."""

    volume: Volume  # in bricks
    transfer: Transfer  # which may show voxels by their value
    gradient: str


def steepness_by_bricks(slopes: Slopes, looking: PassContext) -> float:
    """Compute `steepness` of all gradients, without holding them all in memory.

    Lengths are not negative, so they sort as their bits do: a first pass counts the upper halves of
    the bits, a second one the lower halves where the wanted lengths are.
    """
    halves = [looking, looking]
    if looking.tell is not None:
        halves = [looking._replace(tell=between(looking.tell, at, at + 0.5)) for at in (0.0, 0.5)]
    upper = _counted(slopes, None, halves[0])
    total = int(upper.sum())
    if not total:
        return 0.0
    first, share = steep_rank(total)
    before = np.cumsum(upper)
    ranks = [first, min(first + 1, total - 1)]
    homes = [int(np.searchsorted(before, rank, side="right")) for rank in ranks]
    lower = {home: _counted(slopes, home, halves[1]) for home in sorted(set(homes))}
    low, high = (
        _length(home, int(rank - before[home] + upper[home]), lower[home])
        for home, rank in zip(homes, ranks, strict=True)
    )
    return steep_between(low, high, share)


def _length(home: int, rank: int, lower: Counts) -> float:
    """Return the length of a rank within one upper half, from counts of its lower halves."""
    bits = (home << HALF) + int(np.searchsorted(np.cumsum(lower), rank, side="right"))
    return float(np.array(bits, np.uint32).view(np.float32))


def _counted(slopes: Slopes, home: int | None, looking: PassContext) -> Counts:
    """Count lengths by upper half; or, within one upper half, by lower half."""
    bricks = bricks_of(slopes.volume)
    nothing: Any = None  # bricks are given to the job
    job = partial(_counted_of, slopes._replace(volume=slopes.volume._replace(values=nothing)), home)
    return np.asarray(sum(passed(bricks, lattice_for(bricks.shape), job, looking)))


def _counted_of(slopes: Slopes, home: int | None, bricks: Bricks) -> Counts:
    volume = with_bricks(slopes.volume, bricks)
    count = np.zeros(1 << HALF, np.int64)

    def bits(found: Candidates, _: Box) -> NDArray[np.uint32]:
        return lengths(found.slope).view(np.uint32)

    for part in candidates_by_bricks(volume, slopes.transfer, slopes.gradient, bits):
        own = part >> HALF if home is None else part[part >> HALF == home] & ((1 << HALF) - 1)
        count += np.bincount(own, minlength=count.size)
    return count


def lengths(slope: Floats) -> Floats:
    """Return the lengths (N,) of gradients (N, 3)."""
    return np.asarray(np.linalg.norm(slope, axis=1), np.float32)
