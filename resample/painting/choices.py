"""Choices of a renderer: their values, a primitive's requirements, valid combinations."""

import math
from collections.abc import Callable
from dataclasses import InitVar, dataclass, fields
from enum import StrEnum
from functools import cache, cached_property
from typing import TYPE_CHECKING, Literal

import numpy as np

from resample import registry
from resample.messages import check_numbers, shortly
from resample.profiles.filters import Gaussian, PixelFilter
from resample.profiles.orders import CompositingOrder, EverySample, Summing
from resample.profiles.reconstruction import GaussianKernel, Reconstruction
from resample.registry import ByName, OneOf
from resample.types import LatticeField, Samples

if TYPE_CHECKING:
    from resample.painting.scenes import SamplePainter

PAPER_FILTER = Gaussian(0.4, 1.2, lowered=True)  # see `resample.hybrid.points`
POINT_FILTER = Gaussian(1.0, 3.0, lowered=True)  # likewise, in widths of a point


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
    """Model of a splat's footprint: exact (`resample.engine.shaped`), or of `resample.hybrid`.

    Examples
    --------
    >>> from resample import Footprint, Resampler
    >>> [model.value for model in Footprint]
    ['affine', 'corrected', 'exact', 'equation', 'projected']
    >>> Resampler(footprint=Footprint.AFFINE).footprint.value
    'affine'
    """

    AFFINE = "affine"  # the projection's linear part at the center, as in EWA splatting
    CORRECTED = "corrected"  # the paper's ellipse and index correction
    EXACT = "exact"  # the distance of every ray
    EQUATION = "equation"  # corrected without the table
    PROJECTED = "projected"  # corrected, around the projected center, for small angles


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

    EXACT = "exact"  # 1 − exp(−τ F): transmittances multiply to the field's
    LINEAR = "linear"  # α F of classic splatting


class Projection(StrEnum):
    """Reduction of the field along a pixel's ray; all but COMPOSITE need a `LatticeField`."""

    COMPOSITE = "composite"  # light, attenuated by the medium in front
    MAXIMUM = "maximum"  # maximum value
    AVERAGE = "average"  # mean value
    ADDITIVE = "additive"  # sum of values times length
    FIRST_HIT = "first-hit"  # the first isosurface
    MINIMUM = "minimum"  # minimum value
    ATTENUATED = "attenuated"  # maximum value, each dimmed by those in front
    XRAY = "xray"  # additive, of attenuations derived from values by applications


FootprintName = Literal["affine", "corrected", "exact", "equation", "projected"]
ProjectionName = Literal[
    "composite", "maximum", "average", "additive", "first-hit", "minimum", "attenuated", "xray"
]
SUMS = (Projection.ADDITIVE, Projection.XRAY)
MAXIMA = (Projection.MAXIMUM, Projection.ATTENUATED)
MEASURING = (*MAXIMA, Projection.AVERAGE, Projection.MINIMUM, *SUMS)


def number_of(projection: Projection) -> int:
    """Number of a projection in kernels."""
    one = Projection.ADDITIVE if projection is Projection.XRAY else projection
    return list(Projection).index(one)


OF_SAMPLES = ("primitive", "footprint", "reconstruction", "threshold", "opacity")  # not of rays
OF_PAPER = tuple(model for model in Footprint if model is not Footprint.EXACT)


@dataclass(frozen=True)
class Technique:
    """Technique of a primitive; plugins of the group `resample.primitives` build one."""

    threshold: float  # sub-pixels between neighbours, up to which samples are points
    footprints: tuple[Footprint, ...] = tuple(Footprint)  # models of splats that go with it
    own_footprint: Footprint = Footprint.EXACT
    subpixels: int = 1  # per side of a pixel, unless chosen; 0: as many as samples need
    has_scales: bool = False  # samples may have a scale each
    inflated: float = 0.0  # px; splats with closer neighbours are as wide as for this spacing
    blurred: float = 0.0  # px², added to the variance of splats
    filter_at_pixels: PixelFilter | None = None  # if points are summed at pixels: under this filter
    painter: "Callable[[PaintChoices], SamplePainter] | None" = None  # None: as the order asks


def _paper(choice: "PaintChoices") -> "SamplePainter":
    """Return the painter of `resample.hybrid`: for points and inexact splats."""
    from resample.painting.paper import PaperPainter

    technique = technique_of(choice.primitive)
    threshold = technique.threshold if choice.threshold is None else float(choice.threshold)
    footprint = choice.footprint or technique.own_footprint
    at_pixels = technique.filter_at_pixels is not None
    return PaperPainter(
        choice.reconstruction,
        choice.point_filter,
        threshold,
        is_affine=footprint is Footprint.AFFINE,
        is_projected=footprint in (Footprint.PROJECTED, Footprint.EXACT),  # the nearest there is
        has_table=footprint is not Footprint.EQUATION,
        are_wide=not at_pixels,
        subpixels=technique.subpixels if choice.subpixels is None else int(choice.subpixels),
        pixel_filter=None if at_pixels else choice.pixel_filter,
    )


_TECHNIQUES = {
    Primitive.HYBRID: Technique(0.6, subpixels=0, has_scales=True),
    Primitive.POINTS: Technique(np.inf, subpixels=0, painter=_paper),
    Primitive.SPLATS: Technique(0.0, has_scales=True),
    Primitive.PAPER: Technique(
        1.0,  # "magnified" and "minified" taken literally
        OF_PAPER,
        Footprint.CORRECTED,
        filter_at_pixels=PAPER_FILTER,
        painter=_paper,
    ),
}


def is_exact(choice: "PaintChoices") -> bool:
    """Whether samples are splats of exact footprint."""
    technique = technique_of(choice.primitive)
    is_own = technique.painter is None and choice.threshold in (None, 0)
    footprint = choice.footprint or technique.own_footprint
    return is_own and footprint is Footprint.EXACT


@cache
def technique_of(primitive: str) -> Technique:
    """Technique of a primitive: the core's, or a plugin's."""
    found = _TECHNIQUES.get(Primitive(primitive)) if primitive in list(Primitive) else None
    if found is None:
        _primitive_named(primitive.partition(":")[0], "primitive")
    made: Technique = found or registry.build("primitives", primitive)
    return made


def footprints_of(primitive: str) -> tuple[Footprint, ...]:
    """Models of splats that a primitive allows."""
    return technique_of(primitive).footprints


@dataclass(frozen=True)
class PaintChoices:
    """All choices of a `Resampler`, which explains them, checked together."""

    primitive: Primitive | str = Primitive.HYBRID
    footprint: OneOf[Footprint | None, FootprintName] = OneOf(Footprint, None)
    pixel_filter: ByName[PixelFilter | None] = ByName("filters", None)
    reconstruction: ByName[Reconstruction] = ByName("reconstructions", GaussianKernel())
    order: ByName[CompositingOrder] = ByName("orders", EverySample())
    threshold: float | None = None
    subpixels: int | None = None
    opacity: OneOf[Opacity, Literal["exact", "linear"]] = OneOf(Opacity, Opacity.EXACT)
    splat_color: tuple[float, float, float] | None = None
    projection: OneOf[Projection, ProjectionName] = OneOf(Projection, Projection.COMPOSITE)
    iso: float | None = None
    attenuation: float = 0.05
    method: InitVar[str | None] = None

    def __post_init__(self, method: str | None) -> None:
        check_numbers(self, "threshold", "subpixels", "iso", "attenuation")
        if method is not None:
            object.__setattr__(self, "primitive", _primitive_named(method))
        elif not isinstance(self.primitive, str):
            _primitive_named(self.primitive, "primitive")
        # Refuse choices that do not go together, and say which do.
        if technique_of(self.primitive).filter_at_pixels is not None:
            name = self.primitive
            if self.order.summing is not Summing.POINTS:
                raise ValueError(
                    f"the primitive {name} composites every sample, so it has no order "
                    f"{self.order}; take the order every-sample, or the primitive hybrid"
                )
            if self.subpixels not in (None, 1):
                raise ValueError(
                    f"the primitive {name} has no sub-pixels, so not {self.subpixels} of them; "
                    "leave them out, or take the primitive hybrid"
                )
        known = footprints_of(self.primitive)
        if self.footprint is not None and self.footprint not in known:
            raise ValueError(
                f"the primitive {self.primitive} goes with the footprint {', '.join(known)}, not "
                f"{self.footprint}"
            )
        is_by_rays = self.order.summing is Summing.RAYS
        if self.projection is not Projection.COMPOSITE and not is_by_rays:
            raise ValueError(
                f"the projection {self.projection} needs the order rays, not {self.order}"
            )
        if not 0 <= self.attenuation < math.inf:
            raise ValueError(f"the attenuation is {self.attenuation}; it must be 0 or more")
        for each in fields(PaintChoices) if is_by_rays else ():
            chosen = getattr(self, each.name)
            if each.name in OF_SAMPLES and chosen != each.default:
                raise ValueError(
                    f"rays paint no samples, so they have no {each.name} {chosen}; take the order "
                    "every-sample, or leave it out"
                )
        if (self.iso is None) == (self.projection is Projection.FIRST_HIT):
            raise ValueError(
                "the projection first-hit needs an iso value, which no other projection has "
                f"(got {self.projection} and {self.iso}); give both or none of them"
            )
        if self.iso is not None and not math.isfinite(self.iso):
            raise ValueError(f"the iso value is {self.iso}; it must be finite")
        if self.threshold is not None and not self.threshold >= 0:
            raise ValueError(f"the threshold is {self.threshold} sub-pixels; it must be 0 or more")
        if self.subpixels is not None and not 1 <= self.subpixels <= 32:
            raise ValueError(
                f"{self.subpixels} sub-pixels per side of a pixel; 1 to 32 are allowed"
            )

    @cached_property
    def _painter(self) -> "SamplePainter":
        """Painter of samples: the primitive's own, the order's, or the usual one."""
        own = technique_of(self.primitive).painter or getattr(self.order, "painter", None)
        if own is not None:
            painter: SamplePainter = own(self)
            return painter
        if self.order.summing is not Summing.POINTS:
            raise ValueError(f"the order {self.order} has no painter of samples")
        # Exact splats have their own painter; other choices take the paper's painter.
        technique = technique_of(self.primitive)
        if not is_exact(self):
            return _paper(self)
        from resample.painting.splats import SplatPainter

        return SplatPainter(
            self.reconstruction,
            self.pixel_filter,
            technique.subpixels if self.subpixels is None else int(self.subpixels),
            getattr(self.order, "key", "depth"),
            technique.inflated,
            technique.blurred,
            # Others show what sub-pixels miss.
            is_spread=technique.subpixels == 0 and self.threshold is None,
            is_linear=self.opacity is Opacity.LINEAR,
        )

    @property
    def point_filter(self) -> PixelFilter:
        """Filter that points are added under."""
        # Sub-pixel points are seen under their own kernel's projection, close to a Gaussian of
        # that variance; the paper's are seen under the pixel's filter.
        at_pixels = technique_of(self.primitive).filter_at_pixels
        return POINT_FILTER if at_pixels is None else self.pixel_filter or at_pixels


def _primitive_named(name: str, what: str = "method") -> Primitive | str:
    own = list(Primitive)
    if name in own:
        return Primitive(name)
    more = [other for other in registry.names("primitives") if other not in own]
    if name not in more:
        raise ValueError(f"{what} {shortly(name)}; known: {', '.join([*own, *more])}")
    return name


def check_sort_of(
    choice: PaintChoices, samples: Samples | LatticeField | list[LatticeField]
) -> None:
    """Reject a field that the order cannot classify, and samples without a field."""
    if isinstance(samples, list):
        # Reject a list that is not of fields on lattices, and projections of one field.
        if not samples or not all(isinstance(field, LatticeField) for field in samples):
            raise TypeError(
                "a list of samples holds fields on lattices (LatticeField), one or more"
            )
        if len(samples) > 1 and choice.projection is not Projection.COMPOSITE:
            raise ValueError(
                f"the projection {choice.projection} shows the values of one field, and there are "
                f"{len(samples)}; take composite"
            )
        samples = samples[0]
    if not isinstance(samples, Samples | LatticeField):
        raise TypeError(
            f"samples of {type(samples).__name__}; give Samples, such as particles(...), or a field"
        )
    if isinstance(samples, LatticeField) != (choice.order.summing is Summing.RAYS):
        raise ValueError(
            "a field on a lattice and the order rays belong together; got "
            f"{type(samples).__name__} and {choice.order}"
        )
    if isinstance(samples, LatticeField) and choice.splat_color is not None:
        raise ValueError("a field has no splats that could be colored; leave the splat color out")


def check_scaled(choice: PaintChoices) -> None:
    """Reject choices that would ignore the scales of samples."""
    if choice.order.summing is not Summing.POINTS:
        raise ValueError(f"samples of a scale each need the order every-sample, not {choice.order}")
    is_linear = choice.opacity is Opacity.LINEAR
    if is_linear or not technique_of(choice.primitive).has_scales or not is_exact(choice):
        scaled = [name for name, known in _TECHNIQUES.items() if known.has_scales]
        raise ValueError(
            f"samples of a scale each are {', '.join(scaled)} of exact footprint and opacity "
            f"without a threshold, not {choice.primitive} of {choice.footprint or 'its own'}"
        )
