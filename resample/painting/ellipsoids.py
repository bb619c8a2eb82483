"""Paint ellipsoids that have a shape each: 3D Gaussians, anisotropic particles."""

import math
from collections.abc import Iterable, Iterator, Sequence
from contextlib import nullcontext
from enum import StrEnum
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.memory.mapped import contiguous
from resample.messages import Window, check_size
from resample.painting.scenes import Clock, check_places
from resample.profiles.reconstruction import (
    Reconstruction,
    footprint_pieces,
    footprint_profile,
    footprint_table,
    partial_table,
    variance,
)
from resample.progress import Progress, told
from resample.types import (
    Doubles,
    Floats,
    Frame,
    Pieces,
    Profile,
    Statistics,
    Tabulated,
    View,
)

if TYPE_CHECKING:
    from resample.engine.shaped.canvas import PaintedShapes
    from resample.engine.shaped.lists import TileGrid, TileLists
    from resample.engine.shaped.painting import Opacity
    from resample.engine.shaped.records import ShapedOptions

FAINTEST = 1.0 / 255.0  # opacity below which Gaussians end, as in training
MOST_OPAQUE = 0.99  # likewise
FINEST, MOST = 8, 32  # sub-pixels per side of a pixel, at most; and where they are chosen
WANTED = 0.6  # sub-pixels that a thin ellipsoid's standard deviation is long, at least
WANTED_ALONG_RAYS = 1.2  # likewise where each ray has its order, so that its edges are as good
THIN = 0.25  # share of ellipsoids that may be thinner than that
BAND = 1 << 14  # records that are made or looked at together
BINS = 160  # of thicknesses, eight per octave; the middle one is at 1 px


class ShapedOrder(StrEnum):
    """Order in which ellipsoids are composited."""

    DEPTH = "depth"  # of centers along the view axis; pops when the camera turns
    DISTANCE = "distance"  # of centers from the eye; pops when the camera moves
    RAYS = "rays"  # along each ray, of the places nearest to the centers


class Ellipsoids(NamedTuple):
    """N ellipsoids with a shape each.

    Examples
    --------
    >>> import numpy as np
    >>> from resample import Camera, Resampler
    >>> from resample.painting.ellipsoids import Ellipsoids
    >>> flat = Ellipsoids(
    ...     position=[[0, 0, 5]], scale=[[1, 0.2, 1]], rotation=[[1, 0, 0, 0]], opacity=[0.9],
    ...     color=[[1, 0, 0]],
    ... )
    >>> frame = Resampler()(flat, Camera.from_fov(60, 24, 32), height=24, width=32)
    >>> frame.rgba.shape
    (24, 32, 4)
    """

    position: Floats  # (N, 3) scene units
    scale: Floats  # (N, 3) scene units: standard deviations, or half axes where a kernel ends
    rotation: Floats  # (N, 4) quaternions w, x, y, z, from own axes to the scene's
    opacity: Floats  # (N,) of Gaussians at the center; of kernels see `particles`
    color: Floats  # (N, 3) straight
    kernel: Reconstruction | None = None  # None: opacity × exp(−i² / 2), at most 0.99
    # (N,) optical depth per scene unit of a ray through the center, in place of the opacity
    extinction: Floats | None = None


class ShapedStyle(NamedTuple):
    """How ellipsoids are drawn."""

    order: ShapedOrder | str = ShapedOrder.DEPTH
    subpixels: int | None = None  # per side of a pixel; None: as thin ellipsoids need
    near: float = 0.0  # scene units; the camera's near plane if that is farther
    dilation: float = 0.0  # px² of pictures of training, which widened Gaussians by it
    trained: float | None = None  # px, focal length of these pictures; None: the camera's
    least_trained: float = 0.0  # px, that it has at least where it is the camera's, if rays allow
    is_compensated: bool = False  # training made up for the dilation by the opacity
    is_affine: bool = False  # Gaussians are projected linearly (EWA)
    is_linear: bool = False  # kernels are as opaque as they are deep: α F of classic splatting
    # (K,) light of kernels that are smaller than a chosen sub-pixel, see `resample.engine.shaped.
    # records.DEPTHS`: each sub-pixel takes its share. None: what the ray of a sub-pixel meets.
    taken: Floats | None = None
    # (M, 4) unit normals and offsets in camera axes: planes that cut kernels, as the near plane
    # does then; None: the near plane leaves out what rays pass nearest to before it.
    planes: Doubles | None = None


class EllipsoidSource(Protocol):
    """Ellipsoids in parts, which may be in files."""

    def sizes(self) -> Sequence[int]:
        """Ellipsoids of each part."""

    def kernel(self) -> Reconstruction | None:
        """As for all of them."""

    def load(self, part: int, view: View, /) -> Ellipsoids:
        """One part, in colors for a view."""


class InMemory(NamedTuple):
    """Ellipsoids in memory, as parts."""

    all: Ellipsoids

    def sizes(self) -> Sequence[int]:
        """Ellipsoids of each part."""
        count = len(self.all.opacity)
        return [count] if count else []

    def kernel(self) -> Reconstruction | None:
        """As for all of them."""
        return self.all.kernel

    def load(self, part: int, view: View, /) -> Ellipsoids:  # noqa: ARG002
        """All parts."""
        return self.all


class ShapedPicture(NamedTuple):
    """A picture of ellipsoids."""

    rgba: Floats  # (H, W, 4) premultiplied, in the space of the colors
    depth: Floats  # (H, W) mean z-depth, weighted by visibility, scene units; inf where empty
    median: Floats  # (H, W) z-depth where half of the light is stopped; inf where less is
    first_depth: Floats  # (H, W) of the nearest that is seen; inf where empty
    coverage: Floats  # (H, W) share of the pixel that is covered, however faintly
    statistics: Statistics


def check_ellipsoids(given: Ellipsoids) -> Ellipsoids:
    """Convert ellipsoids to contiguous float32 arrays, and check that they fit together.

    Raises
    ------
    ValueError
        Shapes do not fit, or numbers are not finite or out of range.
    """
    arrays = [contiguous(array, np.float32) for array in given[:5]]
    count = arrays[3].size
    shapes = (count, 3), (count, 3), (count, 4), (count,), (count, 3)
    names = Ellipsoids._fields
    for name, array, shape in zip(names, arrays, shapes, strict=False):
        if array.shape != shape:
            raise ValueError(f"{name} of {array.shape}; for {count} ellipsoids it is {shape}")
    position, scale, rotation, opacity, color = arrays
    check_places(position, "an ellipsoid's position")
    for name, array in zip(names[1:], arrays[1:], strict=False):
        if not np.isfinite(array).all():
            raise ValueError(f"an ellipsoid's {name} is not finite; leave such ellipsoids out")
    if count and not (scale.min() >= 0 and (scale.max(axis=1) > 0).all()):
        raise ValueError("an ellipsoid's scales are 0 or more, and one is above 0")
    if count and not np.abs(rotation).max(axis=1).min() > 0:
        raise ValueError("a quaternion is zero; give w, x, y, z, such as 1, 0, 0, 0")
    most = 1.0 if given.kernel is None else math.nextafter(1.0, 0.0)
    if count and not (opacity.min() >= 0 and opacity.max() <= most):
        raise ValueError(
            f"an opacity is {opacity.min():g} to {opacity.max():g}; it lies from 0 to"
            f" {'1' if given.kernel is None else 'below 1'}"
        )
    return Ellipsoids(position, scale, rotation, opacity, color, given.kernel)


def paint_ellipsoids(
    shapes: Ellipsoids,
    camera: AnyCamera,
    size: tuple[int, int],
    style: ShapedStyle | None = None,
    *,
    progress: Progress | None = None,
) -> ShapedPicture:
    """Paint ellipsoids, nearest first, each by the exact response of every ray.

    Parameters
    ----------
    shapes
        Ellipsoids; the result does not depend on their order.
    camera
        Without distortion.
    size
        Height and width, px.
    style
        How they are drawn.
    progress
        Called with the share of the work that is done.

    Raises
    ------
    ValueError
        Arrays do not fit together, or a number is out of range.
    """
    source = InMemory(check_ellipsoids(shapes))
    return paint_ellipsoid_parts(source, camera, size, style, progress=progress)


def paint_ellipsoid_parts(
    source: EllipsoidSource,
    camera: AnyCamera,
    size: tuple[int, int],
    style: ShapedStyle | None = None,
    *,
    progress: Progress | None = None,
) -> ShapedPicture:
    """As `paint_ellipsoids`, of checked ellipsoids that are projected part by part."""
    check_size(*size)
    clock = Clock()
    scene = ShapedScene.of(source, camera, size, style)
    held = scene.records()
    scene = scene.measured([held.records])
    clock.lap("project")
    canvas = empty_canvas(size)
    painted = scene.paint(held, (0, 0, size[1], size[0]), canvas, progress)
    clock.lap("paint")
    count = sum(source.sizes())
    counts = Statistics(count, 0, painted, 0, scene.finest(), clock.seconds)
    return ShapedPicture(*canvas, counts)


def frame_of(picture: ShapedPicture) -> Frame[Statistics]:
    """Return a picture of ellipsoids in linear light as a frame."""
    rgba, depth, _, first, coverage, counts = picture
    return Frame(rgba, depth, first, coverage, counts)


def empty_canvas(size: tuple[int, int]) -> "PaintedShapes":
    """Return a transparent picture (height, width)."""
    from resample.engine.shaped.canvas import PaintedShapes

    depth, median, first = (np.full(size, np.inf, np.float32) for _ in range(3))
    rgba, coverage = np.zeros((*size, 4), np.float32), np.zeros(size, np.float32)
    return PaintedShapes(rgba, depth, median, first, coverage)


class ShapedScene(NamedTuple):
    """Ellipsoids in parts, seen by a camera."""

    source: EllipsoidSource
    view: View
    size: tuple[int, int]  # height and width of the picture, px
    style: ShapedStyle
    thickness: NDArray[np.int64] | None = None  # (BINS,) how many are as thick
    nearest: float = 0.0  # scene units; centers nearer to the eye are left out

    @classmethod
    def of(
        cls,
        source: EllipsoidSource,
        camera: AnyCamera,
        size: tuple[int, int],
        style: ShapedStyle | None,
    ) -> "ShapedScene":
        """Scene of a source that a camera without distortion sees."""
        chosen, view = style or ShapedStyle(), camera.view()
        chosen = chosen._replace(order=ShapedOrder(chosen.order))
        view = view._replace(near=max(view.near, chosen.near))
        return ShapedScene(source, view, size, chosen)

    def measured(self, projected: Iterable[Floats]) -> "ShapedScene":
        """Return the scene with its ellipsoids' thickness, measured from all parts' records."""
        if self.style.subpixels is not None:
            return self
        from resample.engine.shaped.records import N_XX, N_XY, N_YY

        thickness = np.zeros(BINS, np.int64)
        for records in projected:
            # Count visible ellipsoids that are as thin, along their shorter axis on the screen.
            for first in range(0, len(records), BAND):
                some = records[first : first + BAND]
                xx, half, yy = some[:, N_XX], 0.5 * some[:, N_XY], some[:, N_YY]
                longest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), half)
                with np.errstate(divide="ignore", invalid="ignore"):
                    octave = -0.5 * np.log2(longest)
                bins = np.clip(np.nan_to_num(8 * octave) + BINS // 2, 0, BINS - 1)
                thickness += np.bincount(bins.astype(np.int64), minlength=BINS)
        return self._replace(thickness=thickness)

    def finest(self) -> int:
        """Sub-pixels per side of a pixel."""
        if self.style.subpixels is not None:
            return min(self.style.subpixels, MOST)
        if self.thickness is None or not self.thickness.any():
            return 1
        share = np.cumsum(self.thickness) / self.thickness.sum()
        thin = 2.0 ** ((int(np.searchsorted(share, THIN)) - BINS // 2) / 8)  # px
        wanted = WANTED_ALONG_RAYS if self.style.order is ShapedOrder.RAYS else WANTED
        return int(min(max(round(wanted / thin), 1), FINEST))

    def tile(self) -> int:
        """Side of a tile, px."""
        from resample.engine.shaped.canvas import SIDE

        return SIDE // self.finest()

    def projected(self) -> Iterator[Floats]:
        """Whole records of visible ellipsoids, in batches."""
        from resample.engine.shaped.records import WHOLE, ShapedArrays, project_shapes

        for part in range(len(self.source.sizes())):
            shapes = self.source.load(part, self.view)
            for first in range(0, len(shapes.opacity), BAND):
                rows = slice(first, first + BAND)
                turn = shapes.rotation if len(shapes.rotation) == 1 else shapes.rotation[rows]
                given = (shapes.position, shapes.scale, turn, shapes.opacity, shapes.color)
                position, scale, rotation, weight, color = (
                    np.ascontiguousarray(array if array is turn else array[rows], np.float32)
                    for array in given
                )
                if shapes.extinction is not None:
                    weight = np.ascontiguousarray(shapes.extinction[rows], np.float32)
                elif shapes.kernel is not None:  # extinctions, of unit spheres
                    mean = np.prod(scale.astype(np.float64), axis=1) ** (1.0 / 3.0)
                    weight = (-np.log1p(-weight.astype(np.float64)) / mean).astype(np.float32)
                records = np.empty((len(weight), WHOLE), np.float32)
                arrays = ShapedArrays(position, scale, rotation, weight, color)
                project_shapes(arrays, self.view, self._options(shapes.kernel), records)
                yield in_window(records, (0, 0, self.size[1], self.size[0]))

    def records(self, window: Window | None = None, most: int | None = None) -> "HeldRecords":
        """Records of all visible ellipsoids of a picture or window; `most`: if known."""
        held = HeldRecords(sum(self.source.sizes()) if most is None else most)
        for records in self.projected():
            held.add(records if window is None else in_window(records, window))
        return held

    def paint(
        self,
        held: "HeldRecords",
        window: Window,
        canvas: "PaintedShapes",
        progress: Progress | None = None,
    ) -> int:
        """Paint a window of whole tiles; return how many ellipsoids it shows."""
        from resample.engine.shaped.along_rays import paint_along_rays
        from resample.engine.shaped.canvas import PaintedShapes
        from resample.engine.shaped.lists import TileGrid
        from resample.engine.shaped.painting import paint_shapes

        (x0, y0, x1, y1), side, fine = window, self.tile(), self.finest()
        grid = TileGrid(x0, y0, side, -(-(x1 - x0) // side), -(-(y1 - y0) // side), fine)
        records, count = held.records, held.count
        if not count:
            return 0
        lists = listed(records, held.front_to_back(), grid)
        part = [array[y0:y1, x0:x1] for array in canvas]
        whole = PaintedShapes(*map(np.ascontiguousarray, part))
        paint_all = paint_along_rays if self.style.order is ShapedOrder.RAYS else paint_shapes
        with nullcontext() if progress is None else told(progress):
            paint_all(records, lists, grid, self.view.near, self.opacity(), whole)
        for mine, painted in zip(part, whole, strict=True):
            if mine is not painted:
                mine[...] = painted
        return count

    def _options(self, kernel: Reconstruction | None) -> "ShapedOptions":
        from resample.engine.shaped.records import ShapedOptions

        style = self.style
        small: tuple[float, float, Floats] | tuple[()] = ()
        if kernel is not None and style.taken is not None:
            small = 1.0 / self.finest(), variance(kernel) / kernel.radius**2, style.taken
        own = float(np.sqrt(abs(self.view.focal[0] * self.view.focal[1])))
        finest = style.subpixels or FINEST  # thinner ellipsoids would fall between the rays
        return ShapedOptions(
            self.size[1],
            self.size[0],
            kernel is None,
            style.is_affine,
            style.order is ShapedOrder.DISTANCE,
            float(style.dilation),
            float(style.trained or max(own, min(style.least_trained, finest * own))),
            style.is_compensated,
            FAINTEST,
            self.nearest,
            style.planes is not None,
            *small,
        )

    def opacity(self) -> "Opacity":
        """Conversion of distances to opacities."""
        from resample.engine.shaped.painting import CutOpacity, DepthOpacity, PeakOpacity

        kernel = self.source.kernel()
        if kernel is None:
            return PeakOpacity(np.float32(MOST_OPAQUE))
        along = self.view.focal if self.view.perspective else np.full(2, np.inf)
        per = np.float32(1.0 / along[0]), np.float32(1.0 / along[1])
        place = np.float32(self.view.principal[0]), np.float32(self.view.principal[1])
        if self.style.planes is not None:
            table = partial_table(kernel)
            # Planes (M, 6) as rays through pixels meet them, see `CutOpacity`.
            planes = self.style.planes
            constant, across = planes[:, 2:4].astype(np.float64), np.zeros((len(planes), 4))
            # Slopes belong to the rate where rays leave the eye, else to the offset.
            first = 0 if self.view.perspective else 1
            constant[:, first] -= planes[:, :2] @ (self.view.principal * (1.0 / self.view.focal))
            across[:, 2 * first : 2 * first + 2] = planes[:, :2] * (1.0 / self.view.focal)
            columns = constant[:, 0], across[:, 0], across[:, 1], constant[:, 1], *across[:, 2:].T
            met = np.ascontiguousarray(np.column_stack(columns), np.float32)
            return CutOpacity(table / table[0, -1], met, per, place, self.style.is_linear)
        # Line integrals of the kernel, relative to that through its center.
        table = footprint_table(kernel).values
        whole, profile = np.float32(table[0]), footprint_profile(kernel)
        integral: Profile | Pieces | Tabulated = Tabulated(table / whole)
        if profile is not None:
            integral = Profile(*(np.float32(term / whole) for term in profile))
        elif (pieces := footprint_pieces(kernel)) is not None:
            near, far = (tuple(np.float32(term / whole) for term in piece) for piece in pieces)
            integral = Pieces(near, far)  # type: ignore[arg-type]  # ten terms each
        return DepthOpacity(integral, per, place, self.style.is_linear)


class HeldRecords:
    """Records that are painted together, and their order, in arrays that are allocated once.

    Parameters
    ----------
    most
        How many there are, at most.
    """

    def __init__(self, most: int) -> None:
        from resample.engine.shaped.records import WIDTH

        self.count = 0
        self._records, self._pair = np.empty((most, WIDTH), np.float32), np.empty(most, np.uint64)

    @property
    def records(self) -> Floats:
        """Added records."""
        return self._records[: self.count]

    def add(self, whole: Floats) -> None:
        """Add whole records, as `project_shapes` makes them."""
        from resample.engine.shaped.records import KEY, WIDTH

        rows, top = slice(self.count, self.count + len(whole)), np.uint32(1 << 31)
        self._records[rows] = whole[:, :WIDTH]
        bits = whole[:, KEY].copy().view(np.uint32)
        pair = self._pair[rows]
        pair[:] = np.where(bits & top, ~bits, bits | top)  # in the order of the numbers
        pair <<= np.uint64(32)
        pair |= np.arange(rows.start, rows.stop, dtype=np.uint64)
        self.count = rows.stop

    def front_to_back(self) -> NDArray[np.uint32]:
        """Return the numbers of the records, nearest first; call it once.

        Equal keys are ordered by the records' contents, whatever order they came in.
        """
        from resample.engine.shaped.lists import settle_records

        pair, self._pair = self._pair, np.zeros(0, np.uint64)
        pair[: self.count].sort()
        settle_records(pair[: self.count], self.records)
        # Numbers are the lower bits; they take the first half of the same memory.
        number = pair.view(np.uint32)
        for first in range(0, self.count, BAND):
            rows = slice(first, min(first + BAND, self.count))
            number[rows] = pair[rows].astype(np.uint32)
        del number
        pair.resize(-(-self.count // 2), refcheck=False)
        return pair.view(np.uint32)[: self.count]


def listed(records: Floats, order: NDArray[np.uint32], grid: "TileGrid") -> "TileLists":
    """Deal records to tiles."""
    from resample.engine.shaped.lists import CHUNKS, TileLists, deal_records

    count, none = np.zeros((CHUNKS, grid.columns * grid.rows), np.int64), np.zeros(0, np.int32)
    deal_records(records, order, grid, count, none)
    start = np.concatenate([[0], np.cumsum(count.sum(axis=0))])
    position = start[:-1] + np.cumsum(count, axis=0) - count
    member = np.empty(start[-1], np.int32)
    if member.size:
        deal_records(records, order, grid, position, member)
    return TileLists(start, member)


def in_window(records: Floats, window: Window) -> Floats:
    """Records that meet a window."""
    from resample.engine.shaped.records import BOTTOM, LEFT, RIGHT, TOP

    x0, y0, x1, y1 = window
    left, right = records[:, LEFT], records[:, RIGHT]
    meets = (left <= right) & (right > x0) & (left < x1)
    meets &= (records[:, BOTTOM] > y0) & (records[:, TOP] < y1)
    return records if meets.all() else records[meets]
