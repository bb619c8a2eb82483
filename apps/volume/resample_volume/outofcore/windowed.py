"""Volumes in bricks as samples in parts: blocks of voxels, which windows of a picture load.

Each visible voxel is scanned once for what all windows share (`surveyed`), then once for each
window that it may be visible in, unless others occlude it there. Several processes can share both
passes: parts depend on nothing but the work, and may be repeated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import product
from math import prod
from typing import Any, NamedTuple

import numpy as np

from resample.outofcore.boxes import PartBoxes
from resample.outofcore.bricks import LruCache, bricks_in_memory, with_neighbours
from resample.outofcore.passes import PassContext, threads_at_work
from resample.outofcore.samples import (
    PictureQuery,
    PlanAnswer,
    PlanQuery,
    SampleSource,
    plan_by_passes,
)
from resample.painting.scenes.plans import PicturePlan
from resample.types import Doubles, Samples
from resample.watching import report
from resample_volume.data.bricks import Bricks
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.caching import cache_visible, cached_visible
from resample_volume.outofcore.outline import Classified, VisibleBlocks
from resample_volume.types import Volume
from resample_volume.voxels.blocks import Indices, ends_of, lattice_for, passed
from resample_volume.voxels.cropping import Steeps, merged_steeps, steeps_of
from resample_volume.voxels.streaming import BYTES_PER_VOXEL, REMEDY
from resample_volume.voxels.visible import BYTES_PER_CANDIDATE, lattice_of

Lit = Callable[
    [Indices, Any, Steeps], Samples
]  # of flat indices, voxels and the extreme gradients of all


@dataclass(eq=False)
class VoxelBlocks(SampleSource):
    """Blocks of a volume in bricks, whose visible voxels are samples."""

    volume: Volume  # around the scene's origin; in `Bricks`, or several as `CombinedBricks`
    classified: Classified
    lit: Lit
    kind: Any  # cache key: equal where the visible voxels are equal
    beside: int = 0  # bytes of the memory taken by something else
    threads: int | None = None  # that a process takes
    volumes: int = 1  # volumes in the scene
    sifts: bool = False  # whether possibly visible voxels may turn out to be transparent
    steep: Steeps = ()  # of all voxels that have gradients
    reads: int = 0
    what = "visible voxels"
    remedy = REMEDY

    def __post_init__(self) -> None:
        self.blocks = lattice_for(bricks_of(self.volume).shape)
        self.lattice: Doubles = lattice_of(self.volume)

    def bounds(self, number: Indices, /) -> PartBoxes:
        """Return where blocks are."""
        return PartBoxes(*ends_of(self.blocks, number), self.lattice, self.volume.origin)

    def opened(self, recent: int, /) -> "VoxelBlocks":
        """Return the source of a window, with bricks of its own that are kept between steps."""
        bricks = bricks_of(self.volume).within(None, LruCache(recent) if recent else None)
        return replace(self, volume=with_bricks(self.volume, bricks), reads=0)

    def unpinned(self) -> bool:
        """Evict pinned bricks; whether there were any."""
        bricks = bricks_of(self.volume)
        had_any = bricks.pinned_bytes > 0
        if had_any:
            bricks.pin_bricks(0)
        return had_any

    def load(self, number: Indices, count: int, /) -> Samples:
        """Return all shaded voxels of blocks."""
        of_window = bricks_of(self.volume)
        bricks = of_window.within(self.blocks.request(number), of_window.recent)
        position, color = np.empty((2, count, 3), np.float32)
        extinction, done = np.empty(count, np.float32), 0

        def lit(place: Indices, voxels: Any) -> Samples:
            return self.lit(place, voxels, self.steep)

        lattice = np.eye(3)
        for part in self.classified(with_bricks(self.volume, bricks), lit):
            own = slice(done, done + len(part.position))
            position[own], color[own], extinction[own] = part[:3]
            lattice, done = part.lattice, own.stop
            report(done, count)
        self.reads += bricks.reads
        return Samples(position[:done], color[:done], extinction[:done], lattice)

    def held(self, number: Indices, sizes: Indices, /) -> int:
        """Bytes of bricks held together, of temporaries of those being scanned, and of others."""
        bricks, side = bricks_of(self.volume), self.blocks.side
        others = self.beside + bricks.pinned_bytes
        if not number.size:
            return others
        at = np.stack(np.unravel_index(number, self.blocks.blocks), axis=1) * side
        last = np.minimum(at + side, bricks.shape) - 1
        is_near = np.zeros(bricks.count, bool)
        for ends in product((0, 1), repeat=3):
            z, y, x = (np.where(ends, last, at) // bricks.side).T
            is_near[z, y, x] = True
        held = bricks_in_memory(with_neighbours(is_near))
        threads = self.threads or threads_at_work()
        within = np.ravel_multi_index(tuple((at // bricks.side).T), bricks.count)
        each = int(np.bincount(within, sizes).max()) * BYTES_PER_VOXEL
        if self.sifts:
            most = min(int(np.bincount(within).max()) * side**3, prod(bricks.side))
            each = max(each, most * BYTES_PER_CANDIDATE)
        return others + (held + threads) * bricks.bytes_each + (threads + 1) * self.volumes * each


class LayerScan(NamedTuple):
    """Result of the scan of some layers of blocks."""

    answer: PlanAnswer
    steep: list[Steeps]  # of bricks
    visible: list[tuple[Indices, Indices]]  # blocks, by flat indices, and their visible voxels


def surveyed(
    source: VoxelBlocks, picture: PictureQuery, context: PassContext
) -> tuple[PicturePlan, VisibleBlocks] | None:
    """Scan a picture's voxels, a brick at a time; None if nothing is visible."""
    known = cached_visible(source.volume, source.kind)
    if known is not None:
        parts = picture.in_parts(source, known.number, known.visible)
        plan = picture.resampler.plan_of_parts(parts, picture.camera, **picture.shape)
        if plan is not None:
            return plan, known
    bricks, blocks = bricks_of(source.volume), source.blocks

    def scan(query: PlanQuery) -> tuple[Sequence[PlanAnswer], list[LayerScan]]:
        found = passed(bricks, blocks, partial(_scan_layers, source, picture, query), context)
        return [part.answer for part in found], found

    size = np.array([bricks.shape[::-1]]) - 1.0
    whole = PartBoxes(np.zeros((1, 3)), size, source.lattice, source.volume.origin)
    plan, found = plan_by_passes(picture, source.lattice, whole, scan)
    if plan is None:
        return None
    seen = np.zeros(int(np.prod(blocks.blocks)), np.int64)
    for index, count in (counted for part in found for counted in part.visible):
        seen[index] += count
    index = np.flatnonzero(seen)
    steep = reduce(merged_steeps, [one for part in found for one in part.steep])
    visible = VisibleBlocks(steep, index, seen[index])
    cache_visible(source.volume, source.kind, visible)
    return (plan, visible) if plan.visible else None


def _scan_layers(
    source: VoxelBlocks, picture: PictureQuery, query: PlanQuery, bricks: Bricks
) -> LayerScan:
    """Scan the requested layers of bricks for a picture."""
    answer, steep, visible = PlanAnswer([], query.spaced), [], []

    def counted(place: Indices, voxels: Any) -> tuple[tuple[Indices, Indices], Any]:
        return source.blocks.counted(place), voxels

    for seen, voxels in source.classified(with_bricks(source.volume, bricks), counted):
        if not len(voxels.position):
            continue
        steep.append(steeps_of(voxels.parts, picture.clip))
        samples = Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
        answer = answer.with_more(picture, query, samples)
        visible.append(seen)
    return LayerScan(answer, steep, visible)
