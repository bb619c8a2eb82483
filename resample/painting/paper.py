"""The paper's own painter (`resample.hybrid`) of volumes: voxels in strict depth order."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.engine.tiles import member_of, settle_ties
from resample.hybrid.blend import WAITING, OverBlend
from resample.hybrid.classify import Widths
from resample.hybrid.footprint import flat_table, footprint_table
from resample.hybrid.paint import Counts, paint
from resample.hybrid.points import LEAST_RADIUS
from resample.hybrid.record import RECORD, SPLAT, depth_order
from resample.hybrid.splats import LookupTables
from resample.hybrid.voxels import OrderedVoxels, place_voxels
from resample.painting.scenes import Clock, PaintTarget, PreparedScene, spacing_of
from resample.profiles.filters import Box, PixelFilter
from resample.profiles.orders import sheets_of
from resample.profiles.reconstruction import Reconstruction, variance
from resample.profiles.subpixels import painted_on_subpixels, subpixels_of
from resample.progress import Progress, told
from resample.registry import once
from resample.types import Film, Floats, Records, Samples, Stage, Statistics, View

FINEST = 8  # sub-pixels per side of a pixel, at most, unless more are asked for
POINT_SPACING = 0.6  # sub-pixels between points, at most; measured (docs/quality.md)


@kernel
def ordered(key: Floats, position: Floats, color: Floats, extinction: Floats) -> NDArray[np.int64]:
    """Indices (N,) of samples from near to far, whatever order they came in."""
    pair = depth_order(key)
    settle_ties(pair, position, color, extinction)
    order = np.empty(key.size, np.int64)
    for n in range(key.size):
        order[n] = member_of(pair[n])
    return order


class PlacedVoxels(NamedTuple):
    """Samples on the screen, in the order in which they are painted."""

    records: Records  # (N,) of RECORD
    density: Floats  # (N,) a splat's extinction per scene unit; a point's opacity
    color: Floats  # (N, 3)
    order: NDArray[np.int64]  # (N,) which samples they are


@dataclass(frozen=True)
class PaperPainter:
    """The paper's painter, for scenes with samples composited one by one.

    A sample cut by a clipping plane or the near plane is shown if its center is; if its cone
    of tangents meets the eye's plane, it is culled.
    """

    reconstruction: Reconstruction
    point_filter: PixelFilter
    threshold: float  # sub-pixels
    is_affine: bool = False  # ellipses follow from the projection's linear part
    is_projected: bool = False  # ellipses are around the projected center
    has_table: bool = True  # the correction is looked up, not evaluated
    are_wide: bool = False  # points are as wide as their kernels; the filter is in such widths
    subpixels: int = 1  # per side of a pixel; 0: as many as samples need
    pixel_filter: PixelFilter | None = None  # of sub-pixels; None: means over pixels

    @property
    def widths(self) -> Widths:
        """Sizes of footprints."""
        return Widths(
            self.threshold,
            radius_of(self.point_filter),
            _point_table(self.point_filter),
            is_affine=self.is_affine,
            is_projected=self.is_projected,
            variance=variance(self.reconstruction) if self.are_wide else 0.0,
        )

    @property
    def tables(self) -> LookupTables:
        """All lookup tables; the equation has none."""
        tables = LookupTables(_splat_table(self.reconstruction), _point_table(self.point_filter))
        return tables if self.has_table else tables._replace(largest=np.float32(-1.0))

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples, and how many were points and how many splats."""
        clock, size = Clock(), (scene.screen.height, scene.screen.width)
        fine, found = self.subpixels, []
        if not fine:  # points must not be farther apart than a share of a sub-pixel
            least = max(float(spacing_of(scene.view, samples).min(initial=np.inf)), 1e-6)
            finest = FINEST if self.threshold > 0 else 1
            fewest = math.ceil(1.0 / least) if self.threshold < np.inf else 1
            fine = max(1, min(finest, max(int(POINT_SPACING / least), fewest)))
        is_whole = fine == 1 and self.pixel_filter is None

        def part(view: View, size: tuple[int, int]) -> Film:
            placed = self.placed(scene, samples, view, size)
            clock.lap("project")
            with told(progress if is_whole else None, None):
                film, counts = self.blended(scene, placed, size)
            clock.lap("paint")
            found.append(counts)
            return film

        if is_whole:
            film = part(scene.view, size)
        else:
            given = self.pixel_filter or Box()
            fine = self.subpixels or max(fine, subpixels_of(given).count)
            parts = subpixels_of(given, fine)
            film = painted_on_subpixels(part, scene.view, size, parts, progress)
        counts = Counts(*(max(numbers) for numbers in zip(*found, strict=True)))
        tally = np.array([[counts.points, counts.splats, counts.hidden, fine]])
        numbers = samples.extinction.size, counts.points, counts.splats, counts.hidden, fine
        statistics = Statistics(*numbers, clock.seconds)
        statistics = statistics._replace(
            from_table=counts.from_table, by_equation=counts.by_equation
        )
        return PaintTarget(film, np.zeros((0, 0), np.float32), tally), statistics

    def placed(
        self, scene: PreparedScene, samples: Samples, view: View, size: tuple[int, int]
    ) -> PlacedVoxels:
        """Samples in their order: point or splat, and where on a screen of this size."""
        style, count = scene.style, samples.extinction.size
        key, layer = sheets_of(scene.layers, scene.summing, samples.position, scene.view)
        order = ordered(key, samples.position, samples.color, samples.extinction)
        records, density = np.zeros(count, RECORD), np.zeros(count, np.float32)
        voxels = OrderedVoxels(
            samples.position.take(order, axis=0).reshape(-1),
            samples.extinction.take(order),
            layer.take(order),
            style.layer,
        )
        screen = scene.screen._replace(height=size[0], width=size[1])
        stage = Stage(view, scene.ellipsoid, screen)
        place_voxels(records, density, voxels, stage, self.widths)
        color = samples.color.take(order, axis=0)
        is_splat = records["kind"] == SPLAT
        color[is_splat] = scene.tinted(color[is_splat])
        if style.linear_opacity:
            density[is_splat] = -np.expm1(-density[is_splat] * style.layer) / style.layer
        return PlacedVoxels(records, density, color, order)

    def blended(
        self, scene: PreparedScene, placed: PlacedVoxels, size: tuple[int, int]
    ) -> tuple[Film, Counts]:
        """Picture of a size of placed samples, front to back."""
        film = empty_film(size)
        is_linear = scene.style.linear_opacity
        waiting = np.zeros(size, WAITING)
        blend = OverBlend(placed.color, placed.density, is_linear, film, waiting)
        return film, paint(placed.records, self.tables, blend, size, None)


def radius_of(pixel_filter: PixelFilter) -> float:
    """Radius, px, of the circle that a filter is evaluated in."""
    return max(float(pixel_filter.radius), LEAST_RADIUS)


@once
def _splat_table(reconstruction: Reconstruction) -> Floats:
    return footprint_table(lambda distance: reconstruction(distance * reconstruction.radius))


@once
def _point_table(pixel_filter: PixelFilter) -> Floats:
    own, radius = pixel_filter.radius, radius_of(pixel_filter)
    return flat_table(lambda distance: pixel_filter(np.minimum(distance * radius, own)))


def empty_film(size: tuple[int, int]) -> Film:
    """Empty pictures of a size, as blends of `resample.hybrid` fill them."""
    return Film(
        np.zeros((*size, 4), np.float32),
        np.zeros(size, np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros(size, np.float32),
    )
