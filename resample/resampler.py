"""Hybrid forward resampling: classify, order, paint (paper, section 2, on one page)."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

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
from resample.types import (
    FOOTPRINT,
    Doubles,
    Ellipsoid,
    Floats,
    Frame,
    RadialTable,
    Records,
    Samples,
    Screen,
    Sheets,
    Statistics,
    Style,
    Tables,
    Tiles,
    View,
)

SPLAT_GRID, POINT_GRID = 4, 16  # most sub-pixels per side of a pixel, see `kernels.grid`
OPAQUE = 1e-4  # transmittance that counts as none
MEMBERS_PER_STEP = 2_000_000  # between two looks at the progress and at Ctrl-C
LARGEST_PICTURE = 2**28  # px

Progress = Callable[[float], None]


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
        key, sheet = self.order(scene.footprints, scene.style.layer)
        sheets = Sheets(
            np.ascontiguousarray(key, np.float32), np.ascontiguousarray(sheet, np.int32)
        )
        tiles = _bin(scene.footprints, scene.screen, scene.style)
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

    def _project(self, samples: Samples, view: View, height: int, width: int) -> "_Scene":
        from resample.kernels.footprints import project

        tables, style = self._tables, self._style(samples.lattice)
        ellipsoid = ellipsoid_of(samples.lattice, view, self.reconstruction.radius)
        # Where points have the pixel's filter, that is the farther reach.
        reach = max(tables.pixel_margin, 0.0 if style.variance else style.point_extent)
        screen = screen_of(width, height, reach, view, ellipsoid)
        footprints = np.zeros(samples.extinction.size, FOOTPRINT)
        project(footprints, samples, view, ellipsoid, screen, style)
        return _Scene(footprints, view, ellipsoid, screen, style, tables)

    @cached_property
    def _points(self) -> RadialTable:
        """Profile of the filter that points are added under."""
        # Sub-pixel points are seen under their own kernel's projection, close to a Gaussian of
        # that variance; the paper's are seen under the pixel's filter.
        literal = self.primitive is Primitive.PAPER
        return filter_table((self.pixel_filter or Gaussian(0.5)) if literal else Gaussian(1.0))

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


@dataclass(frozen=True)
class _Scene:
    """Everything the painters read."""

    footprints: Records
    view: View
    ellipsoid: Ellipsoid
    screen: Screen
    style: Style
    tables: Tables

    def paint(
        self, sheets: Sheets, tiles: Tiles, progress: Progress | None
    ) -> tuple[Floats, NDArray[np.int64]]:
        """Frame (H, W, 7) and the tally of every tile, painted in steps that can be watched."""
        from resample.kernels.paint import paint_tiles

        frame = np.zeros((self.screen.height, self.screen.width, 7), np.float32)
        frame[..., 4:6] = np.inf
        load = np.diff(tiles.start)
        tally = np.zeros((load.size, 4), np.int64)
        turn = np.argsort(-load, kind="stable")
        turn = turn[load[turn] > 0]
        done = np.cumsum(load[turn])
        total = done[-1] if done.size else 0
        first = 0
        while first < turn.size:
            before = done[first - 1] if first else 0
            last = max(first + 1, int(np.searchsorted(done, before + MEMBERS_PER_STEP)))
            paint_tiles(
                turn[first:last],
                tiles,
                self.footprints,
                sheets,
                sheets.key.view(np.uint32),
                self.view,
                self.ellipsoid,
                self.screen,
                self.style,
                self.tables,
                frame,
                tally,
            )
            first = last
            if progress is not None:
                progress(done[last - 1] / total)
        return frame, tally


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


def check_samples(samples: Samples) -> Samples:
    """Samples as contiguous float32 arrays that fit together.

    Raises
    ------
    ValueError
        Shapes do not fit, a value is not finite, an extinction is negative, or the lattice is
        singular.
    """
    position = np.ascontiguousarray(samples.position, np.float32)
    color = np.ascontiguousarray(samples.color, np.float32)
    extinction = np.ascontiguousarray(samples.extinction, np.float32)
    lattice = np.ascontiguousarray(samples.lattice, np.float64)
    count = extinction.size
    if extinction.ndim != 1 or position.shape != (count, 3) or color.shape != (count, 3):
        raise ValueError(
            f"positions {position.shape}, colors {color.shape} and extinctions {extinction.shape} "
            "do not fit; they have shapes (N, 3), (N, 3) and (N,)"
        )
    if lattice.shape != (3, 3) or not _is_regular(lattice):
        raise ValueError("the lattice must be a finite, regular matrix (3, 3)")
    for name, array in (("position", position), ("color", color), ("extinction", extinction)):
        if not np.isfinite(array).all():
            raise ValueError(f"a sample's {name} is not finite; leave such samples out")
    if count and extinction.min() < 0:
        raise ValueError(f"an extinction is {extinction.min()}; it must be 0 or more")
    return Samples(position, color, extinction, lattice)


def _is_regular(matrix: Doubles) -> bool:
    """Whether a matrix can be inverted in float64 without losing all digits."""
    return bool(np.isfinite(matrix).all() and np.linalg.cond(matrix) < 1e12)


def ellipsoid_of(lattice: Doubles, view: View, radius: float) -> Ellipsoid:
    """Reconstruction ellipsoid of a lattice (3, 3) in a camera's axes; `radius` in voxels."""
    from_unit = view.rotation @ lattice * radius
    to_unit = np.linalg.inv(from_unit).astype(np.float64)
    return Ellipsoid(
        to_unit,
        to_unit[:, :2] / view.focal,
        np.ascontiguousarray(from_unit),
        from_unit @ from_unit.T,
        float(abs(np.linalg.det(lattice))),
        1 / radius**3,
        float(radius),
    )


def screen_of(width: int, height: int, margin: float, view: View, ellipsoid: Ellipsoid) -> Screen:
    """Picture of that size, with the planes beyond which an ellipsoid's center cannot be seen."""
    sides = np.zeros((4, 4))
    for side, (axis, edge) in enumerate(
        [(0, -margin), (0, width + margin), (1, -margin), (1, height + margin)]
    ):
        sign = -1.0 if side % 2 == 0 else 1.0
        offset = sign * (edge - view.principal[axis]) / view.focal[axis]
        sides[side, axis] = sign
        sides[side, 2 if view.perspective else 3] = -offset
        outward = sides[side, :3]
        sides[side, 3] -= np.sqrt(outward @ ellipsoid.covariance @ outward)
    return Screen(width, height, float(margin), sides)


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


def _bin(footprints: Records, screen: Screen, style: Style) -> Tiles:
    """Members of every tile; tiles are smaller where pixels are divided finer."""
    from resample.kernels.grid import grid
    from resample.kernels.tiles import CHUNKS, count_members, deal_members, smallest_spacing

    finest = grid(smallest_spacing(footprints), style)
    size = max(8, 32 // finest)
    columns, rows = -(-screen.width // size), -(-screen.height // size)
    count = np.zeros((CHUNKS, rows * columns), np.int64)
    count_members(footprints, screen, size, columns, count)
    start = np.concatenate([[0], np.cumsum(count.sum(axis=0))])
    position = start[:-1] + np.cumsum(count, axis=0) - count
    smallest = np.full(count.shape, np.inf, np.float32)
    tiles = Tiles(start, np.zeros(start[-1], np.int32), smallest[0], size, columns)
    deal_members(footprints, screen, tiles, position, smallest)
    return tiles._replace(spacing=smallest.min(axis=0))
