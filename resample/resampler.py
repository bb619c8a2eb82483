"""Hybrid forward resampling: classify, order, paint (paper, section 2, on one page)."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyCamera
from resample.messages import check_call, check_size
from resample.painting.choices import (
    MEASURING,
    SUMS,
    PaintChoices,
    check_scaled,
    check_sort_of,
    number_of,
    technique_of,
)
from resample.painting.scenes import (
    PaintTarget,
    PreparedScene,
    check_samples,
    ellipsoid_of,
    kernel_field,
    nothing_painted,
    planes_of,
)
from resample.profiles.filters import Box, filter_table
from resample.profiles.orders import EverySample, Rays, layers_of
from resample.progress import Progress
from resample.types import (
    Classifier,
    Doubles,
    Floats,
    Frame,
    LatticeField,
    Records,
    Samples,
    Screen,
    Statistics,
    Style,
    Tables,
    View,
)

if TYPE_CHECKING:
    from resample.painting.ellipsoids import Ellipsoids, ShapedOrder


class Resampler(PaintChoices):  # a dataclass by inheritance: mypy would lose what names become
    """A renderer with all choices made; call it with samples and a camera.

    Parameters
    ----------
    primitive
        Points, splats, or each where it is better.
    footprint
        Model of the splats; None is exact, and corrected under `Primitive.PAPER`. Inexact splats
        and points are painted by `resample.hybrid`.
    pixel_filter
        Filter from sub-pixels to pixels, by name, such as `tent`, or as an object; under
        `Primitive.PAPER` the filter that points are summed under at the pixels, where a box would
        do poorly: None chooses for the primitive.
    reconstruction
        Kernel around every sample, by name or as an object.
    order
        Order of compositing, by name, such as `every-sample:key=distance`, or as an object.
    threshold
        A sample is a point when neighbours are at most this many sub-pixels apart on screen, by
        `resample.hybrid`; None takes the primitive's own.
    subpixels
        Sub-pixels per side of a pixel; None lets hybrid and points choose, up to 16 and 8, and is
        1 otherwise.
    opacity
        Exact, or classic.
    splat_color
        Linear RGB that splats are drawn in, to tell them from points (Figure 8a); None: their own.
    projection
        What pixels show.
    iso
        Value that `Projection.FIRST_HIT` looks for, data units.
    attenuation
        How much a voxel of the brightest value dims voxels behind it, of `Projection.ATTENUATED`;
        0 is the plain maximum.
    method
        Name of the primitive, as commands take it: `Resampler(method="paper")`.

    Raises
    ------
    ValueError
        A number is out of range, or choices do not go together.

    Examples
    --------
    >>> from resample import Camera, Resampler, particles
    >>> balls = particles([[0, 0, 5], [1, 0, 9]], [[1, 0, 0], [0, 0, 1]], 0.9, 1)
    >>> paint = Resampler(subpixels=4)
    >>> frame = paint(balls, Camera.from_fov(60, 24, 32), height=24, width=32)
    >>> frame.statistics.splats
    2
    """

    def __call__(
        self,
        samples: "Samples | LatticeField | list[LatticeField] | Ellipsoids",
        camera: AnyCamera,
        *,
        height: int,
        width: int,
        threads: int | None = None,
        progress: Progress | None = None,
        clip: ArrayLike | None = None,
    ) -> Frame:
        """Picture of the samples.

        Parameters
        ----------
        samples
            Samples; the result does not depend on their order. A `LatticeField` needs `Rays`,
            as do several of them in a list (their emission and absorption add up); and `Ellipsoids`
            take `EverySample` or `Rays`.
        camera
            Where from.
        height, width
            Of the picture, px.
        threads
            At most this many; the result does not depend on it.
        progress
            Called with the share of the work that is done, 0 to 1, and may raise to stop.
        clip
            (M, 4) planes: normal and offset, scene units. Of a field only that is seen where
            n · p + d is 0 or more for all of them; samples are kept by their centers.

        Raises
        ------
        ValueError
            Arrays do not fit together or hold values that are not finite, the size is invalid, a
            field or its projection does not go with the order, or choices are not for samples that
            have a scale each.
        """
        check_call(camera, height, width, threads)
        if not isinstance(samples, Samples | LatticeField | list):
            from resample.painting import ellipsoids as shaped

            if isinstance(samples, shaped.Ellipsoids):
                style = shaped.ShapedStyle(order_of_shapes(self, clip), self.subpixels)
                with limited(threads):
                    shapes = (samples, camera, (height, width), style)
                    return shaped.frame_of(shaped.paint_ellipsoids(*shapes, progress=progress))
        check_sort_of(self, samples)
        if isinstance(samples, LatticeField | list):
            fields = samples if isinstance(samples, list) else [samples]
            with limited(threads):
                return self._gathered(fields, camera.view(), (height, width), clip, progress)
        known = self._checked(samples)
        if known.extinction.size == 0:
            nothing = nothing_painted(height, width, has_values=True)
            return self._developed(nothing, Statistics(0, 0, 0, 0, 1, {}))
        with limited(threads):
            scene = prepared(self, known, camera.view(), (height, width), clip)
            return self._developed(*self._painter.paint(scene, known, progress))

    def paint_rows(
        self,
        fields: LatticeField | list[LatticeField],
        camera: AnyCamera,
        rows: tuple[int, int],
        *,
        height: int,
        width: int,
        threads: int | None = None,
        progress: Progress | None = None,
        clip: ArrayLike | None = None,
    ) -> Frame:
        """Rows of a picture of fields, bit-identical to the whole picture's.

        Parameters
        ----------
        fields, camera, height, width, threads, progress, clip
            As in a call.
        rows
            First row, and the one after the last, px.

        Raises
        ------
        ValueError
            As a call does; or the rows lie outside the picture.
        """
        check_call(camera, height, width, threads)
        check_sort_of(self, fields)
        if not 0 <= rows[0] < rows[1] <= height:
            raise ValueError(f"rows {rows} are not within a picture of {height}")
        every = fields if isinstance(fields, list) else [fields]
        with limited(threads):
            return self._gathered(every, camera.view(), (height, width), clip, progress, rows)

    def footprints(
        self, samples: Samples, camera: AnyCamera, *, height: int, width: int
    ) -> Records:
        """Records (N,) of `resample.hybrid.record.RECORD`: each sample as the camera sees it.

        Same parameters and errors as a call, of primitives and footprints of `resample.hybrid`.
        """
        check_size(height, width)
        check_sort_of(self, samples)
        known, view, size = self._checked(samples), camera.view(), (height, width)
        if known.scale is not None:
            raise ValueError("there are no records of samples that have a scale each")
        from resample.painting.paper import PaperPainter

        painter = self._painter
        if not isinstance(painter, PaperPainter):
            raise ValueError(
                "splats of exact footprint have no ellipses; take the primitive paper, or another "
                "footprint"
            )
        scene = prepared(self, known, view, size, None)
        placed = painter.placed(scene, known, view, size)
        records = np.empty_like(placed.records)
        records[placed.order] = placed.records
        return records

    def _checked(self, samples: Samples) -> Samples:
        """Samples as painters take them."""
        known = check_samples(samples)
        if known.scale is not None:
            check_scaled(self)
        return known

    def _gathered(
        self,
        fields: list[LatticeField],
        view: View,
        size: tuple[int, int],
        clip: ArrayLike | None,
        progress: Progress | None,
        rows: tuple[int, int] | None = None,
    ) -> Frame:
        """Ray-cast picture of fields, or rows of it."""
        from resample.painting.rays import RayPainter

        fields = [kernel_field(field) for field in fields]
        style = style_of(self, fields[0].lattice, fields[0].classifier)
        rays, step = self.order if isinstance(self.order, Rays) else Rays(), self.order.thickness
        painter = RayPainter(style, self._tables, step, rays.quality, rays.interpolation, clip)
        painted, counts = painter.paint(fields, view, size, progress, rows or (0, size[0]))
        if rows is not None:
            painted = painted.cut((0, rows[0], size[1], rows[1]))
        return self._developed(painted, counts)

    def _developed(self, painted: PaintTarget, statistics: Statistics) -> Frame:
        film, value = painted.film, painted.value if self.projection in MEASURING else None
        if self.projection in SUMS:
            value = np.nan_to_num(painted.value, nan=0.0)
            film = film._replace(rgba=as_gray(value))
        return Frame(*film, statistics, value)

    @cached_property
    def _tables(self) -> Tables:
        """Pixel filter of rays."""
        return tables_of(self)


def prepared(
    choice: PaintChoices,
    samples: Samples,
    view: View,
    size: tuple[int, int],
    clip: ArrayLike | None,
) -> PreparedScene:
    """Inputs of painters besides the samples, for a picture (height, width)."""
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


def order_of_shapes(choice: PaintChoices, clip: ArrayLike | None) -> "ShapedOrder":
    """Order of ellipsoids that choices stand for; refuse choices that ellipsoids do not have."""
    usual = replace(choice, order=EverySample(), subpixels=None) == type(choice)()
    if not usual or clip is not None:
        raise ValueError(
            "samples with a shape each take an order by depth, by distance or along rays, and"
            " sub-pixels; leave other choices and clipping planes out"
        )
    from resample.painting.ellipsoids import ShapedOrder

    if isinstance(choice.order, Rays):
        return ShapedOrder.RAYS
    if not isinstance(choice.order, EverySample):
        raise ValueError(
            f"samples with a shape each are not summed by {type(choice.order).__name__}; take"
            " EverySample or Rays"
        )
    return ShapedOrder(choice.order.key)
