"""Options of a renderer, as enumerations."""

from enum import StrEnum


class Primitive(StrEnum):
    """Primitives that samples are painted as.

    Examples
    --------
    >>> from resample import Primitive, Resampler
    >>> [primitive.value for primitive in Primitive]
    ['hybrid', 'points', 'splats', 'paper', 'inflate', 'ewa']
    >>> Resampler(primitive=Primitive.POINTS).primitive.value
    'points'
    """

    HYBRID = "hybrid"  # points on fine sub-pixels where they shrink, splats where they grow
    POINTS = "points"  # only points
    SPLATS = "splats"  # only splats, one ray per pixel
    PAPER = "paper"  # as published (`resample.hybrid`): threshold 1 px, points at pixel resolution
    INFLATE = "inflate"  # splats enlarged so that neighbours are a pixel apart (Swan 1997)
    EWA = "ewa"  # splats convolved with the pixel filter (Zwicker 2001)


class Footprint(StrEnum):
    """Model of a splat's footprint, see `resample.engine.ellipsoids.footprints`.

    Examples
    --------
    >>> from resample import Footprint, Resampler
    >>> [model.value for model in Footprint]
    ['affine', 'corrected', 'small-angle', 'exact', 'disc', 'equation', 'projected']
    >>> Resampler(footprint=Footprint.AFFINE).footprint.value
    'affine'
    """

    AFFINE = "affine"
    CORRECTED = "corrected"
    SMALL_ANGLE = "small-angle"
    EXACT = "exact"
    DISC = "disc"
    EQUATION = "equation"  # of the paper's form: corrected without the table
    PROJECTED = "projected"  # of the paper's form: corrected, around the projected center


WIDENED = (Primitive.INFLATE, Primitive.EWA)  # with affine ellipses
SCALED = (Primitive.HYBRID, Primitive.POINTS, Primitive.SPLATS)  # samples may differ in size
_OF_PAPER: list[Footprint] = [
    Footprint.AFFINE,
    Footprint.CORRECTED,
    Footprint.EQUATION,
    Footprint.PROJECTED,
]
_AFFINE: list[Footprint] = [Footprint.AFFINE]
_OF_ALL: list[Footprint] = [
    model for model in Footprint if model not in (Footprint.EQUATION, Footprint.PROJECTED)
]
FOOTPRINTS: dict[Primitive, list[Footprint]] = {
    **dict.fromkeys(Primitive, _OF_ALL),
    **dict.fromkeys(WIDENED, _AFFINE),
    Primitive.PAPER: _OF_PAPER,
}


class Opacity(StrEnum):
    """Conversion of a splat's line integral to opacity.

    Examples
    --------
    >>> from resample import Opacity, Resampler
    >>> [how.value for how in Opacity]
    ['exact', 'linear']
    >>> Resampler(opacity=Opacity.LINEAR).opacity.value
    'linear'
    """

    EXACT = "exact"  # 1 − exp(−τ F): transmittances multiply to that of the field
    LINEAR = "linear"  # α F of classic splatting


class Projection(StrEnum):
    """What a pixel shows of the field along its ray; all but COMPOSITE need a `Field`."""

    COMPOSITE = "composite"  # light, attenuated by what lies in front
    MAXIMUM = "maximum"  # maximum value
    AVERAGE = "average"  # mean value
    ADDITIVE = "additive"  # sum of values times length
    FIRST_HIT = "first-hit"  # the first isosurface
    MINIMUM = "minimum"  # minimum value; along rays only
    XRAY = "xray"  # additive, of attenuations derived from values by applications


SUMS = (Projection.ADDITIVE, Projection.XRAY)
WHOLE = SUMS  # every pixel depends on all others
MEASURING = (Projection.MAXIMUM, Projection.AVERAGE, Projection.MINIMUM, *SUMS)
OWN_FOOTPRINT = {
    Primitive.PAPER: Footprint.CORRECTED,
    Primitive.INFLATE: Footprint.AFFINE,
    Primitive.EWA: Footprint.AFFINE,
}


def number_of(projection: Projection) -> int:
    """Number of a projection in kernels."""
    one = Projection.ADDITIVE if projection is Projection.XRAY else projection
    return list(Projection).index(one)
