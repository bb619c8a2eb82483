"""Hybrid forward resampling: classify, order, paint (paper, section 2, on one page)."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from resample.cameras.models import AnyCamera
from resample.painting.choices import (
    MEASURING,
    SUMS,
    WHOLE,
    PaintChoices,
    Projection,
    check_in_windows,
    check_sort_of,
)
from resample.painting.preparing import (
    as_gray,
    checked,
    limited,
    no_samples,
    prepared,
    style_of,
    tables_of,
)
from resample.painting.scenes.plans import (
    ALL_PAINTERS,
    NOTHING,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    Window,
    check_call,
    check_size,
    checked_window,
)
from resample.painting.scenes.scene import (
    PaintTarget,
    PreparedScene,
    kernel_classifier,
    kernel_field,
    nothing_painted,
)
from resample.painting.shaped.ellipsoids import (
    Ellipsoids,
    ShapedStyle,
    frame_of,
    order_of_shapes,
    paint_ellipsoids,
)
from resample.profiles.orders import Rays, Summing
from resample.types import (
    FOOTPRINT,
    Classifier,
    Doubles,
    Field,
    Frame,
    LatticeField,
    Records,
    Samples,
    Statistics,
    Tables,
    View,
)
from resample.watching import Progress

if TYPE_CHECKING:
    from resample.painting.scenes.cuts import RunPainter


class Resampler(PaintChoices):  # a dataclass by inheritance: mypy would lose what names become
    """A renderer with all choices made; call it with samples and a camera.

    Parameters
    ----------
    primitive
        Points, splats, or each where it is better.
    footprint
        Model of the splats; None is exact, and corrected under `Primitive.PAPER`.
    pixel_filter
        Filter from sub-pixels to pixels, by name, such as `tent`, or as an object; under
        `Primitive.PAPER` the filter that points are summed under at the pixels, where a box would
        do poorly: None chooses for the primitive.
    reconstruction
        Kernel around every sample, by name or as an object.
    order
        Order of compositing, by name, such as `image-sheets:thickness=1`, or as an object.
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

    def __call__(
        self,
        samples: Samples | Field | LatticeField | list[LatticeField] | Ellipsoids,
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
            `LatticeField` needs `Rays`, as do several of them in a list, whose emission and
            absorption add up; and `Ellipsoids` take `EverySample` or `Rays`.
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
        check_call(camera, height, width, threads)
        if isinstance(samples, Ellipsoids):
            with limited(threads):
                return self._shaped(samples, camera, (height, width), clip, progress)
        check_sort_of(self, samples)
        if isinstance(samples, LatticeField | list):
            fields = samples if isinstance(samples, list) else [samples]
            with limited(threads):
                return self._gathered(fields, camera.view(), (height, width), clip, progress)
        known, look = checked(self, samples)
        if known.extinction.size == 0:
            nothing = nothing_painted(height, width, has_values=True)
            return self._developed(nothing, Statistics(0, 0, 0, 0, 1, {}))
        with limited(threads):
            scene = self._scene(known, camera.view(), (height, width), look, clip)
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
        """Rows of a picture of fields, with the bits that the whole picture has there.

        Parameters
        ----------
        fields, camera, height, width, threads, progress, clip
            As of a call.
        rows
            First row, and the one after the last, px.

        Raises
        ------
        ValueError
            As a call does; or the rows are no rows of the picture.
        """
        check_call(camera, height, width, threads)
        check_sort_of(self, fields)
        if not 0 <= rows[0] < rows[1] <= height:
            raise ValueError(f"rows {rows} are not within a picture of {height}")
        every = fields if isinstance(fields, list) else [fields]
        with limited(threads):
            return self._gathered(every, camera.view(), (height, width), clip, progress, rows)

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
        check_sort_of(self, samples)
        with limited(None):
            scene, known = self._in_windows(samples, camera, (height, width), clip)
            painted, _ = self._painter.paint(replace(scene, window=NOTHING), known, None)
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
        check_size(height, width)
        check_sort_of(self, samples)
        with limited(None):
            scene, known = self._in_windows(samples, camera, (height, width), clip)
            return self._painter.plans(scene, known, painters)

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
        with limited(None):
            scene = self._scene(no_samples(lattice), camera.view(), (height, width))
            return self._painter.plan_of_all(scene, parts)

    def margin_beyond_window(
        self, plan: PicturePlan, lattice: Doubles, camera: AnyCamera
    ) -> tuple[bool, float]:
        """How far samples are painted beyond what their ellipsoids cover of the screen.

        Returns
        -------
        Whether they reach as far on one side of their center as on the other; and px, at most.
        """
        scene = self._scene(no_samples(lattice), camera.view(), plan.size)
        return self._painter.margin(scene, plan)

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
        window = x0, y0, x1, y1 = checked_window(window, *plan.size)
        check_sort_of(self, samples)
        if isinstance(samples, Samples) and not len(samples.extinction):
            nothing = nothing_painted(y1 - y0, x1 - x0)
            return self._developed(nothing, Statistics(0, 0, 0, 0, 1, {}))
        with limited(threads):
            scene, known = self._in_windows(samples, camera, plan.size, clip)
            scene = replace(scene, layers=plan.layers, plan=plan, window=window)
            painted, statistics = self._painter.paint(scene, known, progress)
        counts = painted.statistics(statistics.samples, statistics.seconds)
        return self._developed(painted.cut(window), counts)

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
        with limited(None):
            scene, known = self._in_windows(samples, camera, plan.size, clip)
            scene = replace(scene, layers=plan.layers, plan=plan._replace(spacing=None))
            found = self._painter.spacings(scene, known)
        if plan.spacing is not None:
            found = np.minimum(found, plan.spacing)
        return plan._replace(spacing=found)

    def plan_of_parts(
        self, source: SamplesInParts, camera: AnyCamera, *, height: int, width: int
    ) -> PicturePlan | None:
        """Plan of a picture of samples that are not loaded for it; None: that needs them.

        It may stand for `plan` of them all: windows have the same bits.
        """
        check_size(height, width)
        if not len(source.sizes) or self.order(camera.view(), source.lattice).begins_at_first:
            return None
        with limited(None):
            scene = self._scene(no_samples(source.lattice), camera.view(), (height, width))
            return self._painter.plan_of_parts(scene, source)

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
        from resample.painting.stepping import paint_in_steps

        window = checked_window(window, *plan.size)
        check_in_windows(self, is_field=source.classifier is not None)
        if self._painter.needs_together is not None:
            raise ValueError(self._painter.needs_together)
        if not self.can_step(plan):
            raise ValueError(
                "the tiles of this picture are not all as fine, and the plan does not know how "
                "fine each is; give that of `with_spacing`"
            )
        with limited(threads):
            scene, by = self._in_steps(source, camera, plan, window, clip)
            painted = paint_in_steps(scene, by, source, progress)
        counts = painted.statistics(int(source.sizes.sum()), {})
        return self._developed(painted.cut(window), counts)

    def is_even(self, plan: PicturePlan) -> bool:
        """Whether all tiles of a picture are as fine."""
        from resample.engine.subpixels import grid_of

        if self.projection is Projection.FIRST_HIT:
            return True
        style = style_of(self, np.eye(3), None)
        return bool(grid_of(plan.least, style) == grid_of(plan.most, style))

    def can_step(self, plan: PicturePlan) -> bool:
        """Whether a picture of this plan can be painted nearest parts first."""
        is_whole = self.projection in WHOLE or self.order.summing is Summing.RAYS
        if is_whole or self._painter.needs_together is not None:
            return False
        return plan.spacing is not None or self.is_even(plan)

    def kept_between_steps(
        self, source: SamplesInParts, camera: AnyCamera, plan: PicturePlan, window: Window
    ) -> tuple[int, int]:
        """What `paint_nearest_first` keeps of a window besides its picture.

        Returns
        -------
        Bytes, and samples that wait for nearer ones, at most.
        """
        from resample.painting.scenes.cuts import most_waiting
        from resample.painting.stepping import state_bytes

        scene, by = self._in_steps(source, camera, plan, window, None)
        return state_bytes(scene, by), most_waiting(scene, source, by.between)

    def _in_steps(
        self,
        source: SamplesInParts,
        camera: AnyCamera,
        plan: PicturePlan,
        window: Window,
        clip: ArrayLike | None,
    ) -> "tuple[PreparedScene, RunPainter]":
        """Scene of a picture that was planned, and how its samples are painted step by step."""
        look = None if source.classifier is None else kernel_classifier(source.classifier)
        scene = self._scene(no_samples(source.lattice), camera.view(), plan.size, look, clip)
        return self._painter.by_runs(replace(scene, layers=plan.layers, plan=plan, window=window))

    def footprints(
        self, samples: Samples | Field, camera: AnyCamera, *, height: int, width: int
    ) -> Records:
        """Records (N,) of `resample.types.FOOTPRINT`: each sample as the camera sees it.

        Same parameters and errors as a call; left > right marks samples that cannot be seen.
        """
        check_size(height, width)
        from resample.engine.ellipsoids.footprints import project

        if isinstance(samples, Samples) and samples.scale is not None:
            raise ValueError("there are no records of samples that have a scale each")
        known, look = checked(self, samples)
        with limited(None):
            scene = self._scene(known, camera.view(), (height, width), look, None)
            records = np.zeros(known.extinction.size, FOOTPRINT)
            project(records, known, scene.view, scene.ellipsoid, scene.screen, scene.style)
            return records

    def _gathered(
        self,
        fields: list[LatticeField],
        view: View,
        size: tuple[int, int],
        clip: ArrayLike | None,
        progress: Progress | None,
        rows: tuple[int, int] | None = None,
    ) -> Frame:
        """Picture of fields that rays go through, or rows of it."""
        from resample.painting.rays import RayPainter

        fields = [kernel_field(field) for field in fields]
        style = style_of(self, fields[0].lattice, fields[0].classifier)
        rays, step = self.order if isinstance(self.order, Rays) else Rays(), self.order.thickness
        painter = RayPainter(style, self._tables, step, rays.quality, rays.interpolation, clip)
        painted, counts = painter.paint(fields, view, size, progress, rows or (0, size[0]))
        if rows is not None:
            painted = painted.cut((0, rows[0], size[1], rows[1]))
        return self._developed(painted, counts)

    def _shaped(
        self,
        shapes: Ellipsoids,
        camera: AnyCamera,
        size: tuple[int, int],
        clip: ArrayLike | None,
        progress: Progress | None,
    ) -> Frame:
        """Picture of ellipsoids that have a shape each."""
        style = ShapedStyle(order_of_shapes(self, clip), self.subpixels)
        return frame_of(paint_ellipsoids(shapes, camera, size, style, progress=progress))

    def _developed(self, painted: PaintTarget, statistics: Statistics) -> Frame:
        film, value = painted.film, painted.value if self.projection in MEASURING else None
        if self.projection in SUMS:
            value = np.nan_to_num(painted.value, nan=0.0)
            film = film._replace(rgba=as_gray(value))
        return Frame(*film, statistics, value)

    @cached_property
    def _tables(self) -> Tables:
        """Everything that kernels look up."""
        return tables_of(self)

    def _scene(
        self,
        samples: Samples,
        view: View,
        size: tuple[int, int],
        look: Classifier | None = None,
        clip: ArrayLike | None = None,
    ) -> PreparedScene:
        """What painters get to know besides the samples."""
        return prepared(self, self._tables, samples, view, size, look, clip)

    def _in_windows(
        self,
        samples: Samples | Field | LatticeField,
        camera: AnyCamera,
        size: tuple[int, int],
        clip: ArrayLike | None,
    ) -> tuple[PreparedScene, Samples]:
        """Scene that can be painted window by window, and samples as painters take them."""
        check_in_windows(self, is_field=isinstance(samples, Field | LatticeField))
        assert not isinstance(samples, LatticeField)
        known, look = checked(self, samples)
        if known.extinction.size == 0:
            raise ValueError("there are no samples, so there is nothing to plan; leave plans out")
        return self._scene(known, camera.view(), size, look, clip), known
