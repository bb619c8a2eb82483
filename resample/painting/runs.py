"""Runs of neighbouring samples, which tiles take whole; what splats and points have in common."""

from collections.abc import Callable

import numpy as np

from resample.painting.scene import Painted, Scene, nothing_painted, size_of_tiles, tiles_along
from resample.types import MOST_COLUMNS, Film, Indices, Runs, Samples, Statistics, Tally, Tiles
from resample.watching import Progress, told

RUN_EXTENT = 8.0  # voxels

Deal = tuple[Tiles, Indices]  # runs that tiles may show, and how many samples these have


def breaks(scene: Scene, samples: Samples, extent: float, longest: int) -> Indices:
    """Where runs begin, and where the last one ends.

    They have at most `longest` samples, within `extent` voxels.
    """
    from resample.engine.ellipsoids.run_bounds import CHUNKS, break_runs

    samples_count = samples.extinction.size
    start, count = np.empty(samples_count, np.int64), np.zeros(CHUNKS, np.int64)
    extent *= scene.ellipsoid.volume ** (1 / 3)
    break_runs(samples.position.reshape(-1), extent, longest, start, count)
    first = samples_count * np.arange(CHUNKS) // CHUNKS
    parts = [start[begin : begin + runs] for begin, runs in zip(first, count, strict=True)]
    begins: Indices = np.concatenate([*parts, [samples_count]])
    return begins


def dealt(
    scene: Scene,
    runs: Runs,
    find_spacings: Callable[[Tiles], None],
    columns: int = MOST_COLUMNS,
) -> Deal:
    """Runs that tiles may show, and how many samples these have.

    `find_spacings` fills in the tiles' spacings; `columns` as in `size_of_tiles`.
    """
    from resample.engine.grid import grid
    from resample.engine.runs import count_runs, deal_runs

    known, screen, style = runs.known, scene.screen, scene.style
    least, most = known["least_spacing"].min(), known["most_spacing"].max()
    size = size_of_tiles(grid(least, style), scene.tables.pixel_margin, columns)
    rows, columns = tiles_along(screen, size)
    count, load = np.zeros((2, rows * columns), np.int64)
    count_runs(known, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count)])
    spacing = np.full(count.size, least, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), spacing, size, columns)
    deal_runs(known, screen, tiles, load)
    if grid(most, style) < grid(least, style):
        find_spacings(tiles)
    return tiles, load


def paint_tiles(
    paint: Callable[[Indices, tuple[Film, Tally]], None],
    scene: Scene,
    deal: Deal,
    progress: Progress | None,
) -> Painted:
    """Tiles that have members, most of them first; `paint` paints those of some numbers."""
    _, load = deal
    painted = nothing_painted(scene.screen.height, scene.screen.width, load.size)
    turn = np.argsort(-load, kind="stable")
    turn = turn[load[turn] > 0]
    if turn.size:
        done = np.cumsum(load[turn])
        with told(progress, done / done[-1]):
            paint(turn, (painted.film, painted.tally))
    return painted


def counted(statistics: Statistics, runs: Runs, points: int) -> Statistics:
    """What a rendering did, of which painters know the samples only that were not hidden."""
    seen, shown = int(runs.known["seen"].sum()), statistics.points + statistics.splats
    return statistics._replace(points=points, splats=seen - points, hidden=seen - shown)
