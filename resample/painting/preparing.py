"""From choices, samples and a camera to what painters take, and from sums to gray."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from resample.painting.choices import PaintChoices, number_of, technique_of
from resample.painting.scenes.scene import PreparedScene, ellipsoid_of, planes_of
from resample.painting.shaped.ellipsoids import ShapedOrder
from resample.profiles.filters import Box, filter_table
from resample.profiles.orders import EverySample, Rays, layers_of
from resample.types import Classifier, Doubles, Floats, Samples, Screen, Style, Tables, View


def prepared(
    choice: PaintChoices,
    samples: Samples,
    view: View,
    size: tuple[int, int],
    clip: ArrayLike | None,
) -> PreparedScene:
    """What painters get to know besides the samples, for a picture (height, width)."""
    lattice = samples.lattice
    ellipsoid = ellipsoid_of(lattice, view, choice.reconstruction.radius)
    screen = Screen(size[1], size[0], planes=planes_of(clip, view, ellipsoid))
    layers = layers_of(choice.order, samples.position, view, lattice)
    style = style_of(choice, lattice, None)
    return PreparedScene(view, ellipsoid, screen, style, choice.order.summing, layers)


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
    """Pixel filter of rays."""
    pixel = filter_table(choice.pixel_filter or Box())
    return Tables(*pixel, math.ceil(pixel.extent - 0.501))  # a box's table ends beyond 0.5


def style_of(choice: PaintChoices, lattice: Doubles, look: Classifier | None) -> Style:
    """Choices as numbers."""
    technique = technique_of(choice.primitive)
    subpixels = technique.subpixels if choice.subpixels is None else choice.subpixels
    red, green, blue = (-1.0, -1.0, -1.0) if choice.splat_color is None else choice.splat_color
    voxel, iso = abs(np.linalg.det(lattice)) ** (1 / 3), 0.0
    if look is not None and choice.iso is not None:
        iso = (choice.iso - look.low) / (look.high - look.low)
    return Style(
        subpixels=int(subpixels),
        projection=number_of(choice.projection),
        iso=float(iso),
        attenuation=float(choice.attenuation),
        linear_opacity=choice.opacity == "linear",
        layer=float(voxel * choice.order.thickness),
        tint=(float(red), float(green), float(blue)),
    )


def order_of_shapes(choice: PaintChoices, clip: ArrayLike | None) -> ShapedOrder:
    """Order of ellipsoids that choices stand for; refuse choices that ellipsoids do not have."""
    usual = replace(choice, order=EverySample(), subpixels=None) == type(choice)()
    if not usual or clip is not None:
        raise ValueError(
            "samples with a shape each take an order by depth, by distance or along rays, and"
            " sub-pixels; leave other choices and clipping planes out"
        )
    if isinstance(choice.order, Rays):
        return ShapedOrder.RAYS
    if not isinstance(choice.order, EverySample):
        raise ValueError(
            f"samples with a shape each are not summed by {type(choice.order).__name__}; take"
            " EverySample or Rays"
        )
    return ShapedOrder(choice.order.key)
