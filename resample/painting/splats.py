"""Splats of samples that share a lattice: ellipsoids of one shape, painted by exact responses.

See `resample.engine.shaped`. Voxels smaller than a sub-pixel are widened to about one, and keep
their mass.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.painting.ellipsoids import (
    Ellipsoids,
    ShapedOrder,
    ShapedScene,
    ShapedStyle,
    empty_canvas,
    listed,
)
from resample.painting.scenes import Clock, PaintTarget, PreparedScene, along, spacing_of
from resample.profiles.filters import PixelFilter
from resample.profiles.reconstruction import Reconstruction, footprint_table, variance
from resample.profiles.subpixels import painted_on_subpixels, subpixels_of
from resample.progress import Progress
from resample.registry import once
from resample.types import Doubles, Film, Floats, Samples, Statistics, View

if TYPE_CHECKING:
    from resample.engine.shaped.canvas import PaintedShapes
    from resample.engine.shaped.lists import TileGrid

FINEST = 16  # sub-pixels per side of a pixel, at most
CLOSEST, CLOSEST_IN_LATTICES = 0.1, 0.001  # share of neighbours that may be closer than a sub-pixel
MOST_TILES = 1 << 12  # that are held at a time, of 28 KiB each
FEWEST, BATCHES = 1 << 14, 16  # samples that are painted at once; else parts of them by depth
PART = 1 << 16  # samples that are turned into ellipsoids at a time


@dataclass(frozen=True)
class SplatPainter:
    """Composites splats one by one, in the order of their centers.

    Planes cut them; those that are widened are shown if their centers are.
    """

    reconstruction: Reconstruction
    pixel_filter: PixelFilter | None  # None: means over pixels
    subpixels: int  # per side of a pixel; 0: as many as samples need
    key: str  # "depth" or "distance", see `EverySample`
    inflated: float  # px; splats of closer neighbours are as wide as for this spacing
    blurred: float  # px², added to the variance of splats
    is_spread: bool = True  # splats smaller than a sub-pixel keep their light
    is_linear: bool = False  # opacities are α F of classic splatting

    def paint(
        self, scene: PreparedScene, samples: Samples, progress: Progress | None
    ) -> tuple[PaintTarget, Statistics]:
        """Picture of samples, as means over pixels or under a filter."""
        clock, view, size = Clock(), scene.view, (scene.screen.height, scene.screen.width)
        count = samples.extinction.size
        is_own = self.inflated == self.blurred == 0
        samples, planes = scene.left_by_planes(samples, by_center=not is_own)
        samples = samples._replace(color=scene.tinted(samples.color))
        if self.is_linear:
            layer = scene.style.layer
            samples = samples._replace(extinction=-np.expm1(-layer * samples.extinction) / layer)
        fine = self.subpixels
        if not fine:  # as many as keep most neighbours a sub-pixel apart
            apart = spacing_of(view, samples)
            apart = apart[apart < np.inf]
            share = CLOSEST_IN_LATTICES if samples.scale is None else CLOSEST
            least = float(np.quantile(apart, share)) if apart.size else 1.0
            fine = min(FINEST, max(1, math.ceil(1.0 / max(least, 1e-6) - 0.01)))
        if self.pixel_filter is None:
            film, found = self._painted(samples, planes, view, size, fine, progress)
        else:
            least = 1 if self.subpixels else subpixels_of(self.pixel_filter).count
            parts, found = subpixels_of(self.pixel_filter, max(fine, least)), np.zeros(3, np.int64)

            def part(view: View, size: tuple[int, int]) -> Film:
                film, counts = self._painted(samples, planes, view, size, 1, None)
                np.maximum(found, counts, out=found)
                return film

            film = painted_on_subpixels(part, view, size, parts, progress)
        clock.lap("paint")
        painted, hidden, points = found.tolist()  # splats smaller than a sub-pixel are points
        tally = np.array([[points, painted - points, hidden, fine]])
        splats = painted - points + hidden
        statistics = Statistics(count, points, splats, hidden, fine, clock.seconds)
        return PaintTarget(film, np.zeros((0, 0), np.float32), tally), statistics

    def _painted(
        self,
        samples: Samples,
        planes: Doubles,
        view: View,
        size: tuple[int, int],
        fine: int,
        progress: Progress | None,
    ) -> tuple[Film, NDArray[np.int64]]:
        """Picture of a size, with so many sub-pixels, and numbers of `_paint_rows`."""
        order = ShapedOrder(self.key if view.perspective else "depth")
        source = SampleSource(samples, self.reconstruction, self.inflated, self.blurred)
        taken = light_taken(self.reconstruction, self.is_linear) if self.is_spread else None
        cutting = planes if len(planes) else None
        style = ShapedStyle(order, fine, is_linear=self.is_linear, taken=taken, planes=cutting)
        scene = ShapedScene(source, view, size, style)
        canvas, counts, side = empty_canvas(size), np.zeros(3, np.int64), scene.tile()
        # Canvases of so many rows of tiles are held at a time.
        rows = max(1, MOST_TILES // -(-size[1] // side)) * side
        for top in range(0, size[0], rows):
            bottom = min(top + rows, size[0])
            for painted, share in _paint_rows(scene, source, top, bottom, canvas):
                counts += painted
                if progress is not None:
                    progress((top + share * (bottom - top)) / size[0])
        return Film(canvas.rgba, canvas.depth, canvas.first_depth, canvas.coverage), counts


def _paint_rows(
    scene: ShapedScene, source: "SampleSource", top: int, bottom: int, canvas: "PaintedShapes"
) -> Iterator[tuple[NDArray[np.int64], float]]:
    """Paint rows of a picture in ranges of depth; samples behind opaque pixels are culled.

    Yield how many samples were painted, how many others are hidden, and how many of the painted
    are smaller than a sub-pixel, and the share of all work.
    """
    from resample.engine.shaped.canvas import SIDE, SIZE, PaintedShapes
    from resample.engine.shaped.lists import TileGrid
    from resample.engine.shaped.painting import clear_tiles, paint_behind, write_tiles
    from resample.engine.shaped.records import LIMIT, SMALL

    side, fine, width, view = scene.tile(), scene.finest(), scene.size[1], scene.view
    grid = TileGrid(0, top, side, -(-width // side), -(-(bottom - top) // side), fine)
    tiles, done, count = grid.columns * grid.rows, 0, source.samples.extinction.size
    held, is_open = np.empty((tiles, SIZE), np.float32), np.empty((tiles, SIDE), np.uint32)
    clear_tiles(held, is_open)
    for batch in _batches(scene, source.samples):
        part = source.samples if batch is None else _chosen(source.samples, batch)
        counts = np.zeros(3, np.int64)
        if done:
            shown = _may_be_seen(source._replace(samples=part), view, grid, is_open)
            counts[1] += shown.size - np.count_nonzero(shown)
            part = _chosen(part, np.flatnonzero(shown))
        records = scene._replace(source=source._replace(samples=part)).records(
            (0, top, width, bottom)
        )
        if records.count:
            lists = listed(records.records, records.front_to_back(), grid)
            paint_behind(records.records, lists, grid, view.near, scene.opacity(), held, is_open)
            counts[0] += records.count
            counts[2] += np.count_nonzero(records.records[: records.count, LIMIT] == SMALL)
        done += count if batch is None else batch.size
        yield counts, done / (count + 1)
    picture = PaintedShapes(*(array[top:bottom] for array in canvas))
    write_tiles(held, grid, picture)
    yield np.zeros(3, np.int64), 1.0


def _batches(scene: ShapedScene, samples: Samples) -> Iterator[NDArray[np.int64] | None]:
    """Yield the numbers of samples, nearer ones first; None: all of them."""
    count = samples.extinction.size
    if count < FEWEST:
        yield None
        return
    view, turn = scene.view, scene.view.rotation
    key = along(samples.position, turn[2], float(view.translation[2]))
    if scene.style.order is ShapedOrder.DISTANCE:
        x, y = (along(samples.position, turn[n], float(view.translation[n])) for n in (0, 1))
        key = np.sqrt(x * x + y * y + key * key)
    # The same samples come together whatever their order is: equal keys are never parted.
    ends = np.partition(key, [count * n // BATCHES for n in range(1, BATCHES)])
    ends = ends[[count * n // BATCHES for n in range(1, BATCHES)]]
    batch = np.searchsorted(ends, key, side="right").astype(np.uint8)  # sorted by counting
    order = np.argsort(batch, kind="stable")
    first = np.searchsorted(batch[order], np.arange(BATCHES + 1))
    for n in range(BATCHES):
        yield order[first[n] : first[n + 1]]


def _chosen(samples: Samples, index: NDArray[np.int64]) -> Samples:
    """The samples with these numbers."""
    position, color, extinction = (array.take(index, axis=0) for array in samples[:3])
    scale = None if samples.scale is None else samples.scale.take(index)
    return Samples(position, color, extinction, samples.lattice, scale)


def _may_be_seen(
    source: "SampleSource", view: View, grid: "TileGrid", is_open: NDArray[np.uint32]
) -> NDArray[np.bool_]:
    """Return whether samples (N,) may meet sub-pixels that are not opaque, or lie beside them.

    Rows of 8 sub-pixels are looked at.
    """
    from resample.engine.shaped.canvas import GROUPS, LANES, SIDE

    samples = source.samples
    x, y, z = (
        along(samples.position, view.rotation[n], float(view.translation[n])) for n in range(3)
    )
    radius = source.reconstruction.radius
    size = radius * float(np.linalg.norm(samples.lattice, 2))
    size *= 1.0 if samples.scale is None else float(samples.scale.max(initial=0.0))
    ahead = np.ones(len(z), np.bool_)
    if view.perspective:
        ahead = z - np.float32(size) > max(view.near, 1e-9)
    if not ahead.any():
        return ~ahead
    near = float(z[ahead].min()) - size if view.perspective else 1.0
    # An ellipse is longer where rays are oblique.
    edge = max(grid.columns, grid.rows) * grid.side + abs(view.principal).max()
    slope = edge / abs(view.focal).min() if view.perspective else 0.0
    wide = max(size * abs(view.focal).max() / near, source.least * radius, 2.0 / grid.fine)
    wide += math.sqrt(source.blurred / variance(source.reconstruction)) * radius
    reach = np.float32(wide * (1 + slope**2) + 1.0 / grid.fine)

    def stored(px: Floats) -> Floats:
        """Sub-pixels of tiles, including some of the next tile's if grids do not divide them."""
        tile = np.floor(px * np.float32(1.0 / grid.side))
        inside = (px - tile * grid.side) * np.float32(grid.fine)
        return np.asarray(tile * np.float32(SIDE) + inside, np.float32)

    # How many of all rows above and left of a place are not opaque.
    bits = is_open.reshape(grid.rows, grid.columns, SIDE, 1) >> np.arange(GROUPS, dtype=np.uint32)
    is_left = (bits & 1).transpose(0, 2, 1, 3).reshape(grid.rows * SIDE, grid.columns * GROUPS)
    total = np.pad(is_left.cumsum(axis=0, dtype=np.int32).cumsum(axis=1), ((1, 0), (1, 0)))
    with np.errstate(all="ignore"):
        if view.perspective:
            x, y = x / z, y / z
        x = x * np.float32(view.focal[0]) + np.float32(view.principal[0] - grid.left)
        y = y * np.float32(view.focal[1]) + np.float32(view.principal[1] - grid.top)
        rows, columns = np.float32(total.shape[0] - 1), np.float32(total.shape[1] - 1)
        above, below = (
            np.clip(np.nan_to_num(stored(y + way)) + more, 0, rows).astype(np.int32)
            for way, more in ((-reach, 0), (reach, 1))
        )
        before, after = (
            np.clip(np.nan_to_num(stored(x + way)) / LANES + more, 0, columns).astype(np.int32)
            for way, more in ((-reach, 0), (reach, 1))
        )
    seen = total[below, after] - total[above, after] - total[below, before] + total[above, before]
    is_beside = (above >= below) | (before >= after)
    return np.asarray((seen > 0) | is_beside | ~ahead, np.bool_)


class SampleSource(NamedTuple):
    """Samples of a lattice as ellipsoids, widened for a view, in parts."""

    samples: Samples
    reconstruction: Reconstruction
    least: float  # px; spacing of neighbours that splats are made for, at least
    blurred: float  # px², added to the variance of splats

    def sizes(self) -> Sequence[int]:
        """Samples of each part."""
        count = self.samples.extinction.size
        return [min(PART, count - first) for first in range(0, count, PART)]

    def kernel(self) -> Reconstruction:
        """As for all of them."""
        return self.reconstruction

    def load(self, part: int, view: View, /) -> Ellipsoids:
        """Ellipsoids of a part, with the masses of their samples."""
        rows, whole = slice(part * PART, (part + 1) * PART), self.samples
        position, color, extinction = (array[rows] for array in whole[:3])
        size = None if whole.scale is None else whole.scale[rows]
        radius, kernel = self.reconstruction.radius, self.reconstruction
        axes, steps, _ = np.linalg.svd(whole.lattice)
        scale = np.ones((len(extinction), 1), np.float32) if size is None else size[:, None]
        half = (steps * radius).astype(np.float32) * scale
        through = footprint_table(kernel).values[0] / np.float32(radius**3)  # the center, per unit
        wide = half
        if self.least > 0:
            apart = spacing_of(view, Samples(position, color, extinction, whole.lattice, size))
            wide = wide * np.maximum(1, np.float32(self.least) / apart)[:, None]
        if self.blurred > 0:
            # Scene units per px at each center.
            px = np.full((1, 1), 1.0 / math.sqrt(abs(view.focal[0] * view.focal[1])), np.float32)
            if view.perspective:
                depth = along(position, view.rotation[2], float(view.translation[2]))
                px = px * np.maximum(depth, 0)[:, None]
            per = radius**2 / variance(kernel)
            wide = np.sqrt(wide**2 + np.float32(self.blurred * per) * px**2)
        share = through if wide is half else through * (half / wide).prod(axis=1)
        turn, none = _quaternion(axes)[None], np.zeros(len(extinction), np.float32)
        return Ellipsoids(position, wide, turn, none, color, kernel, extinction * share)


@once
def light_taken(kernel: Reconstruction, is_linear: bool) -> Floats:
    """Light that kernels take, per area and optical depth of the center, which is of `DEPTHS`."""
    from resample.engine.shaped.records import DEPTHS

    share = footprint_table(kernel).values.astype(np.float64)
    depth = DEPTHS[:, None] * (share / share[0])
    # Rings of equal squared radii have equal areas.
    taken = np.trapezoid(depth if is_linear else -np.expm1(-depth), dx=1.0 / (share.size - 1))
    return np.asarray(taken / DEPTHS, np.float32)


def _quaternion(axes: Doubles) -> Floats:
    """Quaternion w, x, y, z of a rotation with these columns, or their opposites."""
    turn = axes * np.sign(np.linalg.det(axes))
    # The eigenvector of the largest eigenvalue (Bar-Itzhack 2000).
    (a, b, c), (d, e, f), (g, h, i) = turn
    matrix = np.array(
        [
            [a - e - i, b + d, c + g, h - f],
            [b + d, e - a - i, f + h, c - g],
            [c + g, f + h, i - a - e, d - b],
            [h - f, c - g, d - b, a + e + i],
        ]
    )
    x, y, z, w = np.linalg.eigh(matrix)[1][:, -1]
    return np.array([w, x, y, z], np.float32)
