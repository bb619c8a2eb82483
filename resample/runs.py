"""Runs of neighbouring samples, which tiles take whole; what splats and points have in common."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.profiles.orders import EverySample
from resample.scene import (
    Painted,
    Progress,
    Scene,
    in_steps,
    nothing_painted,
    size_of_tiles,
    tiles_along,
)
from resample.types import Blocks, Records, Samples, Statistics, Tiles

RUN_EXTENT = 8.0  # voxels
SAMPLES_PER_STEP = 10_000_000  # between two looks at the progress and at Ctrl-C

Indices = NDArray[np.int64]
Deal = tuple[Tiles, Indices]  # runs that tiles may show, and how many samples these have


class Runs(NamedTuple):
    """Samples of a scene, and what is known of runs of them."""

    samples: Samples
    start: Indices  # (R + 1,) where each run begins
    known: Records  # (R,) of RUN


def is_by_distance(scene: Scene, order: EverySample) -> bool:
    """Whether samples are ordered by distance; where rays are parallel that is their depth."""
    return order.key == "distance" and scene.view.perspective


def breaks(
    scene: Scene, samples: Samples, extent: float, longest: int, blocks: Blocks | None
) -> Indices:
    """Where runs begin, and where the last one ends.

    They have at most `longest` samples, within `extent` voxels and one block.
    """
    from resample.engine.ellipsoids.outlines import CHUNKS, break_runs

    samples_count = samples.extinction.size
    start, count = np.empty(samples_count, np.int64), np.zeros(CHUNKS, np.int64)
    extent *= scene.ellipsoid.volume ** (1 / 3)
    break_runs(samples.position.reshape(-1), extent, longest, start, count)
    first = samples_count * np.arange(CHUNKS) // CHUNKS
    parts = [start[begin : begin + runs] for begin, runs in zip(first, count, strict=True)]
    begins: Indices = np.concatenate([*parts, [samples_count]])
    return begins if blocks is None else np.union1d(begins, blocks.start)


def dealt(scene: Scene, runs: Runs, find_spacings: Callable[..., None]) -> Deal:
    """Runs that tiles may show, and how many samples these have.

    `find_spacings` is the kernel that fills in the tiles' spacings.
    """
    from resample.engine.grid import grid
    from resample.engine.runs import count_runs, deal_runs

    known, screen, style = runs.known, scene.screen, scene.style
    least, most = known["least_spacing"].min(), known["most_spacing"].max()
    size = size_of_tiles(grid(least, style))
    rows, columns = tiles_along(screen, size)
    count, load = np.zeros((2, rows * columns), np.int64)
    count_runs(known, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count)])
    spacing = np.full(count.size, least, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), spacing, size, columns)
    deal_runs(known, screen, tiles, load)
    if grid(most, style) < grid(least, style):
        find_spacings(
            tiles,
            known,
            runs.start,
            runs.samples,
            scene.view,
            scene.ellipsoid,
            screen,
            style,
        )
    return tiles, load


def paint_in_steps(
    kernel: Callable[..., None],
    own: tuple[Any, ...],
    scene: Scene,
    runs: Runs,
    deal: Deal,
    order: EverySample,
    progress: Progress | None,
) -> tuple[Painted, NDArray[np.uint8]]:
    """Tiles painted by a kernel from runs, in steps that can be watched; and which runs it took.

    `own` are the arguments that only this kernel has.
    """
    tiles, load = deal
    painted = nothing_painted(scene.screen.height, scene.screen.width, load.size)
    taken = np.zeros(runs.known.size, np.uint8)
    for turn, done in in_steps(load, SAMPLES_PER_STEP):
        kernel(
            turn,
            tiles,
            runs.known,
            runs.start,
            runs.samples,
            is_by_distance(scene, order),
            scene.view,
            scene.ellipsoid,
            scene.screen,
            scene.style,
            scene.tables,
            *own,
            painted.film,
            taken,
            painted.tally,
        )
        if progress is not None:
            progress(done)
    return painted, taken


def counted(
    statistics: Statistics,
    runs: Runs,
    taken: NDArray[np.uint8],
    blocks: Blocks | None,
    kind: str,
) -> Statistics:
    """What a rendering did, of which the painters know the samples at the centers of tiles only."""
    seen, shown = runs.known["seen"], int(getattr(statistics, kind))
    if blocks is None:
        return _with_seen(statistics, kind, int(seen.sum()), shown)
    count = np.diff(blocks.start)
    first = np.searchsorted(runs.start, blocks.start[:-1])
    of_block = np.add.reduceat(seen, first)
    is_outside = of_block == 0
    is_occluded = (np.maximum.reduceat(taken, first) == 0) & ~is_outside
    return _with_seen(statistics, kind, int(of_block[~is_occluded].sum()), shown)._replace(
        outside=int(count[is_outside].sum()),
        occluded=int(count[is_occluded].sum()),
        blocks=count.size,
        blocks_outside=int(is_outside.sum()),
        blocks_occluded=int(is_occluded.sum()),
    )


def _with_seen(statistics: Statistics, kind: str, seen: int, shown: int) -> Statistics:
    """Statistics of samples of a kind, of which some were seen and some of these were painted."""
    numbers: dict[str, Any] = {kind: seen, "hidden": seen - shown}
    return statistics._replace(**numbers)
