"""Runs of neighbouring samples, assigned to tiles as a whole; shared by splats and points."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.scenes.plans import PicturePlan
from resample.painting.scenes.scene import (
    Clock,
    PaintTarget,
    PreparedScene,
    nothing_painted,
    size_of_tiles,
    tiles_along,
)
from resample.types import Film, Floats, Indices, Runs, Samples, Statistics, Tally, Tiles
from resample.watching import Progress, told

RUN_EXTENT = 8.0  # voxels

Output = tuple[Film, Floats, Tally]  # the second are values of projections, if any
Deal = tuple[Tiles, Indices]  # runs that tiles may show, and their numbers of samples


class RunPainter(NamedTuple):
    """Painter of a planned scene by runs of samples."""

    find_spacings: Callable[[Tiles, Runs], None]
    paint: Callable[[Indices, Tiles, Runs, Output], None]  # paints tiles of given numbers
    points: Callable[[Tiles, Runs], int]  # number of visible samples that are points
    is_measuring: bool = False  # values of a projection are measured


def breaks(scene: PreparedScene, samples: Samples, extent: float, longest: int) -> Indices:
    """Starts of runs, and the end of the last one.

    Runs have at most `longest` samples, within `extent` voxels.
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


def planned(scene: PreparedScene, painter: str, runs: Runs, columns: int) -> PreparedScene:
    """Add a plan from all samples to a scene.

    `columns` as in `size_of_tiles`.
    """
    from resample.engine.subpixels import grid_of

    known, style = runs.known, scene.style
    least = known["least_spacing"].min()
    seen = known[known["seen"] > 0]
    plan = PicturePlan(
        painter,
        size_of_tiles(grid_of(least, style), scene.tables.pixel_margin, columns),
        least,
        known["most_spacing"].max(),
        float(np.abs(seen["key"]).max(initial=0)),
        float(runs.samples.extinction.max()),
        int(seen["seen"].sum()),
    )
    return replace(scene, plan=plan)


def plan_of(scene: PreparedScene) -> PicturePlan:
    """Plan of a planned scene."""
    if scene.plan is None:
        raise RuntimeError("a scene is planned before it is painted")
    return scene.plan


def dealt(scene: PreparedScene, runs: Runs, find_spacings: Callable[[Tiles, Runs], None]) -> Deal:
    """Assign runs to tiles, with their numbers of samples.

    `find_spacings` computes the spacings of tiles of a planned scene.
    """
    from resample.engine.ellipsoids.runs import count_runs, deal_runs
    from resample.engine.subpixels import grid_of

    known, screen, style = runs.known, scene.screen, scene.style
    plan = plan_of(scene)
    least, most, size = plan.least, plan.most, plan.tile
    rows, columns = tiles_along(screen, size)
    count, load = np.zeros((2, rows * columns), np.int64)
    count_runs(known, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count)])
    spacing = np.full(count.size, least, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), spacing, size, columns)
    deal_runs(known, screen, tiles, load)
    if grid_of(most, style) < grid_of(least, style):
        find_spacings(tiles, runs)
    return tiles, load


def paint_at_once(
    scene: PreparedScene, by: RunPainter, runs: Runs, clock: Clock, progress: Progress | None
) -> tuple[PaintTarget, Statistics]:
    """Paint all samples on the tiles that have some, fullest first."""
    tiles, load = dealt(scene, runs, by.find_spacings)
    clock.lap("bin")
    size, known = (scene.screen.height, scene.screen.width), runs.known["seen"]
    painted = nothing_painted(*size, load.size, has_values=by.is_measuring)
    turn: Indices = np.argsort(-load, kind="stable")
    turn = turn[load[turn] > 0]
    if turn.size:
        done = np.cumsum(load[turn])
        with told(progress, done / done[-1]):
            by.paint(turn, tiles, runs, (painted.film, painted.value, painted.tally))
    clock.lap("paint")
    counts = painted.statistics(runs.samples.extinction.size, clock.seconds)
    points, visible = by.points(tiles, runs), int(known.sum())
    hidden = visible - counts.points - counts.splats
    return painted, counts._replace(points=points, splats=visible - points, hidden=hidden)


def tile_order(load: Indices, are_painted: NDArray[np.bool_]) -> Indices:
    """Order in which tiles (T,) are painted: those that have members and are selected."""
    turn: Indices = np.argsort(-load, kind="stable")
    return turn[(load[turn] > 0) & are_painted[turn]]
