"""Sheets, slabs and fields in runs of neighbours, which only those tiles project that show them.

See `resample.engine.slabs.painting`; what is no splat of exact footprint is painted from records.
"""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from resample.deferred import runs_of
from resample.profiles.orders import EverySample, Summing
from resample.profiles.reconstruction import Reconstruction, density_profile, footprint_profile
from resample.runs import counted, dealt, paint_in_steps
from resample.scene import Clock, Painted, Progress, Scene
from resample.types import (
    ADDITIVE,
    AVERAGE,
    DISC,
    EXACT,
    FIRST_HIT,
    MAXIMUM,
    Doubles,
    Layers,
    Samples,
    Statistics,
)

if TYPE_CHECKING:
    from resample.engine.slabs.blends import Blend
    from resample.engine.slabs.integrals import Integral

FEWEST = {ADDITIVE: 1, FIRST_HIT: 3}


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
    from resample.engine.slabs.keys import find_first_sheets
    from resample.engine.slabs.painting import (
        ALL,
        PARTS,
        WHOLES,
        Summed,
        paint_summed_runs,
    )
    from resample.engine.slabs.sums import NARROW, Narrow, Wide

    clock, order = Clock(), EverySample()
    runs = runs_of(scene, samples, order, None)
    if runs is None:
        return None
    style = scene.style
    if style.projection in FEWEST and not style.subpixels:
        finest = grid(runs.known["least_spacing"].min(), style)
        scene = replace(
            scene, style=style._replace(subpixels=max(FEWEST[style.projection], int(finest)))
        )
        runs = runs_of(scene, samples, order, None)
        if runs is None:
            return None
    is_one = style.projection in (AVERAGE, ADDITIVE)
    what = ALL if is_one else WHOLES if scene.summing is Summing.SHEETS else PARTS
    slots = 1
    if what == PARTS:
        reach = math.sqrt(scene.ellipsoid.covariance[2, 2])
        slots = math.ceil(2 * reach / layers.thickness) + 2
    if what == WHOLES:
        find_first_sheets(runs.known, runs.start, samples, layers, scene.view)
    clock.lap("project")
    deal = dealt(scene, runs, find_spacings)
    clock.lap("bin")
    screen = scene.screen
    finest = grid(runs.known["least_spacing"].min(), scene.style)
    columns = (deal[0].size + 2 * scene.tables.pixel_margin) * finest
    ring = Narrow(slots) if columns <= NARROW else Wide(slots)
    is_measuring = scene.style.projection in (MAXIMUM, AVERAGE, ADDITIVE)
    value = np.full((screen.height, screen.width) if is_measuring else (0, 0), np.nan, np.float32)
    own = (_integral_of(scene, reconstruction), Summed(what, layers, ring), _blend_of(scene), value)
    painted, taken = paint_in_steps(paint_summed_runs, own, scene, runs, deal, order, progress)
    clock.lap("paint")
    painted = painted._replace(value=value)
    statistics = painted.statistics(samples.extinction.size, clock.seconds)
    return painted, counted(statistics, runs, taken, None, "splats")


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
