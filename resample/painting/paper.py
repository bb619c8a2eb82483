"""The paper's own painter (`resample.hybrid`) of volumes: voxels in strict depth order."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.engine.sorting import member_of, settle_ties
from resample.hybrid.blend.over import WAITING, OverBlend
from resample.hybrid.classify import Widths
from resample.hybrid.footprint import flat_table, footprint_table
from resample.hybrid.occlusion import TILE
from resample.hybrid.paint import paint
from resample.hybrid.points import LEAST_RADIUS
from resample.hybrid.record import RECORD, SPLAT, depth_order
from resample.hybrid.splats import LookupTables
from resample.hybrid.voxels import OrderedVoxels, place_voxels
from resample.painting.scenes.cuts import RunPainter
from resample.painting.scenes.plans import NOTHING as NO_WINDOW
from resample.painting.scenes.plans import (
    PAPER,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    Window,
    together,
)
from resample.painting.scenes.scene import (
    Clock,
    PaintTarget,
    PreparedScene,
    nothing_painted,
    tiles_along,
)
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
    of tangents meets the eye's plane is left out. Nothing of a picture depends on all samples.
    """

    reconstruction: Reconstruction
    pixel_filter: PixelFilter
    threshold: float  # px
    is_affine: bool  # ellipses are the projection's linear part
    is_projected: bool  # ellipses are around the projected center
    has_table: bool  # the correction is looked up, not evaluated

    needs_together = (
        "the primitive paper composites all samples of a window together; give paint_window its "
        "samples, or take the primitive hybrid"
    )

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

    def plans(self, scene: PreparedScene, samples: Samples, asked: Sequence[str]) -> PlansOfPart:
        """The plan of some samples; it counts as one of a mixture, whatever is asked for."""
        del asked
        return PlansOfPart(None, None, self._plan(scene, samples.extinction.size))

    def plan_of_all(self, scene: PreparedScene, parts: Sequence[PlansOfPart]) -> PicturePlan | None:
        del scene
        return together([part.mixture for part in parts if part.mixture is not None])

    def plan_of_parts(self, scene: PreparedScene, source: SamplesInParts) -> PicturePlan | None:
        """None: samples are counted when they are loaded."""
        del scene, source
        return None

    def margin(self, scene: PreparedScene, plan: PicturePlan) -> tuple[bool, float]:
        del scene, plan
        return self.is_projected, self.pixel_filter.radius

    def spacings(self, scene: PreparedScene, samples: Samples) -> Floats:
        """As many ones as tiles: none is finer than another."""
        del samples
        return np.ones(math.prod(tiles_along(scene.screen, TILE)), np.float32)

    def by_runs(self, scene: PreparedScene) -> tuple[PreparedScene, RunPainter]:
        """Refused: samples are not painted by runs."""
        del scene
        raise ValueError(self.needs_together)

    def _plan(self, scene: PreparedScene, samples: int) -> PicturePlan:
        height, width = scene.screen.height, scene.screen.width
        same, sides = np.float32(1.0), (0.0, 0.0, float(width), float(height))
        size, margin = (height, width), self.widths.filter
        return PicturePlan(
            PAPER, size, TILE, margin, same, same, 0.0, 0.0, scene.layers, sides, samples
        )

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        clock, style, count = Clock(), scene.style, samples.extinction.size
        size = (scene.screen.height, scene.screen.width)
        plan = scene.plan or self._plan(scene, count)
        if scene.window == NO_WINDOW:
            return nothing_painted(0, 0)._replace(plan=plan), Statistics(0, 0, 0, 0, 1, {})

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
        blend = _blend(size, scene.window, color, density, style.linear_opacity)
        with told(progress, None):
            counts = paint(records, self.tables, blend, size, scene.window)
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
        return PaintTarget(blend.film, np.zeros((0, 0), np.float32), tally, plan), statistics


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


def _blend(
    size: tuple[int, int],
    window: Window | None,
    color: Floats,
    density: Floats,
    is_linear: bool,
) -> OverBlend:
    """Empty pictures of a size, of which memory is taken where there is something to paint."""
    y0, y1 = (0, size[0]) if window is None else (window[1], window[3])
    first_depth = np.empty(size, np.float32)
    first_depth[y0 // TILE * TILE : -(-y1 // TILE) * TILE] = np.inf
    film = Film(
        np.zeros((*size, 4), np.float32),
        np.zeros(size, np.float32),
        first_depth,
        np.zeros(size, np.float32),
    )
    return OverBlend(color, density, is_linear, film, np.zeros(size, WAITING))
