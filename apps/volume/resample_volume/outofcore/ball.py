"""Bounding sphere of the visible voxels of volumes in bricks, equal to `sphere_around`'s."""

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.viewpoints import Sphere
from resample.outofcore.passes import PassContext
from resample.types import Doubles, Floats
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.outline import FINE, OutlineQuery, VisibleOutline
from resample_volume.types import Volume
from resample_volume.voxels.blocks import Indices, Lattice, ends_of, lattice_for, passed
from resample_volume.voxels.framing import (
    BINS,
    SOME,
    STRAY_GAP,
    codes_along,
    farthest_from,
    full_codes,
    least_near,
    most_strays,
    near_ends,
    sphere_of,
    wide_axes,
)
from resample_volume.voxels.visible import lattice_of

BATCH_SIZE = 1 << 20  # voxels scanned together in the second pass, about
ROUNDED = 1e-5  # relative rounding error of a distance
SLACK = 1e-3  # voxels by which places of blocks are not known


class Bulk(NamedTuple):
    """Bounds of the voxels without outliers."""

    low: Doubles  # (3,) of all, scene units
    extent: Doubles  # (3,) of all
    codes: NDArray[np.int64]  # (3, 2) first and last along each axis, see `codes_along`

    def holds(self, position: Floats) -> NDArray[np.bool_]:
        """Return which voxels (N,) are not outliers."""
        kept = np.ones(len(position), bool)
        for axis in wide_axes(self.extent):
            code = codes_along(position, self.low, self.extent, axis)
            kept &= (code >= self.codes[axis, 0]) & (code <= self.codes[axis, 1])
        return kept


def ball_of(
    seen: OutlineQuery, outline: VisibleOutline, voxel: float, context: PassContext
) -> Sphere:
    """Return the bounding sphere without outliers; `voxel` is the longest step of the lattice."""
    low, high = outline.low, outline.high
    most, bulk, extent = most_strays(outline.total), None, high - low
    if most and np.isfinite(extent).all() and not _is_filled(seen, outline, most):
        bulk = _bulk(seen, low, extent, most, voxel, context)
        if bulk is not None:
            bricks = bricks_of(seen.volume)
            job = partial(_ends_of, seen, bulk)
            ends = np.array(passed(bricks, lattice_for(bricks.shape), job, context))
            low, high = (ends[:, 0].min(axis=0), ends[:, 1].max(axis=0))
            low, high = low.astype(np.float64), high.astype(np.float64)
    return sphere_of(low, high, voxel, lambda center: _farthest(seen, outline, center, bulk))


def _ends_of(seen: OutlineQuery, bulk: Bulk, bricks: Bricks) -> Floats:
    """Return least and greatest coordinates (2, 3) of voxels that are not outliers."""
    ends = np.array([[np.inf] * 3, [-np.inf] * 3], np.float32)
    for position in _positions(seen, bricks):
        own = position[bulk.holds(position)]
        ends[0] = np.minimum(ends[0], own.min(0, initial=np.inf))
        ends[1] = np.maximum(ends[1], own.max(0, initial=-np.inf))
    return ends


def _bulk(
    seen: OutlineQuery, low: Doubles, extent: Doubles, most: int, voxel: float, context: PassContext
) -> Bulk | None:
    """Return the bounds without outliers; None if there are no outliers."""
    bricks = bricks_of(seen.volume)
    job = partial(_code_counts, seen, low, extent)
    count = np.sum(passed(bricks, lattice_for(bricks.shape), job, context), axis=0)
    codes = np.array([[0, BINS - 1]] * 3)
    for axis in wide_axes(extent):
        codes[axis] = full_codes(count[axis], float(extent[axis]), most, voxel)
    cut = any(
        count[axis, : codes[axis, 0]].any() or count[axis, codes[axis, 1] + 1 :].any()
        for axis in range(3)
    )
    return Bulk(low, extent, codes) if cut else None


def _code_counts(seen: OutlineQuery, low: Doubles, extent: Doubles, bricks: Bricks) -> Indices:
    """Count the voxels (3, BINS) of each code along each axis."""
    count = np.zeros((3, BINS), np.int64)
    for position in _positions(seen, bricks):
        for axis in wide_axes(extent):
            code = codes_along(position, low, extent, axis)
            count[axis] += np.bincount(code, minlength=BINS)
    return count


def _positions(seen: OutlineQuery, bricks: Bricks) -> Iterator[Floats]:
    """Return positions (N, 3) of visible voxels, brick by brick."""
    volume = with_bricks(seen.volume, bricks)
    return seen.classified(volume, lambda _, voxels: voxels.position)


def _is_filled(seen: OutlineQuery, outline: VisibleOutline, most: int) -> bool:
    """Test a regular sample of voxels as `framing` does, in the order of the painter's bricks."""
    bricks = bricks_of(seen.volume)
    low, high = outline.low, outline.high
    extent, least = high - low, least_near(most)
    lattice = Lattice(bricks.shape, FINE)
    start = np.cumsum(outline.fine_visible) - outline.fine_visible
    starts, ends = _reach(seen.volume, lattice, outline.fine)
    gap = STRAY_GAP * extent
    is_shell = ((starts <= low + gap) | (ends >= high - gap)).any(axis=1)
    total = np.zeros((2, 3), np.int64)
    for own in _groups(lattice, np.flatnonzero(is_shell), outline, bricks):
        position = _ordered(seen, lattice, outline.fine[own], bricks)
        rank = np.repeat(start[own], outline.fine_visible[own]) + _within(outline.fine_visible[own])
        some = position[rank % SOME == SOME // 2]
        total += near_ends(some, low, extent)
        if total.min() > least:
            return True
    return False


def _within(count: Indices) -> Indices:
    """Return indices that restart at 0 in each group of the given size."""
    first = np.cumsum(count) - count
    return np.asarray(np.arange(count.sum()) - np.repeat(first, count))


def _groups(
    lattice: Lattice, chosen: Indices, outline: VisibleOutline, bricks: Bricks
) -> Iterator[Indices]:
    """Yield fine bricks in groups from one file brick each, spread over the volume."""
    at = np.stack(np.unravel_index(outline.fine[chosen], lattice.blocks)) * lattice.side
    homes = np.ravel_multi_index(
        [n // side for n, side in zip(at, bricks.side, strict=True)], bricks.count
    )
    order = np.argsort(homes, kind="stable")
    groups = np.split(chosen[order], np.flatnonzero(np.diff(homes[order])) + 1)
    steps = max(1, round(len(groups) ** 0.5))
    for first in range(steps):
        yield from (np.sort(group) for group in groups[first::steps] if group.size)


def _ordered(seen: OutlineQuery, lattice: Lattice, number: Indices, bricks: Bricks) -> Floats:
    """Return positions (N, 3) of visible voxels, block after block, z slowest in each."""
    volume = with_bricks(seen.volume, bricks.within(lattice.request(number)))
    parts = list(seen.classified(volume, lambda place, voxels: (place, voxels.position)))
    place = np.concatenate([part for part, _ in parts])
    at = [n // lattice.side for n in np.unravel_index(place, lattice.size)]
    order = np.lexsort((place, np.ravel_multi_index(at, lattice.blocks)))
    return np.concatenate([position for _, position in parts])[order]


def _farthest(
    seen: OutlineQuery, outline: VisibleOutline, center: Doubles, bulk: Bulk | None
) -> float:
    """Return the distance of the farthest voxel from a point; nearer blocks are skipped."""
    bricks = bricks_of(seen.volume)
    lattice, number = lattice_for(bricks.shape), outline.blocks.number
    starts, ends = _reach(seen.volume, lattice, number)
    far = np.maximum(np.abs(starts - center), np.abs(ends - center))
    bound = np.sqrt((far * far).sum(axis=1))
    order = np.argsort(-bound, kind="stable")
    step = max(1, BATCH_SIZE // lattice.side**3)
    best = -np.inf
    for first in range(0, order.size, step):
        own = order[first : first + step]
        if bound[own[0]] * (1 + ROUNDED) < best:
            break
        part = bricks.within(lattice.request(np.sort(number[own])))
        for position in _positions(seen, part):
            kept = position if bulk is None else position[bulk.holds(position)]
            if kept.size:
                best = max(best, farthest_from(kept, center))
    return best


def _reach(volume: Volume, lattice: Lattice, number: Indices) -> tuple[Doubles, Doubles]:
    """Return bounds (N, 3) of the voxels of blocks, scene units."""
    steps, (low, high) = lattice_of(volume), ends_of(lattice, number)
    center = 0.5 * (low + high) @ steps.T + volume.origin
    half = (0.5 * (high - low) + SLACK) @ np.abs(steps).T
    return center - half, center + half
