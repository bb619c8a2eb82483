"""The paper's own painter (`resample.hybrid`) of volumes: voxels in strict depth order."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.engine.sorting import member_of, settle_ties
from resample.hybrid.blend.over import WAITING, OverBlend
from resample.hybrid.classify import Widths
from resample.hybrid.footprint import flat_table, footprint_table
from resample.hybrid.paint import paint
from resample.hybrid.points import LEAST_RADIUS
from resample.hybrid.record import RECORD, SPLAT, depth_order
from resample.hybrid.splats import LookupTables
from resample.hybrid.voxels import OrderedVoxels, place_voxels
from resample.painting.scenes.scene import Clock, PaintTarget, PreparedScene
from resample.profiles.filters import PixelFilter
from resample.profiles.memoization import once
from resample.profiles.orders import sheets_of
from resample.profiles.reconstruction import Reconstruction
from resample.types import (
    Film,
    Floats,
    Samples,
    Statistics,
)
from resample.watching import Progress, told


@kernel
def ordered(key: Floats, position: Floats, color: Floats, extinction: Floats) -> NDArray[np.int64]:
    """Indices (N,) of samples from near to far, whatever order they came in."""
    pair = depth_order(key)
    settle_ties(pair, position, color, extinction)
    order = np.empty(key.size, np.int64)
    for n in range(key.size):
        order[n] = member_of(pair[n])
    return order


@dataclass(frozen=True)
class PaperPainter:
    """The paper's painter, of scenes whose samples are composited one by one.

    A sample that a clipping plane or the near plane cuts is shown if its center is; one whose cone
    of tangents meets the eye's plane is left out.
    """

    reconstruction: Reconstruction
    pixel_filter: PixelFilter
    threshold: float  # px
    is_affine: bool  # ellipses are the projection's linear part
    is_projected: bool  # ellipses are around the projected center
    has_table: bool  # the correction is looked up, not evaluated

    @property
    def widths(self) -> Widths:
        """Sizes of footprints."""
        return Widths(
            self.threshold,
            radius_of(self.pixel_filter),
            _point_table(self.pixel_filter),
            is_affine=self.is_affine,
            is_projected=self.is_projected,
        )

    @property
    def tables(self) -> LookupTables:
        """Everything that is looked up; the equation has no table."""
        tables = LookupTables(_splat_table(self.reconstruction), _point_table(self.pixel_filter))
        return tables if self.has_table else tables._replace(largest=np.float32(-1.0))

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        clock, style, count = Clock(), scene.style, samples.extinction.size
        size = (scene.screen.height, scene.screen.width)

        # Put the samples in depth order.
        key, layer = sheets_of(scene.layers, scene.summing, samples.position, scene.view)
        order = ordered(key, samples.position, samples.color, samples.extinction)
        clock.lap("sort")

        # Point or splat, and where on the screen.
        records, density = np.zeros(count, RECORD), np.zeros(count, np.float32)
        voxels = OrderedVoxels(
            samples.position.take(order, axis=0).reshape(-1),
            samples.extinction.take(order),
            layer.take(order),
            style.layer,
        )
        place_voxels(records, density, voxels, scene.stage, self.widths)
        color = samples.color.take(order, axis=0)
        is_splat = records["kind"] == SPLAT
        if style.tint_red >= 0.0:
            tint = np.array([style.tint_red, style.tint_green, style.tint_blue], np.float32)
            color[is_splat] = color[is_splat].max(axis=1, keepdims=True) * tint
        if style.linear_opacity:
            density[is_splat] = -np.expm1(-density[is_splat] * style.layer) / style.layer
        clock.lap("project")

        # Front to back.
        blend = _blend(size, color, density, style.linear_opacity)
        with told(progress, None):
            counts = paint(records, self.tables, blend, size, None)
        clock.lap("paint")
        tally = np.array([[counts.points, counts.splats, counts.hidden, 1]])
        statistics = Statistics(
            count,
            counts.points,
            counts.splats,
            counts.hidden,
            1,
            clock.seconds,
            from_table=counts.from_table,
            by_equation=counts.by_equation,
        )
        return PaintTarget(blend.film, np.zeros((0, 0), np.float32), tally), statistics


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


def _blend(size: tuple[int, int], color: Floats, density: Floats, is_linear: bool) -> OverBlend:
    """Empty pictures of a size."""
    film = Film(
        np.zeros((*size, 4), np.float32),
        np.zeros(size, np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros(size, np.float32),
    )
    return OverBlend(color, density, is_linear, film, np.zeros(size, WAITING))
