"""Paint a window in steps from front to back: parts behind opaque tiles are never loaded.

Tiles keep their state between steps. Each step paints the samples that are nearer than any part not
loaded yet; the others wait.
"""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from resample.painting.runs import dealt, film_of, plan_of, shown, tile_order, values_of
from resample.painting.scenes.cuts import NEVER, Between, EndOfStep, RunPainter, cut_at, keys_of
from resample.painting.scenes.plans import SamplesInParts
from resample.painting.scenes.scene import (
    PaintTarget,
    PreparedScene,
    check_samples,
    nothing_painted,
    samples_of,
    tiles_along,
)
from resample.profiles.orders import Summing, sheets_of
from resample.types import Field, Floats, Indices, Samples, Tiles
from resample.watching import Progress, report, told

if TYPE_CHECKING:
    from resample.engine.ellipsoids.steps import Carried, Step

BORDER = 1.0  # px, largest rounding error of bounds

Flags = NDArray[np.bool_]


def state_bytes(scene: PreparedScene, by: RunPainter) -> int:
    """Bytes of a window's state between steps, without samples."""
    return 4 * by.kept * int(_subpixels(scene, _tiles_of(scene)).sum())


def paint_in_steps(
    scene: PreparedScene, by: RunPainter, source: SamplesInParts, progress: Progress | None
) -> PaintTarget:
    """Paint a window of a picture.

    `progress`: called with the fraction of samples that are painted or hidden.
    """
    from resample.engine.ellipsoids.steps import OPAQUE

    tiles = _tiles_of(scene)
    carried, are_shown = _initial_state(scene, by, tiles), shown(scene, tiles)
    painted = nothing_painted(0, 0, tiles.spacing.size)
    painted = painted._replace(plan=scene.plan, film=film_of(scene, tiles))
    if by.is_measuring:
        painted = painted._replace(value=values_of(scene, tiles))
    near, _, slack = keys_of(scene, source)
    left, total, waiting = np.argsort(near, kind="stable"), int(source.sizes.sum()), None
    while left.size or waiting is not None:
        with told(None):
            are_open = are_shown & (carried.state < OPAQUE)
            left = left[_are_open(scene, tiles, carried, source.bounds[left])]
            samples, left = _with_next(source, left, waiting)
            first = near[left[0]] if left.size else np.float32(np.inf)
            end = cut_at(scene, by.between, first, slack)
            step = carried.step._replace(last=end.last, due=end.due)
            waiting = None
            if samples is not None:
                carried = carried._replace(step=step)
                _paint_step(scene, by, samples, carried, are_open, painted)
                waiting = _samples_to_keep(scene, by, samples, end) if left.size else None
            carried = carried._replace(step=_next_step(step, by.between, end))
        done = total - int(source.sizes[left].sum())
        report(done, total)
        if progress is not None:
            progress(done / max(1, total))
    return painted


def _next_step(step: "Step", between: Between, end: EndOfStep) -> "Step":
    """Next step, with the end left open."""
    again = end.again if between is Between.SLABS else end.last
    counts = between in (Between.SLABS, Between.LAYERS)
    return step._replace(again=again, first=end.last, done=end.due if counts else step.done)


def _tiles_of(scene: PreparedScene) -> Tiles:
    """Tiles of a planned scene, without members."""
    plan = plan_of(scene)
    rows, columns = tiles_along(scene.screen, plan.tile)
    spacing = plan.spacing
    if spacing is None:
        spacing = np.full(rows * columns, plan.least, np.float32)
    nobody = np.zeros(spacing.size + 1, np.int64), np.zeros(0, np.int32)
    return Tiles(*nobody, spacing, plan.tile, columns)


def _subpixels(scene: PreparedScene, tiles: Tiles) -> Indices:
    """Number of sub-pixels of each tile (T,) of the window."""
    from resample.engine.ellipsoids.steps import count_subpixels

    count = np.zeros(tiles.spacing.size, np.int64)
    count_subpixels(tiles, scene.stage, shown(scene, tiles), count)
    return count


def _initial_state(scene: PreparedScene, by: RunPainter, tiles: Tiles) -> "Carried":
    """State of the tiles before the first step."""
    from resample.engine.ellipsoids.steps import Carried, Step

    start = np.concatenate([[0], np.cumsum(_subpixels(scene, tiles))])
    number = np.empty(by.kept * int(start[-1]), np.float32)
    behind = np.float32(-np.inf)
    state, is_open = np.zeros(tiles.spacing.size, np.uint8), _all_open(scene, tiles)
    step = Step(behind, behind, behind, -NEVER, -NEVER)
    return Carried(number, by.kept, start, state, is_open, step)


def _all_open(scene: PreparedScene, tiles: Tiles) -> Flags:
    """Mask of pixels (T, S, S) with those of the window open."""
    is_open = np.zeros((tiles.spacing.size, tiles.size, tiles.size), bool)
    is_open[shown(scene, tiles)] = True
    return is_open


def _are_open(scene: PreparedScene, tiles: Tiles, carried: "Carried", bounds: Floats) -> Flags:
    """Mask of bounds (N, 4), px, that contain an open pixel."""
    (rows, columns), side = tiles_along(scene.screen, tiles.size), tiles.size
    is_open = carried.is_open.reshape(rows, columns, side, side).swapaxes(1, 2)
    height, width = rows * side, columns * side
    count = np.zeros((height + 1, width + 1), np.int32)
    is_open.reshape(height, width).cumsum(axis=0, out=count[1:, 1:])
    count.cumsum(axis=1, out=count)
    margin = (scene.screen.margin + BORDER) * np.array([-1, -1, 1, 1])
    size = np.array([width, height])
    at = np.floor(np.clip(bounds + margin, -1.0, 2.0**30)).astype(np.int64)
    left, top = np.clip(at[:, :2], 0, size).T
    right, bottom = np.clip(at[:, 2:] + 1, 0, size).T
    met = count[bottom, right] - count[top, right] - count[bottom, left] + count[top, left]
    return np.asarray(met > 0)


def _with_next(
    source: SamplesInParts, left: Indices, waiting: Samples | None
) -> tuple[Samples | None, Indices]:
    """Waiting samples plus those of the next parts, at least one; and the parts after these."""
    taken = max(1, int(np.searchsorted(source.sizes[left].cumsum(), source.step, "right")))
    found = [waiting] if waiting is not None else []
    if left.size:
        loaded = source.load(left[:taken])
        found.append(samples_of(loaded) if isinstance(loaded, Field) else check_samples(loaded))
    return _concatenated(found), left[taken:]


def _concatenated(parts: list[Samples]) -> Samples | None:
    """Concatenate samples of parts; None if there are none."""
    some = [part for part in parts if len(part.extinction)]
    if len(some) < 2:
        return some[0] if some else None
    position, color, extinction = (
        np.concatenate(column) for column in zip(*(part[:3] for part in some), strict=True)
    )
    scales = [part.scale for part in some if part.scale is not None]
    scale = np.concatenate(scales) if scales else None
    return Samples(position, color, extinction, some[0].lattice, scale)


def _paint_step(
    scene: PreparedScene,
    by: RunPainter,
    samples: Samples,
    carried: "Carried",
    are_open: Flags,
    painted: PaintTarget,
) -> None:
    """Paint the samples of a step on open tiles."""
    runs = by.runs(samples)
    runs.known["seen"][runs.known["key"] >= carried.step.last] = 0
    tiles, load = dealt(scene, runs)
    turn = tile_order(load, are_open)
    if turn.size:
        by.paint(turn, tiles, runs, (painted.film, painted.value, painted.tally, carried))


def _samples_to_keep(
    scene: PreparedScene, by: RunPainter, samples: Samples, end: EndOfStep
) -> Samples | None:
    """Samples to keep for the next step; None if there are none."""
    summing = Summing.SHEETS if by.between is Between.SHEETS else Summing.POINTS
    key = sheets_of(scene.layers, summing, samples.position, scene.view).key
    are_left = np.flatnonzero(key >= end.again)
    if not are_left.size:
        return None
    position, color, extinction = (column[are_left] for column in samples[:3])
    scale = None if samples.scale is None else samples.scale[are_left]
    return Samples(position, color, extinction, samples.lattice, scale)
