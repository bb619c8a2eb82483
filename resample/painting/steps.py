"""Windows whose samples come part by part, nearest first: what is behind opaque tiles stays away.

Between steps tiles are kept as they are by then. Each step paints those samples that are nearer
than any part that was not loaded yet; the others wait.
"""

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.layers import sheets_of
from resample.painting.plans import SPLATS, PicturePlan
from resample.painting.runs import dealt, film_of, plan_of, shown, turn_of
from resample.painting.scene import (
    Painted,
    Scene,
    check_samples,
    nothing_painted,
    size_of_tiles,
    tiles_along,
)
from resample.painting.splats import runs_of
from resample.types import Doubles, Floats, Formula, Indices, Samples, Single, Tiles
from resample.watching import Progress, look, told

if TYPE_CHECKING:
    from resample.engine.ellipsoids.steps import Carried

SLACK = 1e-5  # share of lengths in a scene that rounding may take away, at most
BORDER = 1.0  # px, likewise of bounds

Flags = NDArray[np.bool_]


class SamplesInParts(NamedTuple):
    """Samples in parts that are loaded when it is their turn; none of them is in two."""

    center: Doubles  # (P, 3) of balls around the places of each part's samples, scene units
    radius: Doubles  # (P,) of the same
    bounds: Floats  # (P, 4) left, top, right and bottom of their footprints, px
    sizes: Indices  # (P,) samples of each, at most
    lattice: Doubles  # (3, 3) as of `Samples`
    load: Callable[[Indices], Samples]  # gives those of some parts, in any order
    step: int  # samples that are loaded together, or more where no part is that small


def plan_of_parts(scene: Scene, source: SamplesInParts) -> PicturePlan | None:
    """Plan of splats of exact footprint, if places of parts say enough; None: they do not.

    They do where sub-pixels of the whole picture are as fine, and no sample may be a point.
    """
    from resample.engine.grid import grid

    least, most = _spacings(scene, source)
    finest = grid(least, scene.style)
    if finest != grid(most, scene.style) or least * finest <= scene.style.threshold:
        return None
    low, high = source.bounds[:, :2].min(axis=0), source.bounds[:, 2:].max(axis=0)
    return PicturePlan(
        SPLATS,
        (scene.screen.height, scene.screen.width),
        size_of_tiles(finest, scene.tables.pixel_margin),
        scene.screen.margin,
        np.float32(least),
        np.float32(most),
        np.inf,
        np.inf,
        scene.layers,
        (float(low[0]), float(low[1]), float(high[0]), float(high[1])),
        int(source.sizes.sum()),
    )


def _spacings(scene: Scene, source: SamplesInParts) -> tuple[float, float]:
    """No less and no more are spacings of samples, px; 0 where one may be cut by the near plane.

    As `_spacings_of` of `resample.engine.ellipsoids.run_bounds`, of balls.
    """
    view, ellipsoid = scene.view, scene.ellipsoid
    center = source.center @ view.rotation.T + view.translation
    half = source.radius + SLACK * (np.abs(center).sum(axis=1) + np.abs(view.translation).sum())
    v, (fx, fy), z = ellipsoid.covariance, view.focal, center[:, 2]
    near = z - half
    front = near.min() - np.sqrt(v[2, 2])
    if front <= view.near or (view.perspective and front <= 0):
        return 0.0, np.inf
    x, y = center[:, :2].T / z if view.perspective else np.zeros((2, len(z)))
    xx = fx * fx * (v[0, 0] - 2 * x * v[0, 2] + x * x * v[2, 2])
    yy = fy * fy * (v[1, 1] - 2 * y * v[1, 2] + y * y * v[2, 2])
    xy = fx * fy * (v[0, 1] - x * v[1, 2] - y * v[0, 2] + x * y * v[2, 2])
    mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
    largest = np.sqrt(mean + np.sqrt(np.maximum(0.0, mean * mean - determinant)))
    largest /= ellipsoid.radius
    if not view.perspective:
        return (1 - SLACK) * float(largest.min()), (1 + SLACK) * float(largest.max())
    turn = np.hypot(half + np.abs(x) * half, half + np.abs(y) * half) / near
    change = max(fx, fy) * turn * np.sqrt(v[2, 2]) / ellipsoid.radius
    least, most = (largest - change) / (z + half), (largest + change) / near
    return (1 - SLACK) * float(least.min()), (1 + SLACK) * float(most.max())


def bytes_kept(scene: Scene) -> int:
    """What a window takes from step to step, besides samples."""
    from resample.engine.ellipsoids.steps import KEPT

    return 4 * len(KEPT) * int(_subpixels(scene, _tiles_of(scene)).sum())


def most_waiting(scene: Scene, source: SamplesInParts) -> int:
    """Samples that are in memory because parts may be nearer that are not loaded yet, at most."""
    near, far, _ = keys_of(scene, source)
    behind, order = np.argsort(far), np.argsort(near)
    begun = np.append(0, source.sizes[order].cumsum())[:-1]
    ended = np.append(0, source.sizes[behind].cumsum())
    ended = ended[np.searchsorted(far[behind], near[order], "left")]
    return int((begun - ended).max(initial=0))


def paint_in_steps(
    scene: Scene, source: SamplesInParts, formula: Formula, progress: Progress | None
) -> Painted:
    """Window of a picture of splats of exact footprint.

    Parameters
    ----------
    scene
        Has a window, and a plan that knows how fine its tiles are.
    source
        What the window may show, at least.
    formula
        Line integrals of the scene's kernel, and opacities.
    progress
        Called with the share of the samples that were painted or are hidden.
    """
    from resample.engine.ellipsoids.steps import OPAQUE

    tiles = _tiles_of(scene)
    carried, are_shown = _nothing_carried(scene, tiles), shown(scene, tiles)
    painted = nothing_painted(0, 0, tiles.spacing.size)
    painted = painted._replace(plan=scene.plan, film=film_of(scene, tiles))
    near, _, slack = keys_of(scene, source)
    left, total, waiting = np.argsort(near, kind="stable"), int(source.sizes.sum()), None
    while left.size or waiting is not None:
        with told(None):
            are_open = are_shown & (carried.state < OPAQUE)
            left = left[_are_met(scene, tiles, carried, source.bounds[left])]
            samples, left = _with_next(source, left, waiting)
            last = near[left[0]] if left.size else np.float32(np.inf)
            carried = carried._replace(first=carried.last, last=last)
            waiting = None
            if samples is not None:
                _paint_step(scene, samples, formula, carried, are_open, painted)
                waiting = _behind(scene, samples, last - slack)
        done = total - int(source.sizes[left].sum())
        look(done, total)
        if progress is not None:
            progress(done / max(1, total))
    return painted


def keys_of(scene: Scene, source: SamplesInParts) -> tuple[Floats, Floats, Single]:
    """What no key of a part (P,) is below, nor above, and how wrong single keys may be."""
    layers, view = scene.layers, scene.view
    eye = -view.rotation.T @ view.translation
    if layers.is_around:
        place, per_unit = np.linalg.norm(source.center - eye, axis=1), 1.0
    else:
        place = layers.offset + source.center @ np.array(layers.axis)
        per_unit = float(np.linalg.norm(layers.axis))
    if layers.eye > -np.inf:
        place = np.abs(place - layers.eye)
    farthest = float(np.abs(source.center).max(initial=0.0)) + float(np.linalg.norm(eye))
    slack = SLACK * (per_unit * farthest + abs(layers.offset) + float(np.abs(place).max(initial=0)))
    reach = per_unit * source.radius + slack
    near = (place - reach).astype(np.float32)
    near[near == 0] = -np.finfo(np.float32).tiny  # keys of -0 come before those of 0
    return near, (place + reach).astype(np.float32), np.float32(slack)


def _tiles_of(scene: Scene) -> Tiles:
    """Tiles of a scene that was planned, without members."""
    plan = plan_of(scene)
    rows, columns = tiles_along(scene.screen, plan.tile)
    spacing = plan.spacing
    if spacing is None:
        spacing = np.full(rows * columns, plan.least, np.float32)
    nobody = np.zeros(spacing.size + 1, np.int64), np.zeros(0, np.int32)
    return Tiles(*nobody, spacing, plan.tile, columns)


def _subpixels(scene: Scene, tiles: Tiles) -> Indices:
    """Sub-pixels of each tile (T,) of the window."""
    from resample.engine.ellipsoids.steps import count_subpixels

    count = np.zeros(tiles.spacing.size, np.int64)
    count_subpixels(tiles, scene.stage, shown(scene, tiles), count)
    return count


def _nothing_carried(scene: Scene, tiles: Tiles) -> "Carried":
    """Tiles before the first step."""
    from resample.engine.ellipsoids.steps import KEPT, Carried

    start = np.concatenate([[0], np.cumsum(_subpixels(scene, tiles))])
    number = np.empty(len(KEPT) * int(start[-1]), np.float32)
    behind = np.float32(-np.inf)
    state, is_open = np.zeros(tiles.spacing.size, np.uint8), _all_open(scene, tiles)
    return Carried(number, start, state, is_open, behind, behind)


def _all_open(scene: Scene, tiles: Tiles) -> Flags:
    """Pixels of tiles (T, S, S), of those of the window all."""
    is_open = np.zeros((tiles.spacing.size, tiles.size, tiles.size), bool)
    is_open[shown(scene, tiles)] = True
    return is_open


def _are_met(scene: Scene, tiles: Tiles, carried: "Carried", bounds: Floats) -> Flags:
    """Which bounds (N, 4), px, meet a pixel that is open."""
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
    """Samples that wait and those of the next parts, one at least; and the parts after them."""
    taken = max(1, int(np.searchsorted(source.sizes[left].cumsum(), source.step, "right")))
    found = [waiting] if waiting is not None else []
    if left.size:
        found.append(check_samples(source.load(left[:taken])))
    return _together(found), left[taken:]


def _together(parts: list[Samples]) -> Samples | None:
    """All samples of some parts, if there are any."""
    some = [part for part in parts if len(part.extinction)]
    if len(some) < 2:
        return some[0] if some else None
    position, color, extinction = (
        np.concatenate(column) for column in zip(*(part[:3] for part in some), strict=True)
    )
    return Samples(position, color, extinction, some[0].lattice)


def _paint_step(
    scene: Scene,
    samples: Samples,
    formula: Formula,
    carried: "Carried",
    are_open: Flags,
    painted: Painted,
) -> None:
    """Paint samples whose turn it is on tiles that are open."""
    from resample.engine.ellipsoids.deferred import paint_runs

    runs = runs_of(scene, samples, are_mixed=False)
    runs.known["seen"][runs.known["key"] >= carried.last] = 0
    tiles, load = dealt(scene, runs, _find_nothing)
    turn = turn_of(load, are_open)
    if turn.size:
        output = (painted.film, painted.tally, carried)
        paint_runs(turn, tiles, runs, scene.stage, formula, None, output)


def _find_nothing(tiles: Tiles) -> None:
    """Spacings of tiles are known."""


def _behind(scene: Scene, samples: Samples, limit: Single) -> Samples | None:
    """Samples whose keys are not below a limit, if there are any."""
    key = sheets_of(scene.layers, scene.summing, samples.position, scene.view).key
    are_left = np.flatnonzero(key >= limit)
    if not are_left.size:
        return None
    position, color, extinction = (column[are_left] for column in samples[:3])
    return Samples(position, color, extinction, samples.lattice)
