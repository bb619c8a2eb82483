"""Paint samples in runs of neighbours; tiles project only runs that they show.

Splats with exact footprints take a faster path; with other footprints or points, the samples are a
mixture. See `resample.engine.mixtures.deferred`.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from resample.painting import points
from resample.painting.runs import (
    RUN_EXTENT,
    Output,
    RunPainter,
    breaks,
    paint_at_once,
    plan_of,
    planned,
)
from resample.painting.scenes.plans import MIXTURE, SPLATS
from resample.painting.scenes.scene import Clock, PaintTarget, PreparedScene, size_of_tiles
from resample.profiles.filters import PixelFilter, filter_profile
from resample.profiles.reconstruction import Reconstruction, footprint_pieces, footprint_profile
from resample.types import (
    DISC,
    EXACT,
    MOST_COLUMNS,
    RUN,
    Absorbing,
    Formula,
    Indices,
    Linear,
    Pieces,
    Profile,
    Records,
    Runs,
    Samples,
    Statistics,
    Tabulated,
    Tiles,
)
from resample.watching import Progress

if TYPE_CHECKING:
    from resample.engine.ellipsoids.mixed import Mixture

LONGEST_RUN = 64  # samples


def are_splats_exact(scene: PreparedScene) -> bool:
    """Whether splats have exact footprints, and may occur."""
    style = scene.style
    is_exact = style.model == EXACT or (style.model == DISC and not scene.view.perspective)
    return is_exact and style.threshold < np.inf and style.inflated == style.blurred == 0


def runs_of(scene: PreparedScene, samples: Samples, *, are_mixed: bool) -> Runs:
    """Runs of samples, with bounds that are valid only for splats unless `are_mixed`."""
    from resample.engine.ellipsoids.run_bounds import outline_runs
    from resample.engine.subpixels import grid_of

    start = breaks(scene, samples, RUN_EXTENT, LONGEST_RUN)
    known = np.zeros(start.size - 1, RUN)
    for by_boxes in (len(scene.screen.planes) == 0 and samples.scale is None, False):
        outline_runs(known, start, samples, scene.stage, are_mixed, by_boxes)
        if not (by_boxes and _is_vague(scene, known, are_mixed=are_mixed)):
            break
    least = known["least_spacing"].min()
    finest, margin = grid_of(least, scene.style), scene.tables.pixel_margin
    columns = (size_of_tiles(finest, margin) + 2 * margin) * finest
    if columns > MOST_COLUMNS:
        raise ValueError(
            f"{finest} sub-pixels per side of a pixel under a filter that reaches {margin} px "
            f"beyond it; at most {MOST_COLUMNS // (1 + 2 * margin)} are possible"
        )
    return Runs(samples, start, known)


def may_have_points(scene: PreparedScene, runs: Runs) -> bool:
    """Whether a sample may be a point."""
    from resample.engine.subpixels import grid_of

    least = runs.known["least_spacing"].min()
    return bool(least * grid_of(least, scene.style) <= scene.style.threshold)


def _is_vague(scene: PreparedScene, known: Records, *, are_mixed: bool) -> bool:
    """Whether bounds of the smallest spacing leave the resolution, or the kind, undecided."""
    from resample.engine.subpixels import grid_of

    least, most = known["least_spacing"].min(), known["most_spacing"]
    finest = grid_of(least, scene.style)
    no_more = most[known["seen"] > 0].min(initial=np.inf)
    if finest != grid_of(no_more, scene.style):
        return True
    return not are_mixed and bool(least * finest <= scene.style.threshold)


def formula_of(scene: PreparedScene, profile: Profile | None, pieces: Pieces | None) -> Formula:
    """Formula of splats: the first of these that is available, otherwise the table."""
    style, peak = scene.style, _peak(scene)
    integral = profile or pieces or Tabulated(scene.tables.footprint)
    return Formula(integral, Linear(style.layer) if style.linear_opacity else Absorbing(peak))


def paint_splats(
    scene: PreparedScene, samples: Samples, formula: Formula, progress: Progress | None
) -> tuple[PaintTarget, Statistics] | None:
    """Paint samples for which `are_splats_exact`; None if some are not splats.

    `progress`: called with the fraction of the work done.
    """
    clock = Clock()
    runs = runs_of(scene, samples, are_mixed=False)
    if may_have_points(scene, runs):
        return None
    scene = planned(scene, SPLATS, runs, MOST_COLUMNS)
    clock.lap("project")
    return paint_at_once(scene, splats_by_runs(scene, formula), runs, clock, progress)


def splats_by_runs(scene: PreparedScene, formula: Formula) -> RunPainter:
    """Painter of splats, or a mixture, for a planned scene."""
    from resample.engine.mixtures.deferred import find_spacings, paint_runs

    mixture, stage = mixture_of(scene), scene.stage
    are_mixed = mixture is not None

    def paint(turn: Indices, tiles: Tiles, runs: Runs, output: Output) -> None:
        film, _, tally = output
        paint_runs(turn, tiles, runs, stage, formula, mixture, (film, tally))

    return RunPainter(
        lambda tiles, runs: find_spacings(tiles, runs, stage, are_mixed),
        paint,
        lambda tiles, runs: count_of_points(scene, tiles, runs) if are_mixed else 0,
    )


def paint_mixture(
    scene: PreparedScene, samples: Samples, formula: Formula, progress: Progress | None
) -> tuple[PaintTarget, Statistics]:
    """Like `paint_splats`, for any samples."""
    clock = Clock()
    runs = runs_of(scene, samples, are_mixed=True)
    scene = planned(scene, MIXTURE, runs, MOST_COLUMNS)
    clock.lap("project")
    return paint_at_once(scene, splats_by_runs(scene, formula), runs, clock, progress)


def mixture_of(scene: PreparedScene) -> "Mixture | None":
    """Parameters for samples of all kinds in a planned scene; None: all are splats."""
    from resample.engine.ellipsoids.mixed import Mixture

    if plan_of(scene).painter != MIXTURE:
        return None
    return Mixture(bool(scene.style.threshold < np.inf), float(plan_of(scene).least))


def count_of_points(scene: PreparedScene, tiles: Tiles, runs: Runs) -> int:
    """Number of visible samples that are points."""
    from resample.engine.ellipsoids.run_bounds import CHUNKS
    from resample.engine.mixtures.deferred import count_points

    count = np.zeros(CHUNKS, np.int64)
    if 0 < scene.style.threshold >= runs.known["least_spacing"].min():
        count_points(tiles, runs, scene.stage, count)
    return int(count.sum())


def _peak(scene: PreparedScene) -> float:
    """Largest line integral of the kernel, through its center along its longest axis."""
    longest = np.sqrt(np.linalg.eigvalsh(scene.ellipsoid.covariance)[-1])
    return float(scene.tables.footprint.max() * scene.ellipsoid.scale * longest)


@dataclass(frozen=True)
class StreamedPainter:
    """Composites splats one by one, and points in layers."""

    reconstruction: Reconstruction
    point_filter: PixelFilter

    @cached_property
    def _profiles(self) -> tuple[Profile | None, Pieces | None]:
        """Line integrals as formulas of one piece and of more, where there are such."""
        return footprint_profile(self.reconstruction), footprint_pieces(self.reconstruction)

    @cached_property
    def _point_profile(self) -> Profile | None:
        """Filter of points as a formula, where there is one."""
        return filter_profile(self.point_filter)

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """As splats if all are, as points if all are, or else as a mixture."""
        painted, formula = None, formula_of(scene, *self._profiles)
        if are_splats_exact(scene):
            painted = paint_splats(scene, samples, formula, progress)
        can_defer = samples.scale is None and points.can_defer_points(scene)
        if painted is None and can_defer and self._point_profile is not None:
            painted = points.paint_points(scene, samples, self._point_profile, progress)
        return painted or paint_mixture(scene, samples, formula, progress)
