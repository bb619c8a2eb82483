"""Contributions of samples to slabs: colors, or values of a field."""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.lanes import chord_of, t_of
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    BLUE,
    DEPTH,
    DOWN,
    EXTINCTION,
    GREEN,
    RED,
    B,
    C,
)
from resample.engine.ellipsoids.rows import CHORD, RAY
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed
from resample.engine.roles import making_role, plays
from resample.types import Classifier, Floats, Place, Single
from resample_comparisons.volume.kernels.slabs.integrals import Integral, whole
from resample_comparisons.volume.kernels.slabs.shapes import Shape
from resample_comparisons.volume.kernels.slabs.sums import Contribution

MANY = 1e5  # sub-pixels in a quarter of a splat's box; if more, they sum to its mass anyway


class Colors(NamedTuple):
    """Samples that have colors already."""

    tint_red: float  # color that splats are drawn in; negative: their own
    tint_green: float
    tint_blue: float
    is_linear: bool  # classic opacity α × F
    layer: float  # scene units, thickness of a layer


class Mixed(NamedTuple):
    """Like `Colors`, for splats and points; their colors are tinted already."""

    is_linear: bool
    layer: float


class Values(NamedTuple):
    """Samples of a field, which are classified by the mean of a slab, or measured."""

    classifier: Classifier
    projection: int  # COMPOSITE, MAXIMUM, AVERAGE, ADDITIVE or FIRST_HIT
    iso: float  # value of the first hit, 0..1 between the classifier's low and high
    is_linear: bool
    layer: float
    voxel: float  # scene units
    is_measured: bool  # all slabs are one sum, of values and depths instead of gradients
    mass: float  # px² × scene units that the line integrals of all pixels must sum to; 0: any


Blend = Colors | Mixed | Values


@making_role
def contribution_of(blend: Blend, scratch: Floats, s: np.uint64, share: Single) -> Contribution:
    """Contribution of a sample per unit of its line integral, times a share."""
    raise NotImplementedError


@plays(contribution_of, Mixed)
def _contribution_of_mixed(blend, scratch, s, share):  # type: ignore[no-untyped-def]  # noqa: ARG001
    light = (scratch[s + RED], scratch[s + GREEN], scratch[s + BLUE])
    return _contribution(light, blend.is_linear, blend.layer, scratch, s)


@plays(contribution_of, Colors)
def _contribution_of_color(blend, scratch, s, share):  # type: ignore[no-untyped-def]  # noqa: ARG001
    red, green, blue = scratch[s + RED], scratch[s + GREEN], scratch[s + BLUE]
    if blend.tint_red >= 0.0:
        # Tint by brightness, so that splats can be told apart.
        brightest = max(red, green, blue)
        red = np.float32(brightest * blend.tint_red)
        green = np.float32(brightest * blend.tint_green)
        blue = np.float32(brightest * blend.tint_blue)
    return _contribution((red, green, blue), blend.is_linear, blend.layer, scratch, s)


@kernel
def _contribution(
    light: tuple[Single, Single, Single],
    is_linear: bool,
    layer: float,
    scratch: Floats,
    s: np.uint64,
) -> Contribution:
    """Contribution of a sample of this color: premultiplied by its weight."""
    weight, (red, green, blue) = scratch[s + EXTINCTION], light
    # The classic model sums opacities per length instead of extinctions.
    if is_linear:
        weight = absorbed(weight * np.float32(layer)) / np.float32(layer)
    return Contribution(
        weight, weight * red, weight * green, weight * blue, weight * scratch[s + DEPTH]
    )


@plays(contribution_of, Values)
def _contribution_of_value(blend, scratch, s, share):  # type: ignore[no-untyped-def]
    zero, value = np.float32(0.0), scratch[s + EXTINCTION]
    # Measured fields sum depths, others gradients.
    if blend.is_measured:
        return Contribution(share, share * scratch[s + DEPTH], zero, zero, share * value)
    red, green, blue = scratch[s + RED], scratch[s + GREEN], scratch[s + BLUE]
    return Contribution(share, share * red, share * green, share * blue, share * value)


@making_role
def share_of(
    blend: Blend,
    shape: Shape,
    scratch: Floats,
    s: np.uint64,
    rows: Floats,
    place: Place,
    integral: Integral,
) -> Single:
    """Factor that makes a splat's line integrals sum to its mass, where that is asked for."""
    raise NotImplementedError


@plays(share_of, object)
def _all_of_color(blend, shape, scratch, s, rows, place, integral):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.float32(1.0)


@plays(share_of, Values)
def _share_of_value(blend, shape, scratch, s, rows, place, integral):  # type: ignore[no-untyped-def]
    if blend.mass > 0.0:
        return _share_of_mass(shape, scratch, s, rows, place, integral, blend.mass)
    return np.float32(1.0)


@kernel
def _share_of_mass(
    shape: Shape,
    scratch: Floats,
    s: np.uint64,
    rows: Floats,
    place: Place,
    integral: Integral,
    mass: float,
) -> Single:
    """Factor that makes line integrals along parallel rays sum to a splat's mass.

    It is 1 where there are so many sub-pixels that their sum is the mass, or no ellipse.
    """
    # Quadratic form of the splat, and its center on the screen.
    n, zero, two = place.subpixels, np.float32(0.0), np.float32(2.0)
    a, b, c, half = shape.a, scratch[s + B], scratch[s + C], np.float32(0.5 / place.subpixels)
    x = np.float32(place.x) + half - scratch[s + ACROSS]
    y = np.float32(place.y) + half - scratch[s + DOWN]
    # All parallel rays have the same length and chord.
    ray, chord = rows[RAY], chord_of(shape.bend, rows[CHORD])
    # Bound the ellipse; NaN and very large ones need no correction.
    bounded = (np.float64(a) * c - np.float64(b) * b) * ray
    wide, high = n * np.sqrt(c / bounded), n * np.sqrt(a / bounded)
    if not (1.0 + wide) * (1.0 + high) < MANY:
        return np.float32(1.0)
    # Sum the line integrals of all sub-pixels in the box, also beyond the tile.
    left, right = _between(x, wide / n, place.x, n)
    top, bottom = _between(y, high / n, place.y, n)
    total = 0.0
    for row in range(top, bottom + 1):
        dy = np.float32(place.y + (row + 0.5) / n - y)
        for column in range(left, right + 1):
            dx = np.float32(place.x + (column + 0.5) / n - x)
            form = max(zero, (a * dx + two * b * dy) * dx + c * dy * dy)
            total += whole(integral, t_of(shape.bend, form, ray))
    # A splat that misses all sub-pixels adds nothing; else scale the sum to the mass.
    if not total > 0.0:
        return zero
    return np.float32(mass * (n * n) / (chord * total))


@kernel
def _between(middle: float, half: float, origin: float, n: int) -> tuple[int, int]:
    """First and last sub-pixel of a row whose centers are at most `half` px from `middle`."""
    first = np.ceil((middle - half - origin) * n - 0.5)
    last = np.floor((middle + half - origin) * n - 0.5)
    return int(first), int(last)
