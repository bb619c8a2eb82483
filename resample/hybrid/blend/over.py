"""Section 4.1, volumes: front to back, splats one by one and points as sums of a layer."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step
from resample.engine.lookup import absorbed
from resample.engine.roles import plays
from resample.hybrid.record import POINT
from resample.hybrid.roles import finish, is_open, sample_of, sweeps, touch
from resample.types import Film, Floats, Record, Single

OPAQUE = np.float32(1.0 - 1e-4)  # opacity that counts as all
ZERO, ONE = np.float32(0.0), np.float32(1.0)

# Points of one layer that a pixel has got and not composited yet.
WAITING = np.dtype(
    [
        ("layer", np.int32),
        ("first", np.float32),  # depth of the first of them
        ("red", np.float32),  # sums of what they add
        ("green", np.float32),
        ("blue", np.float32),
        ("opacity", np.float32),
        ("depth", np.float32),
        ("cover", np.float32),  # part of the pixel; 0: no points wait
    ],
    align=True,
)


class OverBlend(NamedTuple):
    """Composite samples that come in depth order.

    A splat's amount is a length, a point's the part of the pixel that it covers. Points do not hide
    each other, as they may be side by side: those of one layer are summed, and the sum is
    composited when the pixel gets anything else.
    """

    color: Floats  # (N, 3) not multiplied by the opacity
    density: Floats  # (N,) a splat's extinction per unit of length; a point's opacity
    is_linear: bool  # a splat's opacity is its density times length (classic α F)
    film: Film  # empty, with depths of 0; image, mean depth, nearest depth and coverage
    points: Record  # (H, W) of WAITING, 0


@plays(sweeps, OverBlend)
def _front_to_back(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 1


@plays(is_open, OverBlend)
def _is_transparent(blend, row, column):  # type: ignore[no-untyped-def]
    return blend.film.rgba[row, column, 3] < OPAQUE


class Composited(NamedTuple):
    """A sample, as it is composited."""

    is_point: bool
    layer: int
    density: Single
    red: Single
    green: Single
    blue: Single
    depth: Single


@plays(sample_of, OverBlend)
def _sample_to_composite(blend, s, n):  # type: ignore[no-untyped-def]
    red, green, blue = blend.color[n, 0], blend.color[n, 1], blend.color[n, 2]
    is_point = s["kind"] == POINT
    return Composited(is_point, s["layer"], blend.density[n], red, green, blue, s["depth"])


@plays(touch, OverBlend)
def _composite(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]  # noqa: ARG001
    points = blend.points[row, column]
    if points["cover"] != ZERO and not (sample.is_point and sample.layer == points["layer"]):
        _composite_points(blend, row, column)
        if blend.film.rgba[row, column, 3] >= OPAQUE:
            return 1
    if sample.is_point:
        _add_point(points, sample, amount)
        return 0
    return _composite_splat(blend, row, column, sample, amount)


@inner_step
def _add_point(points: Record, sample: Composited, amount: Single) -> None:
    """Add a point to the others of its layer."""
    opacity = amount * sample.density
    if points["cover"] == ZERO:
        points["layer"], points["first"] = sample.layer, sample.depth
    points["red"] += opacity * sample.red
    points["green"] += opacity * sample.green
    points["blue"] += opacity * sample.blue
    points["opacity"] += opacity
    points["depth"] += opacity * sample.depth
    points["cover"] += amount


@inner_step
def _composite_splat(
    blend: OverBlend, row: np.uint64, column: np.uint64, sample: Composited, amount: Single
) -> int:
    """Composite a splat; returns 1 if the pixel is opaque then."""
    rgba, film = blend.film.rgba, blend.film
    thick = amount * sample.density
    opacity = min(thick, ONE) if blend.is_linear else absorbed(thick)
    if opacity <= ZERO:
        return 0
    before = rgba[row, column, 3]
    seen = (ONE - before) * opacity
    rgba[row, column, 0] += seen * sample.red
    rgba[row, column, 1] += seen * sample.green
    rgba[row, column, 2] += seen * sample.blue
    rgba[row, column, 3] = before + seen
    film.depth[row, column] += seen * sample.depth
    if film.coverage[row, column] < ONE:
        film.coverage[row, column] = ONE
        if before == ZERO:
            film.first_depth[row, column] = sample.depth
    return int(before + seen >= OPAQUE)


@inner_step
def _composite_points(blend: OverBlend, row: np.uint64, column: np.uint64) -> None:
    """Composite the points that wait; together they hide no more than all of the pixel."""
    points, film, rgba = blend.points[row, column], blend.film, blend.film.rgba
    opacity, cover, before = points["opacity"], points["cover"], rgba[row, column, 3]
    if opacity > ZERO:
        # Filters with negative lobes may leave less than nothing of a color.
        share = (ONE - before) / max(opacity, ONE)
        rgba[row, column, 0] += share * max(points["red"], ZERO)
        rgba[row, column, 1] += share * max(points["green"], ZERO)
        rgba[row, column, 2] += share * max(points["blue"], ZERO)
        rgba[row, column, 3] = before + share * opacity
        film.depth[row, column] += share * points["depth"]
        film.coverage[row, column] += (ONE - film.coverage[row, column]) * max(
            min(cover, ONE), ZERO
        )
        if before == ZERO:
            film.first_depth[row, column] = points["first"]
    points["red"] = points["green"] = points["blue"] = ZERO
    points["opacity"] = points["depth"] = points["cover"] = ZERO


@plays(finish, OverBlend)
def _composite_rest(blend, row, column):  # type: ignore[no-untyped-def]
    _composite_points(blend, row, column)
    opacity = blend.film.rgba[row, column, 3]
    mean = blend.film.depth[row, column] / opacity if opacity > ZERO else np.float32(np.inf)
    blend.film.depth[row, column] = mean
