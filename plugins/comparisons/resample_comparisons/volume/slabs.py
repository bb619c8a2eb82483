"""Paint sheets, slabs and fields in runs of neighbours; tiles project only runs that they show.

See `resample_comparisons.volume.kernels.slabs`. Splats of exact footprint take a faster path.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from resample.painting.runs import Output, RunPainter, paint_at_once, plan_of, planned
from resample.painting.scenes.plans import MIXTURE, SPLATS
from resample.painting.scenes.scene import Clock, PaintTarget, PreparedScene
from resample.painting.splats import (
    are_splats_exact,
    count_of_points,
    may_have_points,
    mixture_of,
    runs_of,
)
from resample.profiles.orders import Summing
from resample.profiles.reconstruction import (
    Reconstruction,
    density_profile,
    footprint_profile,
    product_profile,
)
from resample.types import (
    ADDITIVE,
    AVERAGE,
    FIRST_HIT,
    MAXIMUM,
    MOST_COLUMNS,
    Doubles,
    Indices,
    Runs,
    Samples,
    Single,
    Statistics,
    Tiles,
)
from resample.watching import Progress

if TYPE_CHECKING:
    from resample_comparisons.volume.kernels.slabs.blends import Blend
    from resample_comparisons.volume.kernels.slabs.integrals import Integral
    from resample_comparisons.volume.kernels.slabs.painting import Summed

# Minimum of sub-pixels per side of a pixel where all tiles have one resolution: sums must fit, and
# surfaces must end sharply.
FEWEST = {ADDITIVE: 1, FIRST_HIT: 3}
MEASURING = (MAXIMUM, AVERAGE, ADDITIVE)


@dataclass(frozen=True)
class SummedPainter:
    """Sums samples by sheets, slabs or altogether before it composites the sums."""

    reconstruction: Reconstruction

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        clock = Clock()
        scene, runs = _planned(scene, samples)
        scene, by = self._by_runs(scene)
        clock.lap("project")
        return paint_at_once(scene, by, runs, clock, progress)

    def _by_runs(self, scene: PreparedScene) -> tuple[PreparedScene, RunPainter]:
        """Painter of sums, on tiles that are as fine as the projection needs."""
        from resample.engine.mixtures.deferred import find_spacings
        from resample_comparisons.volume.kernels.slabs.painting import Ways, paint_summed_runs

        scene = _as_fine(scene, plan_of(scene).least)
        mixture, summed, stage = mixture_of(scene), _sums_of(scene), scene.stage
        are_mixed = mixture is not None
        blend = _blend_of(scene, is_mixed=are_mixed)
        ways = Ways(_integral_of(scene, self.reconstruction), summed, blend)

        def paint(turn: Indices, tiles: Tiles, runs: Runs, output: Output) -> None:
            paint_summed_runs(turn, tiles, runs, stage, ways, mixture, output)

        return scene, RunPainter(
            lambda tiles, runs: find_spacings(tiles, runs, stage, are_mixed),
            paint,
            lambda tiles, runs: count_of_points(scene, tiles, runs) if are_mixed else 0,
            scene.style.projection in MEASURING,
        )


def _columns_of(scene: PreparedScene, least: Single) -> int:
    """Limit on sub-pixels in a row of a tile, for a smallest spacing of samples."""
    from resample.engine.subpixels import grid_of
    from resample_comparisons.volume.kernels.slabs.sums import NARROW

    return NARROW if _is_narrow(scene, grid_of(least, scene.style)) else MOST_COLUMNS


def _as_fine(scene: PreparedScene, least: Single) -> PreparedScene:
    """Scene with all tiles as fine as the finest, if the projection requires it."""
    from resample.engine.subpixels import grid_of

    fewest = FEWEST.get(scene.style.projection, 0)
    if not fewest or scene.style.subpixels:
        return scene
    finest = max(fewest, grid_of(least, scene.style))
    return replace(scene, style=scene.style._replace(subpixels=finest))


def _planned(scene: PreparedScene, samples: Samples) -> tuple[PreparedScene, Runs]:
    """Scene with a plan, as fine as the projection requires, and its samples in runs."""
    runs, painter = _runs_of(scene, samples)
    least = runs.known["least_spacing"].min()
    fine = _as_fine(scene, least)
    if fine is not scene:
        scene = fine
        runs, painter = _runs_of(scene, samples)
    scene = planned(scene, painter, runs, _columns_of(scene, least))
    return replace(scene, plan=plan_of(scene)._replace(least=least)), _keyed(scene, runs)


def _runs_of(scene: PreparedScene, samples: Samples) -> tuple[Runs, str]:
    if are_splats_exact(scene):
        runs = runs_of(scene, samples, are_mixed=False)
        if not may_have_points(scene, runs):
            return runs, SPLATS
    return runs_of(scene, samples, are_mixed=True), MIXTURE


def _is_narrow(scene: PreparedScene, finest: int) -> bool:
    """Whether rows of tiles with so many sub-pixels per side of a pixel fit in a narrow ring."""
    from resample_comparisons.volume.kernels.slabs.sums import NARROW

    return (1 + 2 * scene.tables.pixel_margin) * finest <= NARROW


def _sums_of(scene: PreparedScene) -> "Summed":
    """Sums of a planned scene."""
    from resample.engine.subpixels import grid_of
    from resample_comparisons.volume.kernels.slabs.painting import ALL, PARTS, WHOLES, Summed
    from resample_comparisons.volume.kernels.slabs.sums import Narrow, Wide

    layers, finest = scene.layers, grid_of(plan_of(scene).least, scene.style)
    ring = Narrow if _is_narrow(scene, finest) else Wide
    if scene.style.projection in (AVERAGE, ADDITIVE):
        return Summed(ALL, layers.thickness, layers, ring(1))
    if scene.summing is Summing.SHEETS:
        return Summed(WHOLES, layers.thickness, layers, ring(1))
    reach = math.sqrt(scene.ellipsoid.covariance[2, 2])
    slots = math.ceil(2 * reach / layers.thickness) + 2
    return Summed(PARTS, layers.thickness, layers, ring(slots))


def _keyed(scene: PreparedScene, runs: Runs) -> Runs:
    """Runs, with keys of sheets if whole splats are summed by sheets."""
    from resample.engine.mixtures.keys import find_first_sheets

    is_one_sum = scene.style.projection in (AVERAGE, ADDITIVE)
    if scene.summing is Summing.SHEETS and not is_one_sum:
        find_first_sheets(runs, scene.layers, scene.view)
    return runs


def _blend_of(scene: PreparedScene, *, is_mixed: bool) -> "Blend":
    """Compositing of sums; mixtures are already tinted."""
    from resample_comparisons.volume.kernels.slabs.blends import Colors, Mixed, Values

    style, look = scene.style, scene.classifier
    if look is None:
        if is_mixed:
            return Mixed(style.linear_opacity, style.layer)
        tint = (float(style.tint_red), float(style.tint_green), float(style.tint_blue))
        return Colors(*tint, style.linear_opacity, style.layer)
    mass = 0.0
    if style.projection == ADDITIVE and not scene.view.perspective:
        mass = float(scene.ellipsoid.volume * scene.view.focal[0] * scene.view.focal[1])
    return Values(
        look,
        style.projection,
        style.iso,
        style.linear_opacity,
        style.layer,
        scene.ellipsoid.volume ** (1 / 3),
        style.projection in (AVERAGE, ADDITIVE),
        mass,
    )


def _integral_of(scene: PreparedScene, reconstruction: Reconstruction) -> "Integral":
    from resample_comparisons.volume.kernels.slabs.integrals import (
        Product,
        Smooth,
        TabulatedIntegral,
    )

    whole, density = footprint_profile(reconstruction), density_profile(reconstruction)
    factors = product_profile(reconstruction)
    if whole is not None and factors is not None:
        across, along, rim = factors
        return Product(whole, _singles(across), _singles(along / np.arange(1, 18, 2)), rim)
    if whole is None or density is None:
        part = scene.tables.partial
        return TabulatedIntegral(scene.tables.footprint, part.reshape(-1), part.shape[1] - 1)
    return Smooth(whole, *_partial(density))


def _partial(density: Doubles) -> list[tuple[np.float32, ...]]:
    """Polynomial coefficients of integrals up to a position, see `integrals`."""
    count = len(density)
    return [
        _singles([(-1) ** m / (2 * m + 1) * density[j] * math.comb(j, m) for j in range(m, count)])
        for m in range(count)
    ]


def _singles(numbers: ArrayLike) -> tuple[np.float32, ...]:
    return tuple(np.asarray(numbers, np.float32))
