"""Sheets, slabs and fields in runs of neighbours, which only those tiles project that show them.

See `resample.engine.slabs.painting`. Splats of exact footprint take its quicker form.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from resample.painting.plans import MIXTURE, SPLATS
from resample.painting.runs import counted, dealt, paint_tiles, planned
from resample.painting.scene import Clock, Painted, Scene
from resample.painting.splats import count_of_points, may_have_points, mixture_of, runs_of
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
    DISC,
    EXACT,
    FIRST_HIT,
    MAXIMUM,
    MOST_COLUMNS,
    Doubles,
    Film,
    Indices,
    Runs,
    Samples,
    Statistics,
    Tally,
)
from resample.watching import Progress

if TYPE_CHECKING:
    from resample.engine.slabs.blends import Blend
    from resample.engine.slabs.integrals import Integral
    from resample.engine.slabs.painting import Summed

# Sub-pixels per side of a pixel at least, where all tiles have one grid: sums must fit, and
# surfaces end sharply.
FEWEST = {ADDITIVE: 1, FIRST_HIT: 3}
MEASURING = (MAXIMUM, AVERAGE, ADDITIVE)


def paint_summed(
    scene: Scene,
    samples: Samples,
    reconstruction: Reconstruction,
    progress: Progress | None,
) -> tuple[Painted, Statistics]:
    """Picture of samples that are summed before they are composited."""
    from resample.engine.ellipsoids.deferred import find_spacings
    from resample.engine.slabs.painting import Ways, paint_summed_runs

    clock = Clock()
    scene, runs, painter = _seen(scene, samples)
    scene, summed = _summed(scene, runs, painter)
    mixture = mixture_of(scene) if painter == MIXTURE else None
    clock.lap("project")
    stage = scene.stage
    deal = dealt(scene, runs, lambda tiles: find_spacings(tiles, runs, stage, mixture))
    clock.lap("bin")
    screen, is_measuring = scene.screen, scene.style.projection in MEASURING
    value = np.full((screen.height, screen.width) if is_measuring else (0, 0), np.nan, np.float32)
    blend = _blend_of(scene, is_mixed=mixture is not None)
    ways = Ways(_integral_of(scene, reconstruction), summed, blend)

    def paint(turn: Indices, output: tuple[Film, Tally]) -> None:
        film, tally = output
        paint_summed_runs(turn, deal[0], runs, stage, ways, mixture, (film, value, tally))

    painted = paint_tiles(paint, scene, deal, progress)._replace(value=value)
    clock.lap("paint")
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    points = 0 if mixture is None else count_of_points(scene, runs, deal[0])
    return painted, counted(statistics, runs, points)


def _seen(scene: Scene, samples: Samples) -> tuple[Scene, Runs, str]:
    """Samples in runs, as fine as the projection asks for, and by whom they are painted."""
    from resample.engine.grid import grid

    style, fewest = scene.style, FEWEST.get(scene.style.projection, 0)
    runs, painter = _runs_of(scene, samples)
    if fewest and not style.subpixels:
        finest = max(fewest, int(grid(runs.known["least_spacing"].min(), style)))
        scene = replace(scene, style=style._replace(subpixels=finest))
        runs, painter = _runs_of(scene, samples)
    return scene, runs, painter


def _runs_of(scene: Scene, samples: Samples) -> tuple[Runs, str]:
    style, plan = scene.style, scene.plan
    if plan is not None:
        return runs_of(scene, samples, are_mixed=plan.painter == MIXTURE), plan.painter
    is_exact = style.model == EXACT or (style.model == DISC and not scene.view.perspective)
    if is_exact and style.threshold < np.inf and style.inflated == style.blurred == 0:
        runs = runs_of(scene, samples, are_mixed=False)
        if not may_have_points(scene, runs):
            return runs, SPLATS
    return runs_of(scene, samples, are_mixed=True), MIXTURE


def _summed(scene: Scene, runs: Runs, painter: str) -> tuple[Scene, "Summed"]:
    """The scene with a plan, and what is summed.

    Where these are sheets, runs get keys of sheets.
    """
    from resample.engine.grid import grid
    from resample.engine.slabs.keys import find_first_sheets
    from resample.engine.slabs.painting import ALL, PARTS, WHOLES, Summed
    from resample.engine.slabs.sums import NARROW, Narrow, Wide

    margin, layers, plan = scene.tables.pixel_margin, scene.layers, scene.plan
    finest = grid(plan.least if plan else runs.known["least_spacing"].min(), scene.style)
    is_narrow = (1 + 2 * margin) * finest <= NARROW
    ring, columns = (Narrow, NARROW) if is_narrow else (Wide, MOST_COLUMNS)
    scene = planned(scene, painter, runs, columns)
    if scene.style.projection in (AVERAGE, ADDITIVE):
        return scene, Summed(ALL, layers.thickness, layers, ring(1))
    if scene.summing is Summing.SHEETS:
        find_first_sheets(runs, layers, scene.view)
        return scene, Summed(WHOLES, layers.thickness, layers, ring(1))
    reach = math.sqrt(scene.ellipsoid.covariance[2, 2])
    slots = math.ceil(2 * reach / layers.thickness) + 2
    return scene, Summed(PARTS, layers.thickness, layers, ring(slots))


def _blend_of(scene: Scene, *, is_mixed: bool) -> "Blend":
    """How sums are composited; what is mixed has been tinted by then."""
    from resample.engine.slabs.blends import Colors, Mixed, Values

    style, look = scene.style, scene.classifier
    if look is None:
        if is_mixed:
            return Mixed(style.linear_opacity, style.layer, are_beside=not style.variance)
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


def _integral_of(scene: Scene, reconstruction: Reconstruction) -> "Integral":
    from resample.engine.slabs.integrals import Product, Smooth, Tabulated

    whole, density = footprint_profile(reconstruction), density_profile(reconstruction)
    factors = product_profile(reconstruction)
    if whole is not None and factors is not None:
        across, along, rim = factors
        return Product(whole, _singles(across), _singles(along / np.arange(1, 18, 2)), rim)
    if whole is None or density is None:
        part = scene.tables.partial
        return Tabulated(scene.tables.footprint, part.reshape(-1), part.shape[1] - 1)
    return Smooth(whole, *_partial(density))


def _partial(density: Doubles) -> list[tuple[np.float32, ...]]:
    """Coefficients of the polynomials that integrals up to a place have, see `integrals`."""
    count = len(density)
    return [
        _singles([(-1) ** m / (2 * m + 1) * density[j] * math.comb(j, m) for j in range(m, count)])
        for m in range(count)
    ]


def _singles(numbers: ArrayLike) -> tuple[np.float32, ...]:
    return tuple(np.asarray(numbers, np.float32))
