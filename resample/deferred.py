"""Splats in runs of neighbours, which only those tiles project that show them.

The quick way for what is painted most: splats of exact footprint, composited one by one. All
else is painted from the records of `resample.engine.ellipsoids.footprints`. See
`resample.engine.ellipsoids.deferred`.
"""

import numpy as np

from resample.profiles.orders import EverySample
from resample.runs import (
    RUN_EXTENT,
    Runs,
    breaks,
    counted,
    dealt,
    is_by_distance,
    paint_in_steps,
)
from resample.scene import (
    Clock,
    Painted,
    Progress,
    Scene,
    size_of_tiles,
)
from resample.types import DISC, EXACT, RUN, Blocks, Profile, Records, Samples, Statistics

LONGEST_RUN = 64  # samples


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


def runs_of(
    scene: Scene, samples: Samples, order: EverySample, blocks: Blocks | None
) -> Runs | None:
    """Samples in runs, none of which goes beyond a block; None if one is no splat."""
    from resample.engine.ellipsoids.outlines import outline_runs
    from resample.engine.ellipsoids.rows import MOST_COLUMNS
    from resample.engine.grid import grid

    start = breaks(scene, samples, RUN_EXTENT, LONGEST_RUN, blocks)
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
    from resample.engine.grid import grid

    least, most = known["least_spacing"].min(), known["most_spacing"]
    finest = grid(least, scene.style)
    no_more = most[known["seen"] > 0].min(initial=np.inf)
    return bool(finest != grid(no_more, scene.style) or least * finest <= scene.style.threshold)


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
    from resample.engine.ellipsoids.deferred import find_spacings, paint_runs

    clock = Clock()
    runs = runs_of(scene, samples, order, blocks)
    if runs is None:
        return None
    clock.lap("project")
    deal = dealt(scene, runs, find_spacings)
    clock.lap("bin")
    painted, taken = paint_in_steps(
        paint_runs, (profile, _peak(scene)), scene, runs, deal, order, progress
    )
    clock.lap("paint")
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    return painted, counted(statistics, runs, taken, blocks, "splats")


def _peak(scene: Scene) -> float:
    """Largest line integral of the kernel, through its center along its longest axis."""
    longest = np.sqrt(np.linalg.eigvalsh(scene.ellipsoid.covariance)[-1])
    return float(scene.tables.footprint[0] * scene.ellipsoid.scale * longest)
