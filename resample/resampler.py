"""Hybrid forward resampling: classify, order, paint (paper, section 2, on one page)."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np

from resample.cameras import Camera
from resample.correction import correction_table
from resample.filters import Box, Gaussian, PixelFilter
from resample.filters import table as filter_table
from resample.orders import CompositingOrder, EverySample
from resample.reconstruction import (
    GaussianKernel,
    Reconstruction,
    density_table,
    footprint_table,
    variance,
)
from resample.scene import (
    Progress,
    Scene,
    check_samples,
    dealt_to_tiles,
    ellipsoid_of,
    screen_of,
    tile_size,
)
from resample.types import (
    FOOTPRINT,
    Doubles,
    Frame,
    RadialTable,
    Records,
    Samples,
    Seen,
    Sheets,
    Statistics,
    Style,
    Tables,
    View,
)

SPLAT_GRID, POINT_GRID = 4, 16  # most sub-pixels per side of a pixel, see `kernels.grid`
OPAQUE = 1e-4  # transmittance that counts as none
LARGEST_PICTURE = 2**28  # px
LITERAL_FILTER = Gaussian(0.5, 1.5, lowered=True)  # that points of the paper's form are seen under
POINT_FILTER = Gaussian(1.0, 3.0, lowered=True)  # likewise, in widths of a point


class Primitive(StrEnum):
    """What samples are painted as."""

    HYBRID = "hybrid"  # points on fine sub-pixels where they shrink, splats where they grow
    POINTS = "points"  # all of them points
    SPLATS = "splats"  # all of them splats, one ray per pixel
    PAPER = "paper"  # the paper's form: threshold 1 px, points summed at the size of pixels


class Footprint(StrEnum):
    """Model of a splat's footprint, see `resample.kernels.footprints`."""

    AFFINE = "affine"
    CORRECTED = "corrected"
    SMALL_ANGLE = "small-angle"
    EXACT = "exact"


class Opacity(StrEnum):
    """How a splat's line integral becomes opacity."""

    EXACT = "exact"  # 1 − exp(−τ F): transmittances multiply to the field's own
    LINEAR = "linear"  # classic splatting's α F


@dataclass(frozen=True)
class Resampler:
    """A renderer with all choices made; call it with samples and a camera.

    Parameters
    ----------
    primitive
        Points, splats, or each where it is better.
    footprint
        Model of the splats; None is exact, and corrected under `Primitive.PAPER`.
    pixel_filter
        Filter from sub-pixels to pixels; under `Primitive.PAPER` the filter that points are
        summed under at the pixels, where a box would do poorly: None chooses for the primitive.
    reconstruction
        Kernel around every sample.
    order
        Order of compositing.
    threshold
        A sample is a point when neighbours are at most this many sub-pixels apart on screen;
        None takes the primitive's own.
    subpixels
        Sub-pixels per side of a pixel; None lets hybrid and points choose per tile, up to 4 for
        splats and up to 16 for points, and is 1 otherwise.
    opacity
        Exact, or classic.
    splat_color
        Linear RGB that splats are drawn in, to tell them from points (Figure 8a); None: their own.
    """

    primitive: Primitive = Primitive.HYBRID
    footprint: Footprint | None = None
    pixel_filter: PixelFilter | None = None
    reconstruction: Reconstruction = field(default_factory=GaussianKernel)
    order: CompositingOrder = field(default_factory=EverySample)
    threshold: float | None = None
    subpixels: int | None = None
    opacity: Opacity = Opacity.EXACT
    splat_color: tuple[float, float, float] | None = None

    def __post_init__(self) -> None:
        if self.threshold is not None and not self.threshold >= 0:
            raise ValueError(f"the threshold is {self.threshold} sub-pixels; it must be 0 or more")
        if self.subpixels is not None and not 1 <= self.subpixels <= 32:
            raise ValueError(
                f"{self.subpixels} sub-pixels per side of a pixel; 1 to 32 are allowed"
            )

    def __call__(
        self,
        samples: Samples,
        camera: Camera,
        *,
        height: int,
        width: int,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Frame:
        """Picture of the samples.

        Parameters
        ----------
        samples
            What is seen; the result does not depend on their order.
        camera
            Where from.
        height, width
            Of the picture, px.
        threads
            At most this many; the result does not depend on it.
        progress
            Called with the share of the work that is done, 0 to 1, and may raise to stop.

        Raises
        ------
        ValueError
            Arrays do not fit together or hold values that are not finite, or the size is no size.
        """
        _check_size(height, width)
        checked = check_samples(samples)
        if checked.extinction.size == 0:
            return _empty_frame(height, width)
        with _kernels(threads):
            return self._render(checked, camera.view(), height, width, progress)

    def footprints(self, samples: Samples, camera: Camera, *, height: int, width: int) -> Records:
        """Records (N,) of `resample.types.FOOTPRINT`: what the painters get to know of each sample.

        Same parameters and errors as a call; left > right marks samples that cannot be seen.
        """
        _check_size(height, width)
        with _kernels(None):
            return self._project(check_samples(samples), camera.view(), height, width).footprints

    def _render(
        self, samples: Samples, view: View, height: int, width: int, progress: Progress | None
    ) -> Frame:
        clock = _Clock()
        scene = self._project(samples, view, height, width)
        clock.lap("project")
        key, sheet = self.order(
            Seen(scene.footprints, samples.position, samples.lattice, scene.view, scene.style.layer)
        )
        sheets = Sheets(
            np.ascontiguousarray(key, np.float32), np.ascontiguousarray(sheet, np.int32)
        )
        size = tile_size(scene.footprints, scene.style)
        tiles = dealt_to_tiles(scene.footprints, scene.screen, size)
        clock.lap("bin")
        picture, tally = scene.paint(sheets, tiles, progress)
        clock.lap("paint")
        points, splats, hidden = (int(count) for count in tally[:, :3].sum(axis=0))
        statistics = Statistics(
            samples.extinction.size, points, splats, hidden, int(tally[:, 3].max()), clock.seconds
        )
        depth, first_depth, coverage = np.ascontiguousarray(picture[..., 4:].transpose(2, 0, 1))
        rgba = np.ascontiguousarray(picture[..., :4])
        return Frame(rgba, depth, first_depth, coverage, statistics)

    def _project(self, samples: Samples, view: View, height: int, width: int) -> Scene:
        from resample.kernels.footprints import project

        tables, style = self._tables, self._style(samples.lattice)
        ellipsoid = ellipsoid_of(samples.lattice, view, self.reconstruction.radius)
        # Where points have the pixel's filter, that is the farther reach.
        reach = max(tables.pixel_margin, 0.0 if style.variance else style.point_extent)
        screen = screen_of(width, height, reach, view, ellipsoid)
        footprints = np.zeros(samples.extinction.size, FOOTPRINT)
        project(footprints, samples, view, ellipsoid, screen, style)
        return Scene(footprints, view, ellipsoid, screen, style, tables)

    @cached_property
    def _points(self) -> RadialTable:
        """Profile of the filter that points are added under."""
        # Sub-pixel points are seen under their own kernel's projection, close to a Gaussian of
        # that variance; the paper's are seen under the pixel's filter.
        literal = self.primitive is Primitive.PAPER
        return filter_table((self.pixel_filter or LITERAL_FILTER) if literal else POINT_FILTER)

    @cached_property
    def _tables(self) -> Tables:
        """Everything that kernels look up."""
        literal = self.primitive is Primitive.PAPER
        pixel = filter_table(Box() if literal else self.pixel_filter or Box())
        return Tables(
            footprint_table(self.reconstruction).values,
            density_table(self.reconstruction).values,
            correction_table(),
            self._points.values,
            *pixel,
            math.ceil(pixel.extent - 0.501),  # the table of a box ends a sliver beyond 0.5
        )

    def _style(self, lattice: Doubles) -> Style:
        """Choices as numbers."""
        primitive = self.primitive
        own = {
            Primitive.HYBRID: 0.8,  # measured (docs/quality.md)
            Primitive.POINTS: np.inf,
            Primitive.SPLATS: 0.0,
            Primitive.PAPER: 1.0,  # "magnified" and "minified" taken literally
        }
        threshold = own[primitive] if self.threshold is None else self.threshold
        fixed = 1 if primitive in (Primitive.SPLATS, Primitive.PAPER) else 0
        tint = (-1.0, -1.0, -1.0) if self.splat_color is None else self.splat_color
        paper_or_ours = Footprint.CORRECTED if primitive is Primitive.PAPER else Footprint.EXACT
        footprint = self.footprint or paper_or_ours
        voxel = abs(np.linalg.det(lattice)) ** (1 / 3)
        return Style(
            model=list(Footprint).index(footprint),
            threshold=float(threshold),
            subpixels=fixed if self.subpixels is None else self.subpixels,
            most_for_splats=1 if primitive is Primitive.POINTS else SPLAT_GRID,
            most_for_points=POINT_GRID,
            point_extent=self._points.extent,
            variance=0.0 if primitive is Primitive.PAPER else variance(self.reconstruction),
            linear_opacity=self.opacity is Opacity.LINEAR,
            layer=float(voxel * self.order.thickness),
            opaque=OPAQUE,
            **dict(zip(("tint_red", "tint_green", "tint_blue"), tint, strict=True)),
        )


class _Clock:
    """Seconds per stage."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Book the time since the last call under `stage`."""
        now = time.perf_counter()
        self.seconds[stage] = now - self._last
        self._last = now


@contextmanager
def _kernels(threads: int | None) -> Iterator[None]:
    from resample.kernels.jit import threads as limited

    with limited(threads):
        yield


def _check_size(height: int, width: int) -> None:
    if height < 1 or width < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a picture of {width} x {height} pixels; both sides must be at least 1 and there can "
            f"be at most {LARGEST_PICTURE} pixels"
        )


def _empty_frame(height: int, width: int) -> Frame:
    nothing = np.full((height, width), np.inf, np.float32)
    return Frame(
        np.zeros((height, width, 4), np.float32),
        nothing,
        nothing.copy(),
        np.zeros((height, width), np.float32),
        Statistics(0, 0, 0, 0, 1, {}),
    )
