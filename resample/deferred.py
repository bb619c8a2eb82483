"""Splats in runs of neighbours, which only those tiles project that show them.

The quick way for what is painted most: splats of exact footprint, composited one by one. All
else is painted from the records of `resample.kernels.footprints`. See `resample.kernels.deferred`.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.orders import EverySample
from resample.scene import (
    Clock,
    Painted,
    Progress,
    Scene,
    in_steps,
    nothing_painted,
    size_of_tiles,
    tiles_along,
)
from resample.types import DISC, EXACT, RUN, Blocks, Profile, Records, Samples, Statistics, Tiles

LONGEST_RUN = 64  # samples
RUN_EXTENT = 8.0  # voxels
SAMPLES_PER_STEP = 10_000_000  # between two looks at the progress and at Ctrl-C

Indices = NDArray[np.int64]


class Runs(NamedTuple):
    """Samples of a scene, and what is known of runs of them."""

    samples: Samples
    start: Indices  # (R + 1,) where each run begins
    known: Records  # (R,) of RUN


def can_defer(scene: Scene, order: object) -> bool:
    """Whether the choices that were made can be painted so; `runs_of` then looks at the samples."""
    style = scene.style
    is_exact = style.model == EXACT or (style.model == DISC and not scene.view.perspective)
    return (
        type(order) is EverySample
        and is_exact
        and style.threshold < np.inf
        and not style.linear_opacity
        and style.tint_red < 0
        and style.inflated == style.blurred == 0
    )


def is_by_distance(scene: Scene, order: EverySample) -> bool:
    """Whether samples are ordered by distance; where rays are parallel that is their depth."""
    return order.key == "distance" and scene.view.perspective


def runs_of(
    scene: Scene, samples: Samples, order: EverySample, blocks: Blocks | None
) -> Runs | None:
    """Samples in runs, none of which goes beyond a block; None if one is no splat."""
    from resample.kernels.grid import grid
    from resample.kernels.outlines import outline_runs
    from resample.kernels.rows import MOST_COLUMNS

    start = breaks(scene, samples, RUN_EXTENT, LONGEST_RUN)
    if blocks is not None:
        start = np.union1d(start, blocks.start)
    known = np.zeros(start.size - 1, RUN)
    rest = (scene.view, scene.ellipsoid, scene.screen, scene.style.faintest)
    for by_boxes in (len(scene.screen.planes) == 0, False):
        outline_runs(known, start, samples, *rest, is_by_distance(scene, order), by_boxes)
        if not (by_boxes and _is_vague(scene, known)):
            break
    least = known["least_spacing"].min()
    finest = grid(least, scene.style)
    columns = (size_of_tiles(finest) + 2 * scene.tables.pixel_margin) * finest
    if least * finest <= scene.style.threshold or columns > MOST_COLUMNS:
        return None
    return Runs(samples, start, known)


def _is_vague(scene: Scene, known: Records) -> bool:
    """Whether bounds of the least spacing do not tell the grid, or whether all are splats."""
    from resample.kernels.grid import grid

    least, most = known["least_spacing"].min(), known["most_spacing"]
    finest = grid(least, scene.style)
    no_more = most[known["seen"] > 0].min(initial=np.inf)
    return bool(finest != grid(no_more, scene.style) or least * finest <= scene.style.threshold)


def breaks(scene: Scene, samples: Samples, extent: float, longest: int) -> Indices:
    """Where runs of `longest` samples within `extent` voxels begin, and where the last one ends."""
    from resample.kernels.outlines import CHUNKS, break_runs

    samples_count = samples.extinction.size
    start, count = np.empty(samples_count, np.int64), np.zeros(CHUNKS, np.int64)
    extent *= scene.ellipsoid.volume ** (1 / 3)
    break_runs(samples.position.reshape(-1), extent, longest, start, count)
    first = samples_count * np.arange(CHUNKS) // CHUNKS
    parts = [start[begin : begin + runs] for begin, runs in zip(first, count, strict=True)]
    return np.concatenate([*parts, [samples_count]])


def _dealt(scene: Scene, runs: Runs) -> tuple[Tiles, Indices]:
    """Runs that tiles may show, and how many samples these have."""
    from resample.kernels.deferred import count_runs, deal_runs, find_spacings
    from resample.kernels.grid import grid

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


def paint_deferred(
    scene: Scene,
    samples: Samples,
    order: EverySample,
    profile: Profile,
    progress: Progress | None,
    blocks: Blocks | None = None,
) -> tuple[Painted, Statistics] | None:
    """Picture of samples, or None if some are no splats.

    Parameters
    ----------
    scene
        Of which `can_defer` is true; its footprints are not read.
    samples
        As `check_samples` gives them; the nearer neighbours are in memory, the better.
    order
        By depth or by distance.
    profile
        Line integrals of the scene's kernel.
    progress
        Called with the share of the work that is done.
    blocks
        Of which it is to be said how many were outside the view, or hidden.
    """
    from resample.kernels.deferred import paint_runs

    clock = Clock()
    runs = runs_of(scene, samples, order, blocks)
    if runs is None:
        return None
    clock.lap("project")
    tiles, load = _dealt(scene, runs)
    clock.lap("bin")
    painted = nothing_painted(scene.screen.height, scene.screen.width, load.size)
    taken, peak = np.zeros(runs.known.size, np.uint8), _peak(scene)
    for turn, done in in_steps(load, SAMPLES_PER_STEP):
        paint_runs(
            turn,
            tiles,
            runs.known,
            runs.start,
            samples,
            is_by_distance(scene, order),
            scene.view,
            scene.ellipsoid,
            scene.screen,
            scene.style,
            scene.tables,
            profile,
            peak,
            painted.film,
            taken,
            painted.tally,
        )
        if progress is not None:
            progress(done)
    clock.lap("paint")
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    return painted, counted(statistics, runs, taken, blocks)


def _peak(scene: Scene) -> float:
    """Largest line integral of the kernel, through its center along its longest axis."""
    longest = np.sqrt(np.linalg.eigvalsh(scene.ellipsoid.covariance)[-1])
    return float(scene.tables.footprint[0] * scene.ellipsoid.scale * longest)


def counted(
    statistics: Statistics,
    runs: Runs,
    taken: NDArray[np.uint8],
    blocks: Blocks | None,
    kind: str = "splats",
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
