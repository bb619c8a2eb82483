"""What slabs sum of samples, and how they are composited: colors, or values of a field."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.outlines import (
    BLUE,
    DEPTH,
    EXTINCTION,
    GREEN,
    RED,
    A,
    B,
    C,
    X,
    Y,
)
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed
from resample.engine.roles import making_role, plays
from resample.engine.slabs.integrals import Integral, whole
from resample.engine.slabs.sums import Cutting, Matter
from resample.types import Classifier, Floats, Single


class Colors(NamedTuple):
    """Samples that have their colors already."""

    tint_red: float  # color that splats are drawn in; negative: their own
    tint_green: float
    tint_blue: float
    is_linear: bool  # classic α × F
    layer: float  # scene units, thickness of a layer


class Values(NamedTuple):
    """Samples of a field, which are classified as means of a slab, or measured."""

    look: Classifier
    projection: int  # COMPOSITE, MAXIMUM, AVERAGE, ADDITIVE or FIRST_HIT
    iso: float  # position of the first hit's value between the classifier's low and high
    is_linear: bool
    layer: float
    voxel: float  # scene units
    is_measured: bool  # all slabs are one sum, whose depth is asked for and no gradient
    mass: float  # px² × scene units that the line integrals of all pixels sum to; 0: as they are


Blend = Colors | Values


@making_role
def matter_of(
    blend: Blend, room: Floats, s: np.uint64, cutting: Cutting, integral: Integral
) -> Matter:
    """What a splat adds per unit of its line integral."""
    raise NotImplementedError


@plays(matter_of, Colors)
def _matter_of_color(blend, room, s, cutting, integral):  # type: ignore[no-untyped-def]  # noqa: ARG001
    red, green, blue = room[s + RED], room[s + GREEN], room[s + BLUE]
    if blend.tint_red >= 0.0:
        brightest = max(red, green, blue)
        red = np.float32(brightest * blend.tint_red)
        green = np.float32(brightest * blend.tint_green)
        blue = np.float32(brightest * blend.tint_blue)
    weight = room[s + EXTINCTION]
    if blend.is_linear:
        weight = absorbed(weight * np.float32(blend.layer)) / np.float32(blend.layer)
    return Matter(weight, weight * red, weight * green, weight * blue, weight * room[s + DEPTH])


@plays(matter_of, Values)
def _matter_of_value(blend, room, s, cutting, integral):  # type: ignore[no-untyped-def]
    weight, zero, value = np.float32(1.0), np.float32(0.0), room[s + EXTINCTION]
    if blend.mass > 0.0:
        weight = _share_of_mass(room, s, cutting, integral, blend.mass)
    if blend.is_measured:
        return Matter(weight, weight * room[s + DEPTH], zero, zero, weight * value)
    red, green, blue = room[s + RED], room[s + GREEN], room[s + BLUE]
    return Matter(weight, weight * red, weight * green, weight * blue, weight * value)


@kernel
def _share_of_mass(
    room: Floats, s: np.uint64, cutting: Cutting, integral: Integral, mass: float
) -> Single:
    """Factor by which the sub-pixels' line integrals along parallel rays sum to a splat's mass."""
    place, _, ellipsoid, _, _ = cutting
    n, unit, x, y = place.subpixels, ellipsoid.to_unit, room[s + X], room[s + Y]
    a, b, c = room[s + A], room[s + B], room[s + C]
    per_square = np.float32(
        1.0 / (unit[0, 2] * unit[0, 2] + unit[1, 2] * unit[1, 2] + unit[2, 2] * unit[2, 2])
    )
    bounded = float(a * c - b * b) * per_square
    wide, high = np.sqrt(c / bounded), np.sqrt(a / bounded)
    left, right = _between(x, wide, place.x, n)
    top, bottom = _between(y, high, place.y, n)
    total, two = 0.0, np.float32(2.0)
    for row in range(top, bottom + 1):
        dy = np.float32(place.y + (row + 0.5) / n - y)
        for column in range(left, right + 1):
            dx = np.float32(place.x + (column + 0.5) / n - x)
            squared = max(np.float32(0.0), (a * dx + two * b * dy) * dx + c * dy * dy) * per_square
            total += whole(integral, max(np.float32(0.0), np.float32(1.0) - squared))
    if not total > 0.0:
        return np.float32(0.0)
    return np.float32(mass * (n * n) / (ellipsoid.scale * np.sqrt(per_square) * total))


@kernel
def _between(middle: float, half: float, origin: float, n: int) -> tuple[int, int]:
    """First and last sub-pixel of a row whose centers are at most `half` px from the middle."""
    first = np.ceil((middle - half - origin) * n - 0.5)
    last = np.floor((middle + half - origin) * n - 0.5)
    return int(first), int(last)
