"""From choices, samples and a camera to what painters take, and from sums to gray."""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from numpy.typing import ArrayLike

from resample.painting.choices import (
    POINT_GRID,
    SUMS,
    Footprint,
    Opacity,
    PaintChoices,
    Projection,
    check_scaled,
    number_of,
    technique_of,
)
from resample.painting.scenes.scene import (
    PreparedScene,
    check_samples,
    ellipsoid_of,
    kernel_classifier,
    planes_of,
    samples_of,
    screen_of,
)
from resample.profiles.filters import Box, filter_table
from resample.profiles.orders import Summing, layers_of
from resample.profiles.reconstruction import footprint_table, partial_table, variance
from resample.types import (
    Classifier,
    Doubles,
    Field,
    Floats,
    Samples,
    Style,
    Tables,
    View,
)

OPAQUE = 1e-4  # transmittance that counts as none


def checked(choice: PaintChoices, samples: Samples | Field) -> tuple[Samples, Classifier | None]:
    """Samples for the painters, and what a field looks like."""
    if isinstance(samples, Field):
        return samples_of(samples), kernel_classifier(samples.classifier)
    known = check_samples(samples)
    if known.scale is not None:
        check_scaled(choice)
    return known, None


def prepared(
    choice: PaintChoices,
    tables: Tables,
    samples: Samples,
    view: View,
    size: tuple[int, int],
    look: Classifier | None,
    clip: ArrayLike | None,
) -> PreparedScene:
    """What painters get to know besides the samples, for a picture (height, width)."""
    lattice = samples.lattice
    ellipsoid = ellipsoid_of(lattice, view, choice.reconstruction.radius)
    screen = screen_of(size[1], size[0], tables.pixel_margin, view, ellipsoid)
    screen = screen._replace(planes=planes_of(clip, view, ellipsoid))
    is_one_sum = choice.projection in (Projection.AVERAGE, *SUMS)
    summing = Summing.SHEETS if is_one_sum else choice.order.summing
    layers = layers_of(choice.order, samples.position, view, lattice)
    style = style_of(choice, lattice, look)
    return PreparedScene(view, ellipsoid, screen, style, tables, summing, layers, look)


@contextmanager
def limited(threads: int | None) -> Iterator[None]:
    """Let kernels run in at most so many threads."""
    from resample.engine.jit import threads as at_most

    with at_most(threads):
        yield


def as_gray(value: Floats) -> Floats:
    """Sums (H, W) as opaque gray (H, W, 4), the largest of them white."""
    peak = float(value.max())
    gray = np.maximum(value / peak if peak > 0 else value, 0.0)
    return np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1)


def tables_of(choice: PaintChoices) -> Tables:
    """Everything that kernels look up."""
    at_pixels = technique_of(choice.primitive).filter_at_pixels is not None
    pixel = filter_table(Box() if at_pixels else choice.pixel_filter or Box())
    return Tables(
        footprint_table(choice.reconstruction).values,
        partial_table(choice.reconstruction),
        filter_table(choice.point_filter).values,
        *pixel,
        math.ceil(pixel.extent - 0.501),  # the table of a box ends a sliver beyond 0.5
    )


def style_of(choice: PaintChoices, lattice: Doubles, look: Classifier | None) -> Style:
    """Choices as numbers."""
    technique = technique_of(choice.primitive)
    threshold = technique.threshold if choice.threshold is None else choice.threshold
    subpixels = technique.subpixels if choice.subpixels is None else choice.subpixels
    tint = (-1.0, -1.0, -1.0) if choice.splat_color is None else choice.splat_color
    spread = variance(choice.reconstruction)
    voxel = abs(np.linalg.det(lattice)) ** (1 / 3)
    iso = 0.0
    if look is not None and choice.iso is not None:
        iso = (choice.iso - look.low) / (look.high - look.low)
    return Style(
        model=list(Footprint).index(choice.footprint or technique.own_footprint),
        threshold=float(threshold),
        subpixels=int(subpixels),
        most_for_splats=technique.most_for_splats,
        most_for_points=POINT_GRID,
        point_extent=filter_table(choice.point_filter).extent,
        variance=spread,
        inflated=technique.inflated,
        blurred=technique.blurred * (choice.reconstruction.radius**2 / spread),
        faintest=0.0 if look is None else -np.inf,
        projection=number_of(choice.projection),
        iso=float(iso),
        attenuation=float(choice.attenuation),
        linear_opacity=choice.opacity is Opacity.LINEAR,
        layer=float(voxel * choice.order.thickness),
        opaque=OPAQUE,
        **dict(zip(("tint_red", "tint_green", "tint_blue"), map(float, tint), strict=True)),
    )
