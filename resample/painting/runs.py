"""Runs of neighbouring samples, assigned to tiles as a whole; shared by splats and points."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from resample.painting.scenes.cuts import RunPainter
from resample.painting.scenes.plans import NOTHING, PicturePlan
from resample.painting.scenes.scene import (
    Clock,
    PaintTarget,
    PreparedScene,
    nothing_painted,
    size_of_tiles,
    tiles_along,
)
from resample.types import Film, Floats, Indices, Runs, Samples, Statistics, Tiles
from resample.watching import Progress, told

RUN_EXTENT = 8.0  # voxels

Deal = tuple[Tiles, Indices]  # runs that tiles may show, and their numbers of samples


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
    """Add a plan from all samples to a scene, if it has none.

    `columns` as in `size_of_tiles`.
    """
    if scene.plan is not None:
        return scene
    from resample.engine.subpixels import grid_of

    known, style = runs.known, scene.style
    least = known["least_spacing"].min()
    seen = known[known["seen"] > 0]
    plan = PicturePlan(
        painter,
        (scene.screen.height, scene.screen.width),
        size_of_tiles(grid_of(least, style), scene.tables.pixel_margin, columns),
        scene.screen.margin,
        least,
        known["most_spacing"].max(),
        float(np.abs(seen["key"]).max(initial=0)),
        float(runs.samples.extinction.max()),
        scene.layers,
        (
            float(known["left"].min()),
            float(known["top"].min()),
            float(known["right"].max()),
            float(known["bottom"].max()),
        ),
        int(seen["seen"].sum()),
    )
    return replace(scene, plan=plan)


def plan_of(scene: PreparedScene) -> PicturePlan:
    """Plan of a planned scene."""
    if scene.plan is None:
        raise RuntimeError("a scene is planned before it is painted")
    return scene.plan


def dealt(
    scene: PreparedScene, runs: Runs, find_spacings: Callable[[Tiles, Runs], None] | None = None
) -> Deal:
    """Assign runs to tiles, with their numbers of samples.

    `find_spacings` computes the spacings of tiles of a planned scene; None: they are known.
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
    if plan.spacing is not None:
        return tiles._replace(spacing=plan.spacing), load
    is_uneven = grid_of(most, style) < grid_of(least, style)
    if is_uneven and find_spacings is not None and scene.window != NOTHING:
        find_spacings(tiles, runs)
    return tiles, load


def spacings_of(scene: PreparedScene, by: RunPainter, samples: Samples) -> Floats:
    """Smallest spacing of the samples in each tile (T,) of a planned scene; inf where empty."""
    tiles, _ = dealt(scene, by.runs(samples), by.find_spacings)
    return tiles.spacing


def paint_at_once(
    scene: PreparedScene, by: RunPainter, runs: Runs, clock: Clock, progress: Progress | None
) -> tuple[PaintTarget, Statistics]:
    """Paint all samples on the tiles that have some, fullest first."""
    from resample.engine.ellipsoids.steps import AT_ONCE

    tiles, load = dealt(scene, runs, by.find_spacings)
    clock.lap("bin")
    screen, known = scene.screen, runs.known["seen"]
    painted = nothing_painted(0, 0, load.size)._replace(plan=scene.plan, film=film_of(scene, tiles))
    if by.is_measuring:
        value = np.full((screen.height, screen.width), np.nan, np.float32)
        painted = painted._replace(value=value)
    turn = tile_order(load, shown(scene, tiles))
    if turn.size:
        done = np.cumsum(load[turn])
        with told(progress, done / done[-1]):
            by.paint(turn, tiles, runs, (painted.film, painted.value, painted.tally, AT_ONCE))
    clock.lap("paint")
    counts = painted.statistics(runs.samples.extinction.size, clock.seconds)
    points, visible = by.points(tiles, runs), int(known.sum())
    hidden = visible - counts.points - counts.splats
    return painted, counts._replace(points=points, splats=visible - points, hidden=hidden)


def tile_order(load: Indices, are_painted: NDArray[np.bool_]) -> Indices:
    """Order in which tiles (T,) are painted: those that have members and are selected."""
    turn: Indices = np.argsort(-load, kind="stable")
    return turn[(load[turn] > 0) & are_painted[turn]]


def film_of(scene: PreparedScene, tiles: Tiles) -> Film:
    """Film of a picture, of which only the rows of the window's tiles take memory."""
    height, width = scene.screen.height, scene.screen.width
    if scene.window is None or scene.window == NOTHING:
        size = (height, width) if scene.window is None else (0, 0)
        return nothing_painted(*size).film
    rows = _rows_of(scene, tiles)
    # Untouched pages take no memory.
    rgba, coverage = np.zeros((height, width, 4), np.float32), np.zeros((height, width), np.float32)
    depth, first_depth = np.empty((2, height, width), np.float32)
    depth[rows], first_depth[rows] = np.inf, np.inf
    return Film(rgba, depth, first_depth, coverage)


def values_of(scene: PreparedScene, tiles: Tiles) -> Floats:
    """Measured values of a projection (H, W), in memory like the film."""
    value = np.empty((scene.screen.height, scene.screen.width), np.float32)
    value[_rows_of(scene, tiles)] = np.nan
    return value


def _rows_of(scene: PreparedScene, tiles: Tiles) -> slice:
    """Rows in px of the tiles that overlap the scene's window."""
    if scene.window is None:
        return slice(None)
    size, y0, y1 = tiles.size, scene.window[1], scene.window[3]
    return slice(y0 // size * size, -(-y1 // size) * size)


def shown(scene: PreparedScene, tiles: Tiles) -> NDArray[np.bool_]:
    """Mask of tiles (T,) that overlap the scene's window."""
    rows, columns = tiles_along(scene.screen, tiles.size)
    is_shown = np.ones((rows, columns), bool)
    if scene.window is not None:
        x0, y0, x1, y1 = scene.window
        left, top = tiles.size * np.arange(columns), tiles.size * np.arange(rows)
        is_shown &= (left < x1) & (left + tiles.size > x0)
        is_shown &= ((top < y1) & (top + tiles.size > y0))[:, np.newaxis]
    return is_shown.reshape(-1)
