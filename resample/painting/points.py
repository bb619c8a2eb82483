"""Points in runs of neighbours, which only those tiles project that show them.

The quick way for scenes in which all samples are points under a filter that is smooth; others are
a mixture (`resample.painting.splats`). See `resample.engine.points.runs`.
"""

import math

import numpy as np

from resample.painting.plans import POINTS, PicturePlan
from resample.painting.runs import (
    RUN_EXTENT,
    breaks,
    counted,
    dealt,
    paint_tiles,
    plan_of,
    planned,
)
from resample.painting.scene import Clock, Painted, Scene, size_of_tiles
from resample.profiles.orders import Summing
from resample.types import (
    MOST_COLUMNS,
    RUN,
    Film,
    Indices,
    Profile,
    Runs,
    Samples,
    Spread,
    Statistics,
    Tally,
)
from resample.watching import Progress

CROWD = 4096  # samples that may fall in one cell of a sheet, for sums of them to be exact
LONGEST_RUN = 256  # samples
PRECISION = 2.0**-22  # of depths; sheets that are thinner have numbers that jump
NARROWEST = 0.51  # sub-pixels that a filter must reach, so that it meets one


def can_defer_points(scene: Scene) -> bool:
    """Whether the choices that were made can be painted so; `_runs_of` then looks at samples."""
    style, layers = scene.style, scene.layers
    is_of_depth = layers.axis == tuple(scene.view.rotation[2]) and layers.eye == -np.inf
    return (
        scene.summing is Summing.POINTS
        and (is_of_depth or layers.is_around)
        and layers.thickness == style.layer
        and style.inflated == style.blurred == 0
    )


def _runs_of(scene: Scene, samples: Samples) -> Runs | None:
    """Samples in runs; None if there is no plan yet, and one is no point or none is seen."""
    from resample.engine.points.outlines import outline_point_runs

    extent = RUN_EXTENT * min(1.0, scene.layers.thickness / scene.ellipsoid.volume ** (1 / 3))
    start = breaks(scene, samples, extent, LONGEST_RUN)
    known, style = np.zeros(start.size - 1, RUN), scene.style
    outline_point_runs(known, start, samples, scene.stage)
    if scene.plan is not None:
        return Runs(samples, start, known)
    finest = style.subpixels or max(style.most_for_splats, style.most_for_points)
    is_point = known["most_spacing"].max() * finest <= style.threshold
    return Runs(samples, start, known) if is_point and known["seen"].any() else None


def _form_of(scene: Scene, plan: PicturePlan, finest: int) -> Spread | None:
    """How points are spread; None if filters, rows, sheets or crowds do not fit."""
    from resample.engine.points.runs import MOST_TAPS

    style, ellipsoid = scene.style, scene.ellipsoid
    least, most = plan.least, float(plan.most)
    widest = math.sqrt(style.variance * (most * finest) ** 2 + 1 / 12) if style.variance else finest
    narrowest = math.sqrt(1 / 12) if style.variance else 1.0
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
    """Smallest one that is not below a number."""
    return 2.0 ** math.ceil(math.log2(max(number, 1e-300)))


def paint_points(
    scene: Scene,
    samples: Samples,
    profile: Profile,
    progress: Progress | None,
) -> tuple[Painted, Statistics] | None:
    """Picture of samples, or None if some are no points or their filter is no such.

    Parameters
    ----------
    scene
        Of which `can_defer_points` is true.
    samples
        As `check_samples` gives them; the nearer neighbours are in memory, the better.
    profile
        Of the filter of points, see `resample.profiles.filters.profile`.
    progress
        Called with the share of the work that is done.
    """
    from resample.engine.grid import grid
    from resample.engine.points.outlines import find_point_spacings
    from resample.engine.points.runs import paint_point_runs

    clock = Clock()
    runs = _runs_of(scene, samples)
    if runs is None:
        return None
    scene = planned(scene, POINTS, runs, MOST_COLUMNS)
    plan = plan_of(scene)
    form = _form_of(scene, plan, grid(plan.least, scene.style))
    if form is None:
        return None
    clock.lap("project")
    stage = scene.stage
    deal = dealt(scene, runs, lambda tiles: find_point_spacings(tiles, runs, stage))
    clock.lap("bin")

    def paint(turn: Indices, output: tuple[Film, Tally]) -> None:
        paint_point_runs(turn, deal[0], runs, stage, profile, form, output)

    painted = paint_tiles(paint, scene, deal, progress)
    clock.lap("paint")
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    return painted, counted(statistics, runs, int(runs.known["seen"].sum()))
