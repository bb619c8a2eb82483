"""Integrals along a ray through a field: compositing, mean, and first surface.

A ray is marched front to back, past cells in which nothing is visible. A step is sampled in its
middle, for its value and its gradient; its ends are on Hermite cubics between middles. Steps that
are optically thick, or in which the field bends, are composited in several pieces.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import called_role, inner_step, plays, role
from resample.engine.lookup import VISIBLE, absorbed
from resample.engine.rays.coefficients import value_and_slope_at, value_at
from resample.engine.rays.media import (
    Aims,
    Light,
    Medium,
    Ray,
    SummedClassifier,
    aims_at,
    brick_at,
    clamped,
    classified,
    depth_at,
    depth_cue_at,
    faced,
    is_known,
    length_of,
    lights_between,
    next_step,
    number_at,
    place_at,
    position,
    reflected,
    steps_out,
    tinted,
    value_of,
)
from resample.engine.vectors import Vector, dot, matrix_of, multiply
from resample.types import SplineField

THICK = 0.17  # optical depth of a piece that nothing hides, about
FAINT = 0.02  # optical depth of steps that are not split
MOST_PIECES = 8  # of a step
CLOSER = 24  # iterations of the search for a surface, at most
NEAR = 1e-4  # columns, tolerance of the search
EVEN_BRICK = 1e-6  # columns between least and greatest value of a brick that counts as uniform

# Premultiplied light, opacity, depth × opacity, nearest visible depth, length of the visible part
# in voxels, a value in data units and its weight.
Result = tuple[float, float, float, float, float, float, float, float, float]


class Composite(NamedTuple):
    """Emission and absorption, composited front to back."""

    opaque: float  # transmittance that counts as none
    is_lit: bool
    has_regions: bool  # looks depend on gradients


class Mean(NamedTuple):
    """The mean of values along the ray, or their integral over length."""

    voxel: float  # scene units
    is_additive: bool


class AttenuatedMaximum(NamedTuple):
    """The greatest value along the ray, each dimmed by the values in front of it."""

    voxel: float  # scene units
    per_column: float  # attenuation per column of the values and scene unit


class IsoSurfaceHit(NamedTuple):
    """The surface at which the field first rises to a value."""

    iso: float  # column of the value


class RaySample(NamedTuple):
    """The field in the middle of a step or of a piece."""

    value: float
    rise: float  # derivative of the value, per step
    slope: Vector  # gradient, columns per sample


class RayContext(NamedTuple):
    """A field, and the directions of its light along a ray from the eye."""

    medium: Medium
    aims: Aims


NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0)


@called_role
def integrate(way: Any, ray: Ray, medium: Medium) -> Result:
    """Integrate the field along a ray that meets it."""
    raise NotImplementedError


@role
def put(
    way: Any, result: Result, light: Light, shine: tuple[float, float], length: float, depth: float
) -> Result:
    """Composite a homogeneous piece behind the accumulated color."""
    raise NotImplementedError


@plays(put, of=Composite)
def _(
    way: Composite,  # noqa: ARG001
    result: Result,
    light: Light,
    shine: tuple[float, float],
    length: float,
    depth: float,
) -> Result:
    red, green, blue, alpha, deep, first, cover, value, presence = result
    # The piece's opacity, times the transmittance in front of it.
    extinction = light[3]
    share = (1.0 - alpha) * float(absorbed(extinction * length))
    # Lights are multiplied by the extinction; divide it out, shade, and accumulate.
    own, high = shine[0] / extinction, shine[1]
    red += share * (own * light[0] + high)
    green += share * (own * light[1] + high)
    blue += share * (own * light[2] + high)
    alpha += share
    # Note the depth where the ray first becomes visible.
    if first == math.inf and alpha > VISIBLE:
        first = depth
    return red, green, blue, alpha, deep + share * depth, first, cover, value, presence


@inner_step
def sample_at(ray: Ray, step: float, medium: Medium) -> RaySample:
    """Sample the field at a position given in steps."""
    value, slope = value_and_slope_at(medium.spline, place_at(ray, step))
    # Project the gradient onto the ray.
    return RaySample(value, dot(slope, ray.way) * ray.thickness, slope)


@inner_step
def _between(one: RaySample, two: RaySample, apart: float) -> float:
    """Value halfway between two samples that are `apart` steps, by Hermite's cubic."""
    return 0.5 * (one.value + two.value) + 0.125 * apart * (one.rise - two.rise)


@inner_step
def _shows(classifier: SummedClassifier, least: float, most: float) -> bool:
    """Whether any value between two values is visible."""
    # Prefix counts of visible columns: compare those at both ends.
    first, last = int(least), math.ceil(most)
    return bool(classifier.visible[np.uint64(last + 1)] > classifier.visible[np.uint64(first)])


@inner_step
def _shine_at(
    way: Composite, ray: Ray, step: float, slope: Vector, context: RayContext
) -> tuple[float, float]:
    """Shade a position: the factor of its color, and its white highlight, dimmed by depth."""
    medium, depth, own, highlight = context.medium, depth_at(ray, step), 1.0, 0.0
    # The directions of the light differ along the ray where they depend on the position.
    if way.is_lit:
        place, aims = place_at(ray, step), context.aims
        if not medium.is_from_eye:
            aims = aims_at(position(medium, place), medium.classifier)
        # Apply depth cueing.
        own, highlight = reflected(medium, place, faced(medium, place, slope), aims)
    kept = depth_cue_at(medium.classifier, depth)
    return kept * own, kept * highlight


@inner_step
def _light_of(way: Composite, medium: Medium, number: int, values: Vector, slope: Vector) -> Light:
    """Mean color × extinction and mean extinction of a piece.

    `number` picks the look. `values`: at the front, in the middle and at the back.
    """
    classifier = medium.classifier
    # With regions, classify the middle by its value and gradient magnitude.
    if way.has_regions:
        place = number * classifier.columns + values[1]
        red, green, blue, thick = classified(classifier, place, length_of(slope))
        return thick * red, thick * green, thick * blue, thick
    # Without, take the pre-integrated means of both halves.
    return lights_between(classifier, number, values)


@inner_step
def _slope_of(sample: RaySample, medium: Medium) -> Vector:
    """Gradient of a sample, data units per scene unit."""
    return multiply(matrix_of(medium.to_slope), sample.slope)


@inner_step
def put_step(
    result: Result,
    way: Any,
    ray: Ray,
    step: int,
    ends: tuple[float, RaySample, float],
    context: RayContext,
) -> Result:
    """Put a step if it is visible, given its front, the sample in its middle and its back."""
    # Cull by the three values.
    medium, here = context.medium, ends[1]
    classifier, length = medium.classifier, ray.thickness * ray.length
    front, back = clamped(classifier, ends[0]), clamped(classifier, ends[2])
    middle = clamped(classifier, here.value)
    if not _shows(classifier, min(front, middle, back), max(front, middle, back)):
        return result
    # Classify the step as one piece. Split it by its contribution, or if the field bends.
    at, slope = step + 0.5, _slope_of(here, medium)
    number = number_at(medium, place_at(ray, at))
    light = _light_of(way, medium, max(0, number), (front, middle, back), slope)
    left = (1.0 - result[3]) * light[3] * length
    pieces = 1 + min(MOST_PIECES - 1, int(left / THICK))
    is_uneven = way.has_regions or medium.known.size > 0
    if is_uneven or (left > FAINT and abs(front + back - 2.0 * middle) > medium.coarse):
        pieces = max(pieces, 2)
    share = 1.0 / pieces
    if pieces > 1:
        at = step + 0.5 * share
        here = sample_at(ray, at, medium)
    for n in range(pieces):
        # Sample and classify the piece anew unless it is the only one.
        if pieces > 1:
            ahead, end = here, back
            if n + 1 < pieces:
                ahead = sample_at(ray, at + share, medium)
                end = clamped(classifier, _between(here, ahead, share))
            number, slope = number_at(medium, place_at(ray, at)), _slope_of(here, medium)
            values = (front, clamped(classifier, here.value), end)
            light = _light_of(way, medium, max(0, number), values, slope)
            front, here = end, ahead
        # Composite it unless its sample is missing.
        if number >= 0 and light[3] > 0.0:
            shine = _shine_at(way, ray, at, slope, context)
            light = tinted(medium, place_at(ray, at), light)
            result = put(way, result, light, shine, share * length, depth_at(ray, at))
            # Early ray termination.
            if 1.0 - result[3] <= way.opaque:
                break
        at += share
    # Add the visible length.
    red, green, blue, alpha, deep, first, cover, value, presence = result
    cover += length * medium.per_voxel
    return red, green, blue, alpha, deep, first, cover, value, presence


@inner_step
def step_after(
    ray: Ray, step: int, here: RaySample, medium: Medium
) -> tuple[int, RaySample, float, float]:
    """The next visible step, its middle, and the values at this step's back and its front."""
    ahead, back = here, here.value + 0.5 * here.rise
    following, begin = next_step(ray, step + 1, medium.bricks), back
    if following < ray.steps:
        ahead = sample_at(ray, following + 0.5, medium)
        begin = ahead.value - 0.5 * ahead.rise
    # Where it is visible, too, both share the value in between.
    if following == step + 1 < ray.steps:
        back = begin = _between(here, ahead, 1.0)
    return following, ahead, back, begin


@inner_step
def finished(result: Result, opaque: float) -> Result:
    """Result of a ray that was composited to its end, or until opaque."""
    # Behind the end of an opaque ray the color is assumed to go on as in front of it.
    red, green, blue, alpha, deep, first, cover, _, _ = result
    whole = 1.0
    if 1.0 - alpha <= opaque:
        whole = 1.0 / alpha
    red, green, blue, alpha, deep = (
        whole * red, whole * green, whole * blue, whole * alpha, whole * deep,
    )  # fmt: skip
    # Coverage is at least the opacity.
    return red, green, blue, alpha, deep, first, max(alpha, min(1.0, cover)), 0.0, 0.0


@plays(integrate, of=Composite)
def _(way: Composite, ray: Ray, medium: Medium) -> Result:
    # Skip to the first visible step.
    bricks = medium.bricks
    result, step = NOTHING, next_step(ray, 0, bricks)
    if step >= ray.steps:
        return result
    # One direction of light serves the whole ray where the light comes from the eye.
    far = position(medium, place_at(ray, ray.steps))
    context = RayContext(medium, aims_at(far, medium.classifier))
    # March front to back.
    here = sample_at(ray, step + 0.5, medium)
    front = here.value - 0.5 * here.rise
    while step < ray.steps:
        following, ahead, back, begin = step_after(ray, step, here, medium)
        result = put_step(result, way, ray, step, (front, here, back), context)
        # Early ray termination.
        if 1.0 - result[3] <= way.opaque:
            break
        step, here, front = following, ahead, begin
    return finished(result, way.opaque)


@inner_step
def measured(ray: Ray, medium: Medium, value: float, depth: float, voxel: float) -> Result:
    """Classify a value; it is as opaque as a voxel where the field is at least a voxel long."""
    # Clamp to the samples' range, which splines overshoot.
    classifier, spline = medium.classifier, medium.spline
    value = min(max(value, spline.floor), spline.ceiling)
    # Weigh by the length of the field on this ray, at most one voxel.
    presence = min(1.0, ray.steps * ray.thickness * ray.length / voxel)
    # Classify, and compute the opacity of one voxel.
    red, green, blue, extinction = classified(classifier, clamped(classifier, value), 0.0)
    alpha = presence * -math.expm1(-extinction * voxel)
    first = depth if alpha > VISIBLE else math.inf
    return (
        alpha * red,
        alpha * green,
        alpha * blue,
        alpha,
        alpha * depth,
        first,
        presence,
        value_of(classifier, value),
        presence,
    )


@plays(integrate, of=Mean)
def _(way: Mean, ray: Ray, medium: Medium) -> Result:
    # Sum the values in the middle of each step.
    spline, bricks = medium.spline, medium.bricks
    total, count, step = 0.0, 0, 0
    while step < ray.steps:
        place = place_at(ray, step + 0.5)
        # Leave out missing samples.
        if not is_known(medium, place):
            step += 1
            continue
        # In a uniform brick, add all its steps at once.
        brick = brick_at(bricks, place)
        least = float(bricks.least[brick])
        if bricks.greatest[brick] - least <= EVEN_BRICK and medium.known.size == 0:
            last = max(step + 1, int(steps_out(ray, place, 1) + 0.5))
            total += (last - step) * least
            count += last - step
            step = last
            continue
        # Elsewhere, sample the spline.
        total += value_at(spline, place)
        count += 1
        step += 1
    if count == 0:
        return NOTHING
    # Classify the mean, or multiply it by the length to integrate.
    mean, middle = total / count, depth_at(ray, 0.5 * ray.steps)
    if not way.is_additive:
        return measured(ray, medium, mean, middle, way.voxel)
    length = count * ray.thickness * ray.length
    presence = min(1.0, length / way.voxel)
    first = middle if presence > VISIBLE else math.inf
    depth = presence * middle
    return (
        0.0,
        0.0,
        0.0,
        presence,
        depth,
        first,
        presence,
        value_of(medium.classifier, mean) * length,
        presence,
    )


@plays(integrate, of=AttenuatedMaximum)
def _(way: AttenuatedMaximum, ray: Ray, medium: Medium) -> Result:
    """The attenuated maximum of vispy's and napari's, in lengths instead of steps."""
    spline, classifier = medium.spline, medium.classifier
    highest = float(classifier.columns - 1)
    rate = way.per_column * ray.thickness * ray.length
    best, at, dimming = -1.0, 0.0, 1.0
    for step in range(ray.steps):
        # Stop where even the highest value would not exceed the result.
        if highest * dimming <= best:
            break
        place = place_at(ray, step + 0.5)
        if not is_known(medium, place):
            continue
        # Dim the value in the middle of its step by all in front.
        value = clamped(classifier, min(max(value_at(spline, place), spline.floor), spline.ceiling))
        half = math.exp(-0.5 * rate * value)
        if value * half * dimming > best:
            best, at = value * half * dimming, step + 0.5
        dimming *= half * half
    if best < 0.0:
        return NOTHING
    return measured(ray, medium, best, depth_at(ray, at), way.voxel)


@inner_step
def _crossing(
    ray: Ray, spline: SplineField, step: int, ends: tuple[float, float], iso: float
) -> float:
    """Position, in steps, where the field crosses a value between those at a step's ends."""
    # Bracket the root by the step's ends, relative to the value.
    before, behind = float(step), step + 1.0
    low, high, middle = ends[0] - iso, ends[1] - iso, step + 0.5
    for _ in range(CLOSER):
        # Regula falsi: intersect the chord, until the value is close enough.
        middle = before + (behind - before) * low / (low - high)
        found = value_at(spline, place_at(ray, middle)) - iso
        if abs(found) <= NEAR:
            return middle
        # Illinois: halve the weight of the end that stays, so that both ends close in.
        if found >= 0.0:
            behind, high, low = middle, found, 0.5 * low
        else:
            before, low, high = middle, found, 0.5 * high
    return middle


@plays(integrate, of=IsoSurfaceHit)
def _(way: IsoSurfaceHit, ray: Ray, medium: Medium) -> Result:
    # Start at the first visible brick; the ray may enter above the value already.
    spline, bricks, classifier = medium.spline, medium.bricks, medium.classifier
    step, hit = max(0, next_step(ray, 0, bricks) - 1), -1.0
    first = place_at(ray, step)
    front = value_at(spline, first)
    hit = float(step) if front >= way.iso and is_known(medium, first) else -1.0
    # March until the field rises to the value, and refine the crossing.
    while step < ray.steps and hit < 0.0:
        behind = place_at(ray, step + 1)
        back = value_at(spline, behind)
        if back >= way.iso and is_known(medium, behind):
            hit = step + 1.0
            if front < way.iso:
                hit = _crossing(ray, spline, step, (front, back), way.iso)
        # Skip bricks that do not reach the value, but for a step that ends in one that does.
        following = max(step + 1, next_step(ray, step + 1, bricks) - 1)
        front = back
        if step + 1 < following < ray.steps:
            front = value_at(spline, place_at(ray, following))
        step = following
    if hit < 0.0:
        return NOTHING
    # Compute the normal at the hit.
    place, depth = place_at(ray, hit), depth_at(ray, hit)
    _, per_sample = value_and_slope_at(spline, place)
    slope = faced(medium, place, multiply(matrix_of(medium.to_slope), per_sample))
    # Shade the surface and dim it by depth.
    aims = aims_at(position(medium, place), classifier)
    own, highlight = reflected(medium, place, slope, aims)
    red, green, blue, _ = classified(classifier, clamped(classifier, way.iso), length_of(slope))
    kept = depth_cue_at(classifier, depth)
    own, highlight = kept * own, kept * highlight
    color = (own * red + highlight, own * green + highlight, own * blue + highlight)
    iso = value_of(classifier, way.iso)
    return color[0], color[1], color[2], 1.0, depth, depth, 1.0, iso, 1.0
