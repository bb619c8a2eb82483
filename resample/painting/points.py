"""Paint points in runs of neighbours; only tiles that show a run project its points.

The fast path for scenes whose samples are all points, with a smooth filter; others are a mixture
(`resample.painting.splats`). See `resample.engine.points.runs`.
"""

import math

import numpy as np

from resample.painting.runs import (
    RUN_EXTENT,
    Output,
    RunPainter,
    breaks,
    paint_at_once,
    plan_of,
    planned,
)
from resample.painting.scenes.plans import POINTS, PicturePlan
from resample.painting.scenes.scene import Clock, PaintTarget, PreparedScene, size_of_tiles
from resample.profiles.orders import Summing
from resample.types import (
    MOST_COLUMNS,
    RUN,
    Indices,
    Profile,
    Runs,
    Samples,
    Spread,
    Statistics,
    Tiles,
)
from resample.watching import Progress

CROWD = 4096  # samples per cell of a sheet, so that their sums are exact
LONGEST_RUN = 256  # samples
PRECISION = 2.0**-22  # relative, of depths; sheets must be thicker to be numbered without gaps
NARROWEST = 0.51  # sub-pixels, smallest radius of a filter, so that it covers a sub-pixel center


def can_defer_points(scene: PreparedScene) -> bool:
    """Whether these choices allow deferred points; samples are checked later."""
    style, layers = scene.style, scene.layers
    is_of_depth = layers.axis == tuple(scene.view.rotation[2]) and layers.eye == -np.inf
    return (
        scene.summing is Summing.POINTS
        and (is_of_depth or layers.is_around)
        and layers.thickness == style.layer
        and style.inflated == style.blurred == 0
    )


def _outlined(scene: PreparedScene, samples: Samples) -> Runs:
    """Runs of samples, as if all were points."""
    from resample.engine.points.outlines import outline_point_runs

    extent = RUN_EXTENT * min(1.0, scene.layers.thickness / scene.ellipsoid.volume ** (1 / 3))
    start = breaks(scene, samples, extent, LONGEST_RUN)
    known = np.zeros(start.size - 1, RUN)
    outline_point_runs(known, start, samples, scene.stage)
    return Runs(samples, start, known)


def _are_points(scene: PreparedScene, most: float) -> bool:
    """Whether samples up to this spacing are points at any resolution."""
    style = scene.style
    finest = style.subpixels or max(style.most_for_splats, style.most_for_points)
    return bool(most * finest <= style.threshold)


def _form_of(scene: PreparedScene, plan: PicturePlan, finest: int) -> Spread | None:
    """Filter of points; None if the filter, rows, sheets or crowds do not fit."""
    from resample.engine.points.outlines import TOO_WIDE
    from resample.engine.points.runs import MOST_TAPS

    style, ellipsoid = scene.style, scene.ellipsoid
    least, most = float(plan.least), float(plan.most)
    if not most < TOO_WIDE:  # NaN included
        return None
    widest = math.sqrt(style.variance * (most * finest) ** 2 + 1 / 12)
    narrowest = math.sqrt(1 / 12)
    thinnest = np.linalg.svd(ellipsoid.from_unit, compute_uv=False)[-1] / ellipsoid.radius
    area = ellipsoid.volume / (style.layer * thinnest**2) * (most * finest) ** 2
    crowd = style.layer / ellipsoid.volume ** (1 / 3) / (least * finest) ** 2
    reach = style.point_extent * narrowest
    margin = scene.tables.pixel_margin
    columns = (size_of_tiles(finest, margin) + 2 * margin) * finest
    if 2 * style.point_extent * widest > MOST_TAPS or reach < NARROWEST:
        return None
    if crowd > CROWD or columns > MOST_COLUMNS or plan.farthest * PRECISION > style.layer:
        return None
    opacity = -math.expm1(-plan.strongest * style.layer)
    return Spread(
        style.point_extent,
        style.variance,
        most,
        style.layer,
        _power_of_two(area * opacity),
        _power_of_two(area),
        columns + 2 * MOST_TAPS,
    )


def _power_of_two(number: float) -> float:
    """Smallest power of two that is not below a number."""
    return 2.0 ** math.ceil(math.log2(max(number, 1e-300)))


def points_by_runs(scene: PreparedScene, profile: Profile) -> RunPainter:
    """Painter of points for a planned scene."""
    from resample.engine.points.outlines import find_point_spacings
    from resample.engine.points.runs import paint_point_runs
    from resample.engine.subpixels import grid_of

    stage, plan = scene.stage, plan_of(scene)
    form = _form_of(scene, plan, grid_of(plan.least, scene.style))
    if form is None:
        raise RuntimeError("a plan of points has a filter that fits")

    def paint(turn: Indices, tiles: Tiles, runs: Runs, output: Output) -> None:
        film, _, tally = output
        paint_point_runs(turn, tiles, runs, stage, profile, form, (film, tally))

    return RunPainter(
        lambda tiles, runs: find_point_spacings(tiles, runs, stage),
        paint,
        lambda _, runs: int(runs.known["seen"].sum()),
    )


def paint_points(
    scene: PreparedScene,
    samples: Samples,
    profile: Profile,
    progress: Progress | None,
) -> tuple[PaintTarget, Statistics] | None:
    """Paint samples as points; None if some are not points or their filter is unsuitable.

    `progress`: called with the fraction of the work done.
    """
    from resample.engine.subpixels import grid_of

    clock = Clock()
    runs = _outlined(scene, samples)
    most = runs.known["most_spacing"].max()
    if not (_are_points(scene, most) and runs.known["seen"].any()):
        return None
    scene = planned(scene, POINTS, runs, MOST_COLUMNS)
    plan = plan_of(scene)
    if _form_of(scene, plan, grid_of(plan.least, scene.style)) is None:
        return None
    clock.lap("project")
    return paint_at_once(scene, points_by_runs(scene, profile), runs, clock, progress)
