"""Sheets, slabs and fields in runs of neighbours, which only those tiles project that show them.

See `resample.engine.slabs.painting`; what is no splat of exact footprint is painted from records.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from resample.painting.runs import counted, dealt, paint_in_steps
from resample.painting.scene import Clock, Painted, Progress, Scene, size_of_tiles
from resample.painting.splats import runs_of
from resample.profiles.orders import Summing
from resample.profiles.reconstruction import Reconstruction, density_profile, footprint_profile
from resample.types import (
    ADDITIVE,
    AVERAGE,
    DISC,
    EXACT,
    FIRST_HIT,
    MAXIMUM,
    Doubles,
    Film,
    Indices,
    Layers,
    Runs,
    Samples,
    Statistics,
    Tally,
)

if TYPE_CHECKING:
    from resample.engine.slabs.blends import Blend
    from resample.engine.slabs.integrals import Integral
    from resample.engine.slabs.painting import Summed

FEWEST = {ADDITIVE: 1, FIRST_HIT: 3}  # sub-pixels per side of a pixel
MEASURING = (MAXIMUM, AVERAGE, ADDITIVE)


def can_sum(scene: Scene) -> bool:
    """Whether the choices that were made can be painted so; `runs_of` then looks at the samples."""
    style = scene.style
    is_exact = style.model == EXACT or (style.model == DISC and not scene.view.perspective)
    return (
        scene.summing is not Summing.POINTS
        and is_exact
        and style.threshold < np.inf
        and style.inflated == style.blurred == 0
    )


def paint_summed(
    scene: Scene,
    samples: Samples,
    layers: Layers,
    reconstruction: Reconstruction,
    progress: Progress | None,
) -> tuple[Painted, Statistics] | None:
    """Picture of samples that are summed before they are composited; None if one is no splat."""
    from resample.engine.ellipsoids.deferred import find_spacings
    from resample.engine.grid import grid
    from resample.engine.slabs.painting import paint_summed_runs

    clock = Clock()
    runs = runs_of(scene, samples, are_mixed=False)
    if runs is None:
        return None
    least, fewest = runs.known["least_spacing"].min(), FEWEST.get(scene.style.projection, 0)
    if fewest and not scene.style.subpixels:
        subpixels = max(fewest, int(grid(least, scene.style)))
        scene = replace(scene, style=scene.style._replace(subpixels=subpixels))
        runs = runs_of(scene, samples, are_mixed=False)
        if runs is None:
            return None
    summed = _summed(scene, runs, layers)
    clock.lap("project")
    stage = scene.stage
    deal = dealt(scene, runs, lambda tiles: find_spacings(tiles, runs, stage, None))
    clock.lap("bin")
    screen, is_measuring = scene.screen, scene.style.projection in MEASURING
    value = np.full((screen.height, screen.width) if is_measuring else (0, 0), np.nan, np.float32)
    integral, blend = _integral_of(scene, reconstruction), _blend_of(scene)

    def paint(turn: Indices, output: tuple[Film, Tally]) -> None:
        film, tally = output
        paint_summed_runs(turn, deal[0], runs, stage, integral, summed, blend, (film, value, tally))

    painted = paint_in_steps(paint, scene, deal, progress)._replace(value=value)
    clock.lap("paint")
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    return painted, counted(statistics, runs, 0)


def _summed(scene: Scene, runs: Runs, layers: Layers) -> "Summed":
    """What is summed; where these are sheets, runs get keys of sheets."""
    from resample.engine.grid import grid
    from resample.engine.slabs.keys import find_first_sheets
    from resample.engine.slabs.painting import ALL, PARTS, WHOLES, Summed
    from resample.engine.slabs.sums import NARROW, Narrow, Wide

    margin = scene.tables.pixel_margin
    finest = grid(runs.known["least_spacing"].min(), scene.style)
    is_narrow = (size_of_tiles(finest, margin) + 2 * margin) * finest <= NARROW
    ring = Narrow if is_narrow else Wide
    if scene.style.projection in (AVERAGE, ADDITIVE):
        return Summed(ALL, layers.thickness, None, ring(1))
    if scene.summing is Summing.SHEETS:
        find_first_sheets(runs, layers, scene.view)
        return Summed(WHOLES, layers.thickness, layers, ring(1))
    reach = math.sqrt(scene.ellipsoid.covariance[2, 2])
    slots = math.ceil(2 * reach / layers.thickness) + 2
    return Summed(PARTS, layers.thickness, None, ring(slots))


def _blend_of(scene: Scene) -> "Blend":
    from resample.engine.slabs.blends import Colors, Values

    style, look = scene.style, scene.classifier
    if look is None:
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
    from resample.engine.slabs.integrals import Smooth, Tabulated

    whole, density = footprint_profile(reconstruction), density_profile(reconstruction)
    if whole is None or density is None:
        part = scene.tables.partial
        return Tabulated(scene.tables.footprint, part.reshape(-1), part.shape[1] - 1)
    return Smooth(whole, *_partial(density))


def _partial(density: Doubles) -> list[tuple[np.float32, ...]]:
    """Coefficients of the polynomials that integrals up to a place have, see `integrals`."""
    count = len(density)
    return [
        tuple(
            np.float32((-1) ** m / (2 * m + 1) * density[j] * math.comb(j, m))
            for j in range(m, count)
        )
        for m in range(count)
    ]
