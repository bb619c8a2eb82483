"""Hybrid forward resampling: classify, order, paint (paper, section 2, on one page)."""

import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import InitVar, dataclass, field, fields, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyCamera
from resample.painting.choices import (
    FOOTPRINTS,
    MEASURING,
    OWN_FOOTPRINT,
    SCALED,
    SUMS,
    WHOLE,
    Footprint,
    Opacity,
    Primitive,
    Projection,
    number_of,
)
from resample.painting.scenes.plans import (
    ALL_PAINTERS,
    NOTHING,
    POINTS,
    SPLATS,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    Window,
    check_size,
    checked_window,
    together,
)
from resample.painting.scenes.scene import (
    PaintTarget,
    PreparedScene,
    check_samples,
    ellipsoid_of,
    kernel_classifier,
    kernel_field,
    nothing_painted,
    planes_of,
    samples_of,
    screen_of,
)
from resample.profiles import filters
from resample.profiles.filters import Box, Gaussian, PixelFilter
from resample.profiles.memoization import once
from resample.profiles.orders import (
    OF_FIELDS,
    CompositingOrder,
    EverySample,
    Rays,
    Summing,
    layers_of,
)
from resample.profiles.reconstruction import (
    GaussianKernel,
    Reconstruction,
    footprint_pieces,
    footprint_profile,
    footprint_table,
    partial_table,
    variance,
)
from resample.types import (
    FOOTPRINT,
    Classifier,
    Doubles,
    Field,
    Film,
    Floats,
    Frame,
    LatticeField,
    Pieces,
    Profile,
    Records,
    Samples,
    Statistics,
    Style,
    Tables,
    View,
)
from resample.watching import Progress

if TYPE_CHECKING:
    from resample.painting.paper import PaperChoices
    from resample.painting.scenes.cuts import InSteps
    from resample.painting.steps.planning import Painters

filter_table = once(filters.table)


@once
def filter_profile(pixel_filter: PixelFilter) -> Profile | None:
    """A filter's table as a formula, where there is one."""
    return filters.profile(filter_table(pixel_filter))


SPLAT_GRID, POINT_GRID = 16, 16  # most sub-pixels per side of a pixel, see `kernels.grid`
OPAQUE = 1e-4  # transmittance that counts as none
EWA_VARIANCE = 0.25  # px², of the Gaussian that stands for a pixel's filter
PAPER_FILTER = Gaussian(0.4, 1.2, lowered=True)  # see `resample.hybrid.points`
POINT_FILTER = Gaussian(1.0, 3.0, lowered=True)  # likewise, in widths of a point


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
        Sub-pixels per side of a pixel; None lets hybrid and points choose per tile, up to 16 for
        splats and for points, and is 1 otherwise.
    opacity
        Exact, or classic.
    splat_color
        Linear RGB that splats are drawn in, to tell them from points (Figure 8a); None: their own.
    projection
        What pixels show.
    iso
        Value that `Projection.FIRST_HIT` looks for, data units.
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

    primitive: Primitive = Primitive.HYBRID
    footprint: Footprint | None = None
    pixel_filter: PixelFilter | None = None
    reconstruction: Reconstruction = field(default_factory=GaussianKernel)
    order: CompositingOrder = field(default_factory=EverySample)
    threshold: float | None = None
    subpixels: int | None = None
    opacity: Opacity = Opacity.EXACT
    splat_color: tuple[float, float, float] | None = None
    projection: Projection = Projection.COMPOSITE
    iso: float | None = None
    method: InitVar[str | None] = None

    def __post_init__(self, method: str | None) -> None:
        if method is not None:
            object.__setattr__(self, "primitive", _primitive_named(method))
        _check_together(self)
        if self.threshold is not None and not self.threshold >= 0:
            raise ValueError(f"the threshold is {self.threshold} sub-pixels; it must be 0 or more")
        if self.subpixels is not None and not 1 <= self.subpixels <= 32:
            raise ValueError(
                f"{self.subpixels} sub-pixels per side of a pixel; 1 to 32 are allowed"
            )

    def __call__(
        self,
        samples: Samples | Field | LatticeField,
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
            What is seen; the result does not depend on their order. A `Field` is classified after
            its reconstruction, which needs an order that cuts splats, as `ImageSheets` does; a
            `LatticeField` needs `Rays`.
        camera
            Where from.
        height, width
            Of the picture, px.
        threads
            At most this many; the result does not depend on it.
        progress
            Called with the share of the work that is done, 0 to 1, and may raise to stop.
        clip
            (M, 4) planes: normal and offset, scene units. Of the reconstructed field only that is
            seen where n · p + d is 0 or more for all of them.

        Raises
        ------
        ValueError
            Arrays do not fit together or hold values that are not finite, the size is no size, a
            field or its projection does not go with the order, or choices are not for samples that
            have a scale each.
        """
        check_size(height, width)
        self._check_field(samples)
        if isinstance(samples, LatticeField):
            with _kernels(threads):
                return self._gathered(samples, camera.view(), (height, width), clip, progress)
        checked, look = _checked(samples)
        if checked.scale is not None:
            self._check_scaled()
        if checked.extinction.size == 0:
            nothing = nothing_painted(height, width, has_values=True)
            return self._developed(nothing, Statistics(0, 0, 0, 0, 1, {}))
        with _kernels(threads):
            scene = self._scene(checked, camera.view(), (height, width), look, clip)
            return self._developed(*self._painted(scene, checked, progress))

    def _painted(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of a scene by whom its order asks for."""
        if self._is_paper:
            from resample.painting.paper import paint_paper

            return paint_paper(scene, samples, self._choices_of_paper, progress)
        if self._is_streamed(scene):
            return self._streamed(scene, samples, progress)
        from resample.painting.slabs import paint_summed

        return paint_summed(scene, samples, self.reconstruction, progress)

    @property
    def _is_paper(self) -> bool:
        """Whether the paper's own painter paints."""
        return self.primitive is Primitive.PAPER

    @cached_property
    def _choices_of_paper(self) -> "PaperChoices":
        """What the paper's own painter is asked for."""
        from resample.painting.paper import PaperChoices as Choices

        footprint = self.footprint or Footprint.CORRECTED
        threshold = self._style(np.eye(3), None).threshold
        return Choices(self.reconstruction, self._point_filter, footprint, threshold)

    def _is_streamed(self, scene: PreparedScene) -> bool:
        """Whether splats are composited one by one."""
        return scene.classifier is None and self.order.summing is Summing.POINTS

    def plan(
        self,
        samples: Samples | Field | LatticeField,
        camera: AnyCamera,
        *,
        height: int,
        width: int,
        clip: ArrayLike | None = None,
    ) -> PicturePlan:
        """What a picture depends on besides the samples that are seen in a window of it.

        Same parameters as a call. Where not all samples are in memory together, `plan_of` makes it
        of `plans` of some after the other.

        Raises
        ------
        ValueError
            As a call does; or such a picture cannot be painted window by window, or has no samples.
        """
        check_size(height, width)
        self._check_field(samples)
        checked, look = self._checked_for_windows(samples)
        with _kernels(None):
            scene = self._scene(checked, camera.view(), (height, width), look, clip)
            painted, _ = self._painted(replace(scene, window=NOTHING), checked, None)
        if painted.plan is None:
            raise RuntimeError("a scene is planned before it is painted")
        return painted.plan

    def plans(
        self,
        samples: Samples | Field,
        camera: AnyCamera,
        *,
        height: int,
        width: int,
        clip: ArrayLike | None = None,
        painters: Sequence[str] = ALL_PAINTERS,
    ) -> PlansOfPart:
        """What some samples say of a picture, of which others are seen, too.

        Parameters and errors as of `plan`; of who may turn out to paint all samples those are
        asked that are in `painters`: "splats", "points", "mixture".
        """
        from resample.painting.steps.planning import plans_of

        check_size(height, width)
        self._check_field(samples)
        checked, look = self._checked_for_windows(samples)
        with _kernels(None):
            scene = self._scene(checked, camera.view(), (height, width), look, clip)
            if self._is_paper:
                painted, _ = self._painted(replace(scene, window=NOTHING), checked, None)
                return PlansOfPart(None, None, painted.plan)
            return plans_of(scene, checked, self._painters(scene), painters)

    def plan_of(
        self,
        parts: Sequence[PlansOfPart],
        lattice: Doubles,
        camera: AnyCamera,
        *,
        height: int,
        width: int,
    ) -> PicturePlan | None:
        """Plan of a picture that `plan` would give of all samples together.

        Parameters
        ----------
        parts
            From `plans`, of all samples.
        lattice
            (3, 3) of them.
        camera, height, width
            As of a call.

        Returns
        -------
        None where painters have to be asked that were left out.
        """
        if self._is_paper:
            return together([part.mixture for part in parts if part.mixture is not None])
        from resample.painting.steps.planning import plan_of_all

        with _kernels(None):
            scene = self._of_nothing(lattice, camera, (height, width))
            return plan_of_all(scene, self._painters(scene), parts)

    def margin_beyond_window(
        self, plan: PicturePlan, lattice: Doubles, camera: AnyCamera
    ) -> tuple[bool, float]:
        """How far samples are painted beyond what their ellipsoids cover of the screen.

        Returns
        -------
        Whether they reach as far on one side of their center as on the other; and px, at most.
        """
        if self._is_paper:
            return self._choices_of_paper.widths.is_projected, self._point_filter.radius
        from resample.painting.steps.planning import margin_beyond_window

        return margin_beyond_window(self._of_nothing(lattice, camera, plan.size), plan)

    def _of_nothing(
        self, lattice: Doubles, camera: AnyCamera, size: tuple[int, int]
    ) -> PreparedScene:
        """Scene whose samples are not at hand."""
        nobody = np.zeros((0, 3), np.float32)
        nothing = Samples(nobody, nobody, nobody[:, 0], lattice)
        return self._scene(nothing, camera.view(), size, None, None)

    def _painters(self, scene: PreparedScene) -> "Painters":
        """Who may paint samples."""
        from resample.painting.steps.planning import Painters

        return Painters(self._is_streamed(scene), self._point_profile is not None)

    def _checked_for_windows(
        self, samples: Samples | Field | LatticeField
    ) -> tuple[Samples, Classifier | None]:
        """Samples and the look of a field, if they can be painted window by window."""
        self._check_whole(isinstance(samples, Field | LatticeField))
        assert not isinstance(samples, LatticeField)
        checked, look = _checked(samples)
        if checked.extinction.size == 0:
            raise ValueError("there are no samples, so there is nothing to plan; leave plans out")
        if checked.scale is not None:
            self._check_scaled()
        return checked, look

    def _check_whole(self, is_field: bool) -> None:
        """Refuse choices that take all of a picture together, and those that are for fields."""
        if self.order.summing is Summing.RAYS or self.projection in WHOLE:
            is_by_rays = self.order.summing is Summing.RAYS
            raise ValueError(
                f"{'the order rays' if is_by_rays else self.projection} cannot be painted window "
                "by window; leave the window out, or take another projection of samples in "
                "another order"
            )
        if not is_field and self.projection is not Projection.COMPOSITE:
            raise ValueError(f"the projection {self.projection} needs a field's classifier")

    def paint_window(
        self,
        samples: Samples | Field,
        camera: AnyCamera,
        plan: PicturePlan,
        window: Window,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
        clip: ArrayLike | None = None,
    ) -> Frame:
        """Window of a picture, with the bits that the whole picture has there.

        Parameters
        ----------
        samples
            Those that are seen in the window, at least; in any order.
        camera
            Of the whole picture.
        plan
            Of the whole picture and all of its samples, from `plan`.
        window
            (x0, y0, x1, y1) px of the whole picture: the frame is of y1 - y0 rows and x1 - x0
            columns of it. Tiles that it cuts are painted whole.
        threads, progress, clip
            As of a call. Statistics count what was painted, and nothing as hidden.

        Raises
        ------
        ValueError
            As a call does; or the window is no part of the picture, or cannot be painted by itself.
        """
        x0, y0, x1, y1 = checked_window(window, *plan.size)
        self._check_field(samples)
        if isinstance(samples, Samples) and not len(samples.extinction):
            nothing = nothing_painted(y1 - y0, x1 - x0)
            return self._developed(nothing, Statistics(0, 0, 0, 0, 1, {}))
        checked, look = self._checked_for_windows(samples)
        with _kernels(threads):
            scene = self._scene(checked, camera.view(), plan.size, look, clip)
            scene = replace(scene, layers=plan.layers, plan=plan, window=(x0, y0, x1, y1))
            painted, statistics = self._painted(scene, checked, progress)
        return self._cut_out(painted, statistics, (x0, y0, x1, y1))

    def with_spacing(
        self,
        plan: PicturePlan,
        samples: Samples | Field,
        camera: AnyCamera,
        clip: ArrayLike | None = None,
    ) -> PicturePlan:
        """Plan that knows how fine its tiles are, as far as some samples more say it.

        Parameters
        ----------
        plan
            Of all samples; or of others, if it turns out to have the same tiles.
        samples, camera, clip
            As of a call; samples of one part of the picture after the other.
        """
        from resample.painting.points import spacings_of_points
        from resample.painting.slabs import spacings_of_summed
        from resample.painting.splats import spacings_of

        checked, look = self._checked_for_windows(samples)
        with _kernels(None):
            scene = self._scene(checked, camera.view(), plan.size, look, clip)
            scene = replace(scene, layers=plan.layers, plan=plan._replace(spacing=None))
            if not self._is_streamed(scene):
                found = spacings_of_summed(scene, checked)
            else:
                by_points = plan.painter == POINTS
                found = (spacings_of_points if by_points else spacings_of)(scene, checked)
        if plan.spacing is not None:
            found = np.minimum(found, plan.spacing)
        return plan._replace(spacing=found)

    def plan_of_parts(
        self, source: SamplesInParts, camera: AnyCamera, *, height: int, width: int
    ) -> PicturePlan | None:
        """Plan of a picture of samples that are not loaded for it; None: that needs them.

        It may stand for `plan` of them all: windows have the same bits.
        """
        from resample.painting.splats import are_splats_exact
        from resample.painting.steps.planning import plan_of_parts

        check_size(height, width)
        with _kernels(None):
            scene = self._of_nothing(source.lattice, camera, (height, width))
            needs_first = self.order(scene.view, source.lattice).begins_at_first
            if self._is_paper or needs_first or not (are_splats_exact(scene) and len(source.sizes)):
                return None
            return plan_of_parts(scene, source, self._painters(scene))

    def paint_nearest_first(
        self,
        source: SamplesInParts,
        camera: AnyCamera,
        plan: PicturePlan,
        window: Window,
        *,
        threads: int | None = None,
        progress: Progress | None = None,
        clip: ArrayLike | None = None,
    ) -> Frame:
        """As `paint_window`, of samples that are loaded as they are needed, nearest parts first.

        Parts that opaque ones hide are not loaded.

        Parameters
        ----------
        source
            All samples that are seen in the window, at least.
        camera, window, threads, progress, clip
            As of `paint_window`.
        plan
            Of all samples; unless it `is_even`, `with_spacing` of them all.

        Raises
        ------
        ValueError
            As `paint_window` does; or it is not known how fine tiles are.
        """
        from resample.painting.steps.painting import paint_in_steps

        window = checked_window(window, *plan.size)
        self._check_whole(source.classifier is not None)
        if self._is_paper:
            raise ValueError(
                "the primitive paper composites all samples of a window together; give paint_window"
                " its samples, or take the primitive hybrid"
            )
        if not self.can_step(plan):
            raise ValueError(
                "the tiles of this picture are not all as fine, and the plan does not know how "
                "fine each is; give that of `with_spacing`"
            )
        with _kernels(threads):
            scene, by = self._in_steps(source, camera, plan, window, clip)
            painted = paint_in_steps(scene, by, source, progress)
        return self._cut_out(painted, Statistics(int(source.sizes.sum()), 0, 0, 0, 1, {}), window)

    def is_even(self, plan: PicturePlan) -> bool:
        """Whether all tiles of a picture are as fine."""
        from resample.engine.subpixels import grid_of

        style = self._style(np.eye(3), None)
        if self.projection is Projection.FIRST_HIT:
            return True
        return bool(grid_of(plan.least, style) == grid_of(plan.most, style))

    def can_step(self, plan: PicturePlan) -> bool:
        """Whether a picture of this plan can be painted nearest parts first."""
        is_whole = self.projection in WHOLE or self.order.summing is Summing.RAYS
        return not (is_whole or self._is_paper) and (plan.spacing is not None or self.is_even(plan))

    def kept_between_steps(
        self, source: SamplesInParts, camera: AnyCamera, plan: PicturePlan, window: Window
    ) -> tuple[int, int]:
        """What `paint_nearest_first` keeps of a window besides its picture.

        Returns
        -------
        Bytes, and samples that wait for nearer ones, at most.
        """
        from resample.painting.scenes.cuts import most_waiting
        from resample.painting.steps.painting import state_bytes

        scene, by = self._in_steps(source, camera, plan, window, None)
        return state_bytes(scene, by), most_waiting(scene, source, by.between)

    def _in_steps(
        self,
        source: SamplesInParts,
        camera: AnyCamera,
        plan: PicturePlan,
        window: Window,
        clip: ArrayLike | None,
    ) -> "tuple[PreparedScene, InSteps]":
        """Scene of a picture that was planned, and how its samples are painted step by step."""
        from resample.painting.points import points_in_steps
        from resample.painting.slabs import summed_in_steps
        from resample.painting.splats import formula_of, splats_in_steps

        none = np.zeros((0, 3), np.float32)
        nothing = Samples(none, none, none[:, 0], source.lattice)
        look = None if source.classifier is None else kernel_classifier(source.classifier)
        scene = self._scene(nothing, camera.view(), plan.size, look, clip)
        scene = replace(scene, layers=plan.layers, plan=plan, window=window)
        if not self._is_streamed(scene):
            return summed_in_steps(scene, self.reconstruction)
        if plan.painter == POINTS and self._point_profile is not None:
            return scene, points_in_steps(scene, self._point_profile)
        formula = formula_of(scene, self._profile, self._pieces)
        return scene, splats_in_steps(scene, formula)

    def _cut_out(self, painted: PaintTarget, statistics: Statistics, window: Window) -> Frame:
        """Frame of a window of a picture."""
        x0, y0, x1, y1 = window
        part = slice(y0, y1), slice(x0, x1)
        film = Film(*(np.ascontiguousarray(layer[part]) for layer in painted.film))
        value = painted.value[part].copy() if painted.value.size else painted.value
        counts = painted.statistics(statistics.samples, statistics.seconds)
        return self._developed(painted._replace(film=film, value=value), counts)

    def footprints(
        self, samples: Samples | Field, camera: AnyCamera, *, height: int, width: int
    ) -> Records:
        """Records (N,) of `resample.types.FOOTPRINT`: each sample as the camera sees it.

        Same parameters and errors as a call; left > right marks samples that cannot be seen.
        """
        check_size(height, width)
        from resample.engine.ellipsoids.footprints import project

        checked, look = _checked(samples)
        if checked.scale is not None:
            raise ValueError("there are no records of samples that have a scale each")
        with _kernels(None):
            scene = self._scene(checked, camera.view(), (height, width), look, None)
            records = np.zeros(checked.extinction.size, FOOTPRINT)
            project(records, checked, scene.view, scene.ellipsoid, scene.screen, scene.style)
            return records

    def _check_field(self, samples: Samples | Field | LatticeField) -> None:
        """Refuse a field that the order cannot classify, and samples that hold no field."""
        if isinstance(samples, LatticeField) != (self.order.summing is Summing.RAYS):
            raise ValueError(
                "a field on a lattice and the order rays belong together; got "
                f"{type(samples).__name__} and {self.order}"
            )
        is_field = isinstance(samples, Field | LatticeField)
        if is_field and self.order.summing not in OF_FIELDS:
            raise ValueError(
                f"{self.order} composites colors, so a field cannot be classified after its "
                "reconstruction; rays and image-sheets can"
            )
        if is_field and self.splat_color is not None:
            raise ValueError("splats of a field cannot be colored: their colors come after them")
        if not is_field and self.projection is not Projection.COMPOSITE:
            raise ValueError(
                f"the projection {self.projection} needs a field; samples that have their colors "
                "can be shown by composite"
            )

    def _gathered(
        self,
        field: LatticeField,
        view: View,
        size: tuple[int, int],
        clip: ArrayLike | None,
        progress: Progress | None,
    ) -> Frame:
        """Picture of a field that rays go through."""
        from resample.painting.rays import Gathering, paint_field

        field = kernel_field(field)
        style = self._style(field.lattice, field.classifier)
        rays, step = self.order if isinstance(self.order, Rays) else Rays(), self.order.thickness
        how = Gathering(style, self._tables, step, rays.quality, rays.interpolation, clip)
        return self._developed(*paint_field(field, view, size, how, progress))

    def _check_scaled(self) -> None:
        """Refuse choices that would paint samples of a scale each as if they had none."""
        if self.order.summing is not Summing.POINTS:
            raise ValueError(
                f"samples of a scale each need the order every-sample, not {self.order}"
            )
        if self.primitive not in SCALED or self.footprint not in (None, Footprint.EXACT):
            raise ValueError(
                f"samples of a scale each are {', '.join(SCALED)} of exact footprint, not "
                f"{self.primitive} of {self.footprint or OWN_FOOTPRINT.get(self.primitive)}"
            )

    def _streamed(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples that are composited one by one, or as points in layers."""
        from resample.painting.points import can_defer_points, paint_points
        from resample.painting.splats import (
            are_splats_exact,
            formula_of,
            paint_mixture,
            paint_splats,
        )

        painted, formula = None, formula_of(scene, self._profile, self._pieces)
        by = None if scene.plan is None else scene.plan.painter
        if are_splats_exact(scene) and by in (None, SPLATS):
            painted = paint_splats(scene, samples, formula, progress)
        can_defer = samples.scale is None and can_defer_points(scene) and by in (None, POINTS)
        if painted is None and self._point_profile is not None and can_defer:
            painted = paint_points(scene, samples, self._point_profile, progress)
        return painted or paint_mixture(scene, samples, formula, progress)

    def _developed(self, painted: PaintTarget, statistics: Statistics) -> Frame:
        film, value = painted.film, painted.value if self.projection in MEASURING else None
        if self.projection in SUMS:
            value = np.nan_to_num(painted.value, nan=0.0)
            film = film._replace(rgba=_as_gray(value))
        return Frame(*film, statistics, value)

    def _scene(
        self,
        samples: Samples,
        view: View,
        size: tuple[int, int],
        look: Classifier | None,
        clip: ArrayLike | None,
    ) -> PreparedScene:
        """What painters get to know besides the samples."""
        lattice = samples.lattice
        tables, style = self._tables, self._style(lattice, look)
        ellipsoid = ellipsoid_of(lattice, view, self.reconstruction.radius)
        screen = screen_of(size[1], size[0], tables.pixel_margin, view, ellipsoid)
        screen = screen._replace(planes=planes_of(clip, view, ellipsoid))
        summing = self.order.summing
        if self.projection in (Projection.AVERAGE, *SUMS):
            summing = Summing.SHEETS
        layers = layers_of(self.order, samples.position, view, lattice)
        return PreparedScene(view, ellipsoid, screen, style, tables, summing, layers, look)

    @property
    def _point_filter(self) -> PixelFilter:
        """Filter that points are added under."""
        # Sub-pixel points are seen under their own kernel's projection, close to a Gaussian of
        # that variance; the paper's are seen under the pixel's filter.
        return (self.pixel_filter or PAPER_FILTER) if self._is_paper else POINT_FILTER

    @cached_property
    def _profile(self) -> Profile | None:
        """Line integrals as a formula, where there is one."""
        return footprint_profile(self.reconstruction)

    @cached_property
    def _pieces(self) -> Pieces | None:
        """Line integrals as a formula of more kernels, where there is one."""
        return footprint_pieces(self.reconstruction)

    @cached_property
    def _point_profile(self) -> Profile | None:
        """Filter of points as a formula, where there is one."""
        return filter_profile(self._point_filter)

    @cached_property
    def _tables(self) -> Tables:
        """Everything that kernels look up."""
        pixel = filter_table(Box() if self._is_paper else self.pixel_filter or Box())
        return Tables(
            footprint_table(self.reconstruction).values,
            partial_table(self.reconstruction),
            filter_table(self._point_filter).values,
            *pixel,
            math.ceil(pixel.extent - 0.501),  # the table of a box ends a sliver beyond 0.5
        )

    def _style(self, lattice: Doubles, look: Classifier | None) -> Style:
        """Choices as numbers."""
        primitive = self.primitive
        own = {
            Primitive.HYBRID: 0.6,  # measured (docs/quality.md)
            Primitive.POINTS: np.inf,
            Primitive.SPLATS: 0.0,
            Primitive.PAPER: 1.0,  # "magnified" and "minified" taken literally
            Primitive.INFLATE: 0.0,
            Primitive.EWA: 0.0,
        }
        threshold = own[primitive] if self.threshold is None else self.threshold
        fixed = 0 if primitive in (Primitive.HYBRID, Primitive.POINTS) else 1
        tint = (-1.0, -1.0, -1.0) if self.splat_color is None else self.splat_color
        footprint = self.footprint or OWN_FOOTPRINT.get(primitive, Footprint.EXACT)
        per_variance = self.reconstruction.radius**2 / variance(self.reconstruction)
        voxel = abs(np.linalg.det(lattice)) ** (1 / 3)
        return Style(
            model=list(Footprint).index(footprint),
            threshold=float(threshold),
            subpixels=fixed if self.subpixels is None else int(self.subpixels),
            most_for_splats=1 if primitive is Primitive.POINTS else SPLAT_GRID,
            most_for_points=POINT_GRID,
            point_extent=filter_table(self._point_filter).extent,
            variance=variance(self.reconstruction),
            inflated=1.0 if primitive is Primitive.INFLATE else 0.0,
            blurred=EWA_VARIANCE * per_variance if primitive is Primitive.EWA else 0.0,
            faintest=0.0 if look is None else -np.inf,
            projection=number_of(self.projection),
            iso=0.0 if look is None or self.iso is None else float(_position(self.iso, look)),
            linear_opacity=self.opacity is Opacity.LINEAR,
            layer=float(voxel * self.order.thickness),
            opaque=OPAQUE,
            **dict(zip(("tint_red", "tint_green", "tint_blue"), map(float, tint), strict=True)),
        )


def _primitive_named(name: str) -> Primitive:
    try:
        return Primitive(name)
    except ValueError:
        raise ValueError(f"method {name!r}; known: {', '.join(Primitive)}") from None


def _check_together(choice: Resampler) -> None:
    """Refuse choices that do not go together, and say which do."""
    if choice.primitive is Primitive.PAPER:
        _check_paper(choice)
    known = FOOTPRINTS[choice.primitive]
    if choice.footprint is not None and choice.footprint not in known:
        raise ValueError(
            f"the primitive {choice.primitive} goes with the footprint {', '.join(known)}, not "
            f"{choice.footprint}"
        )
    if choice.projection is not Projection.COMPOSITE and choice.order.summing not in OF_FIELDS:
        raise ValueError(
            f"the projection {choice.projection} needs the order rays or image-sheets, not "
            f"{choice.order}"
        )
    if choice.projection is Projection.MINIMUM and choice.order.summing is not Summing.RAYS:
        raise ValueError(f"the projection minimum needs the order rays, not {choice.order}")
    if choice.order.summing is Summing.RAYS:
        _check_rays(choice)
    if (choice.iso is None) == (choice.projection is Projection.FIRST_HIT):
        raise ValueError(
            "first-hit needs an iso value, and no other projection has one "
            f"(got {choice.projection} and {choice.iso})"
        )
    if choice.iso is not None and not math.isfinite(choice.iso):
        raise ValueError(f"the iso value is {choice.iso}; it must be finite")


def _check_paper(choice: Resampler) -> None:
    """Refuse choices that the paper's method does not have."""
    if choice.order.summing is not Summing.POINTS:
        raise ValueError(
            f"the primitive paper composites every sample, so it has no order {choice.order}; take "
            "the order every-sample, or the primitive hybrid"
        )
    if choice.subpixels not in (None, 1):
        raise ValueError(
            f"the primitive paper has no sub-pixels, so not {choice.subpixels} of them; leave them "
            "out, or take the primitive hybrid"
        )


def _check_rays(choice: Resampler) -> None:
    """Refuse choices about how samples are painted, which rays do not paint."""
    default = {field.name: field.default for field in fields(Resampler)}
    default["reconstruction"] = GaussianKernel()
    for name in ("primitive", "footprint", "reconstruction", "threshold", "opacity"):
        chosen = getattr(choice, name)
        if chosen != default[name]:
            raise ValueError(
                f"rays paint no samples, so they have no {name} {chosen}; take the order "
                "image-sheets, or leave it out"
            )


def _position(iso: float, look: Classifier) -> float:
    """Where a value lies between a classifier's low and high, 0..1 if between them."""
    return (iso - look.low) / (look.high - look.low)


def _checked(samples: Samples | Field) -> tuple[Samples, Classifier | None]:
    """Samples for the painters, and what a field looks like."""
    if isinstance(samples, Field):
        return samples_of(samples), kernel_classifier(samples.classifier)
    return check_samples(samples), None


def _as_gray(value: Floats) -> Floats:
    """Sums (H, W) as opaque gray (H, W, 4), the largest of them white."""
    peak = float(value.max())
    gray = np.maximum(value / peak if peak > 0 else value, 0.0)
    return np.stack([gray, gray, gray, np.ones_like(gray)], axis=-1)


@contextmanager
def _kernels(threads: int | None) -> Iterator[None]:
    from resample.engine.jit import threads as limited

    with limited(threads):
        yield
