"""What a renderer can be asked for."""

from enum import StrEnum


class Primitive(StrEnum):
    """What samples are painted as.

    Examples
    --------
    >>> from resample import Primitive, Resampler
    >>> [primitive.value for primitive in Primitive]
    ['hybrid', 'points', 'splats', 'paper', 'inflate', 'ewa']
    >>> Resampler(primitive=Primitive.POINTS).primitive.value
    'points'
    """

    HYBRID = "hybrid"  # points on fine sub-pixels where they shrink, splats where they grow
    POINTS = "points"  # all of them points
    SPLATS = "splats"  # all of them splats, one ray per pixel
    PAPER = "paper"  # the paper's form: threshold 1 px, points summed at the size of pixels
    INFLATE = "inflate"  # splats made so large that neighbours are a pixel apart (Swan 1997)
    EWA = "ewa"  # splats under the pixel's filter (Zwicker 2001)


class Footprint(StrEnum):
    """Model of a splat's footprint, see `resample.engine.ellipsoids.footprints`.

    Examples
    --------
    >>> from resample import Footprint, Resampler
    >>> [model.value for model in Footprint]
    ['affine', 'corrected', 'small-angle', 'exact', 'disc']
    >>> Resampler(footprint=Footprint.AFFINE).footprint.value
    'affine'
    """

    AFFINE = "affine"
    CORRECTED = "corrected"
    SMALL_ANGLE = "small-angle"
    EXACT = "exact"
    DISC = "disc"


WIDENED = (Primitive.INFLATE, Primitive.EWA)  # their ellipses are affine
SCALED = (Primitive.HYBRID, Primitive.POINTS, Primitive.SPLATS)  # whose samples may differ in size
FOOTPRINTS = {
    primitive: [Footprint.AFFINE] if primitive in WIDENED else list(Footprint)
    for primitive in Primitive
}


class Opacity(StrEnum):
    """How a splat's line integral becomes opacity.

    Examples
    --------
    >>> from resample import Opacity, Resampler
    >>> [how.value for how in Opacity]
    ['exact', 'linear']
    >>> Resampler(opacity=Opacity.LINEAR).opacity.value
    'linear'
    """

    EXACT = "exact"  # 1 − exp(−τ F): transmittances multiply to the field's own
    LINEAR = "linear"  # classic splatting's α F


class Projection(StrEnum):
    """What a pixel shows of the field along its ray; all but the first need a `Field`."""

    COMPOSITE = "composite"  # light that comes through what lies in front
    MAXIMUM = "maximum"  # the largest value
    AVERAGE = "average"  # the mean value
    ADDITIVE = "additive"  # the sum of values times length
    FIRST_HIT = "first-hit"  # the surface on which the field first passes a value
    MINIMUM = "minimum"  # the least value; along rays alone
    XRAY = "xray"  # additive, of attenuations; applications make them of values, and grays of sums


SUMS = (Projection.ADDITIVE, Projection.XRAY)
WHOLE = SUMS  # whose pixels depend on all others
MEASURING = (Projection.MAXIMUM, Projection.AVERAGE, Projection.MINIMUM, *SUMS)
OWN_FOOTPRINT = {
    Primitive.PAPER: Footprint.CORRECTED,
    Primitive.INFLATE: Footprint.AFFINE,
    Primitive.EWA: Footprint.AFFINE,
}


def number_of(projection: Projection) -> int:
    """Projection as kernels know it."""
    one = Projection.ADDITIVE if projection is Projection.XRAY else projection
    return list(Projection).index(one)
