"""Blending: sum, nearest surface or over."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, plays
from resample.engine.lookup import absorbed
from resample.hybrid.record import POINT
from resample.hybrid.roles import finish, is_open, sample_of, sweeps, touch
from resample.types import Film, Floats, Record, Single


class WeightedSum(NamedTuple):
    """Weighted sums, to which samples are added batch by batch."""

    color: Floats  # (N, C) of the batch
    image: Floats  # (H, W, C) sums of weights times colors; empty at first
    weight: Floats  # (H, W) sums of weights, 1 where samples cover the pixel; empty at first


def mean_of(blend: WeightedSum, is_inner: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Image, multiplied by its coverage, and coverage (H, W): 1 in pixels full of samples.

    Elsewhere the weight is the coverage, as long as it is no more than 1.
    """
    is_full = (blend.weight > 0.0) & (is_inner | (blend.weight > 1.0))
    coverage = np.where(is_full, np.float32(1.0), np.maximum(blend.weight, np.float32(0.0)))
    share = np.divide(1.0, blend.weight, out=np.ones_like(coverage), where=is_full)
    return blend.image * share[..., None], coverage


@plays(sweeps, WeightedSum)
def _once(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 1


@plays(is_open, WeightedSum)
def _always(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return True


@plays(sample_of, WeightedSum)
def _none(blend, s, n):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 0


@plays(touch, WeightedSum)
def _add(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]  # noqa: ARG001
    for channel in range(blend.color.shape[1]):
        k = np.uint64(channel)
        blend.image[row, column, k] += amount * blend.color[n, k]
    blend.weight[row, column] += amount
    return 0


@plays(finish, WeightedSum)
def _leave(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return


ZERO, HALF, ONE = np.float32(0.0), np.float32(0.5), np.float32(1.0)


class SurfaceRule(NamedTuple):
    """Criteria for two samples on one surface."""

    close: np.float32  # part of the nearness that they may differ by, whatever else is known
    loose: np.float32  # likewise, if no boundary lies between them
    turn: np.float32  # least cosine between their normals then


class NearestSurface(NamedTuple):
    """Mean of the samples on the nearest surface.

    Surfaces are found first and summed after, so that neither order nor threads matter. Where no
    sample's core has been, everything that reaches is added, lest there be pinholes.
    """

    color: Floats  # (N, C)
    slope: Floats  # (N, 2) change of nearness per px, to the right and down
    core: Floats  # (N,) squared index up to which the sample hides what is behind
    label: NDArray[np.int32]  # (N,) samples with no boundary between them have the same
    normal: Floats  # (N, 3) unit
    surface: SurfaceRule
    image: Floats  # (H, W, C) empty; the mean
    weight: Floats  # (H, W) empty
    nearness: Floats  # (H, W) 0; of the surface, 1 / depth; negative: no core has been there
    found: NDArray[np.int32]  # (H, W) sample that it was found by


@plays(sweeps, NearestSurface)
def _find_then_add(blend):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return 2


@plays(is_open, NearestSurface)
def _open_everywhere(blend, row, column):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return True


class SamplePlane(NamedTuple):
    """The plane around a sample, for comparisons."""

    x: Single  # px, where the sample is
    y: Single
    nearness: Single  # there
    across: Single  # change per px to the right
    downward: Single
    core: Single


@plays(sample_of, NearestSurface)
def _plane_of(blend, s, n):  # type: ignore[no-untyped-def]
    across, downward = blend.slope[n, 0], blend.slope[n, 1]
    return SamplePlane(s["x"], s["y"], ONE / s["depth"], across, downward, blend.core[n])


@plays(touch, NearestSurface)
def _touch(blend, sweep, row, column, n, sample, index2, amount):  # type: ignore[no-untyped-def]
    nearness, nearest = _nearness_at(sample, row, column), blend.nearness[row, column]
    if sweep == 0:
        # The nearest core wins.
        if index2 <= sample.core and nearness > nearest:
            blend.nearness[row, column], blend.found[row, column] = nearness, n
        return 0
    if nearest > ZERO and not _is_same_surface(blend, n, row, column, nearness):
        return 0
    if -nearness < nearest <= ZERO:
        blend.nearness[row, column], blend.found[row, column] = -nearness, n
    for channel in range(blend.color.shape[1]):
        k = np.uint64(channel)
        blend.image[row, column, k] += amount * blend.color[n, k]
    blend.weight[row, column] += amount
    return 0


@inner_step
def _nearness_at(sample: SamplePlane, row: np.uint64, column: np.uint64) -> Single:
    """Nearness of a sample's plane in the direction of a pixel."""
    dx, dy = np.float32(column) + HALF - sample.x, np.float32(row) + HALF - sample.y
    return sample.nearness + sample.across * dx + sample.downward * dy


@inner_step
def _is_same_surface(
    blend: NearestSurface, n: np.uint64, row: np.uint64, column: np.uint64, nearness: Single
) -> bool:
    """Whether sample n, of this nearness at a pixel, is on the surface found there."""
    behind = ONE - nearness / blend.nearness[row, column]
    if behind <= blend.surface.close:
        return True
    m = np.uint64(blend.found[row, column])
    if behind > blend.surface.loose or blend.label[n] != blend.label[m]:
        return False
    normal = blend.normal
    cosine = normal[n, 0] * normal[m, 0] + normal[n, 1] * normal[m, 1] + normal[n, 2] * normal[m, 2]
    return bool(cosine >= blend.surface.turn)


@plays(finish, NearestSurface)
def _divide(blend, row, column):  # type: ignore[no-untyped-def]
    weight = blend.weight[row, column]
    if weight > ZERO:
        share = ONE / weight
        for channel in range(blend.color.shape[1]):
            blend.image[row, column, np.uint64(channel)] *= share


OPAQUE = np.float32(1.0 - 1e-4)  # opacity that counts as all
ZERO, ONE = np.float32(0.0), np.float32(1.0)

# Points of one layer that a pixel has got and not composited yet.
WAITING = np.dtype(
    [
        ("layer", np.int32),
        ("first", np.float32),  # depth of the first of them
        ("red", np.float32),  # sums of the samples' light
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
    each other, as they may be side by side: points of one layer are summed, and the sum is
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
    """A sample to composite."""

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
    """Composite the queued points; together they cover at most the whole pixel."""
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
