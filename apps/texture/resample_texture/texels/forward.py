"""Forward projection: split texels into cells, splat them, normalize the sums.

Each cell of the source (a texel, a part of one, or several) is one point: its value, spread by the
pixel filter, with the area |det J| that it covers as its mass. Masses and kernels of unit mass sum
to 1 wherever the source covers the target, so the sum of weights is the coverage (THEORY, section
2). A source larger than memory is projected part by part: its blocks are added in the same order,
each from the texels that it reads, so that sums are bit-identical.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple, Protocol

import numpy as np

from resample.engine.cells.bands import Border, Means, collect, finish
from resample.engine.cells.parts import batches, channel_groups, parts_of
from resample.engine.cells.taps import FilterTaps
from resample.engine.windows.boxes import CLAMP, FEW, MIRROR, SPARE, TRANSPARENT, WRAP, Plate
from resample.engine.windows.separable import Filters, filter_plate
from resample.profiles.filters import Area, PixelFilter, profile_table
from resample.profiles.interpolation import AreaSpline, Interpolation, prefilter, taps
from resample.registry import once
from resample.types import Doubles, Floats
from resample_texture.geometry import regions
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography, Size
from resample_texture.texels.kernels.blocks import (
    CUT,
    LENGTH,
    LEVEL,
    START,
    Integers,
    split_map,
    split_plane,
    view_bounds_of,
)
from resample_texture.texels.kernels.placing import TexelMapping, Texels, Texture, paint_blocks
from resample_texture.texels.kernels.texels import DENSE, EXACT, Extract
from resample_texture.types import Edge, Warped

FINER = 2.0  # cells per px where a smooth filter needs one
JOINED = 0.35  # px; texels are merged into cells up to this length, at quality 1
FARTHEST = 1 << 22  # texels beyond the source up to which its continuation is drawn
MOST_TEXELS = 1 << 26  # of a continued source drawn one by one
MOST_APART = 1e5  # px, between neighbours of a forward map
FEW_BEYOND = 0.25  # of a source's texels, read one by one beyond the edges
NEARLY_FULL = 0.97  # weight of a pixel that counts as filled where edges are unknown
EDGES = {Edge.TRANSPARENT: TRANSPARENT, Edge.CLAMP: CLAMP, Edge.WRAP: WRAP, Edge.MIRROR: MIRROR}
NOTHING = np.zeros((0, 0))
Range = tuple[int, int]  # first texel and last + 1
Bounds = tuple[int, int, int, int]  # left, top, right and bottom, px
MOST_VALUES = 1 << 20  # of a source in memory at a time
MOST_OF_BLOCK = 4  # times `MOST_VALUES` for a single block
NO_TOTALS = np.zeros((0, 1, 1, 1))
ONE = np.ones(1, np.float32)


@dataclass(frozen=True)
class CellGrid:
    """Splitting of texels into cells, and spreading of cells over pixels."""

    pixel_filter: PixelFilter = field(default_factory=Area)
    interpolation: Interpolation = field(default_factory=AreaSpline)
    quality: float = 1.5  # cells per px, at least
    joined: float = JOINED  # px; 0: texels are not merged
    cut: bool = True  # whether texels are split
    is_sum: bool = False
    shrinking: bool = False  # pixels that gather average only where samples shrink

    @property
    def reach(self) -> float:
        """Radius of a point's footprint, px."""
        return 0.5 * max(2, self.taps)

    def finer(self) -> "CellGrid":
        """Return finer cells, as accurate as gathering pixels."""
        return replace(self, quality=FINER * self.quality)

    @property
    def cut_quality(self) -> float:
        """Cells per px for which texels are split; 0 if they are not."""
        return float(self.quality) if self.cut else 0.0

    @property
    def longest(self) -> float:
        """Largest length of merged texels, px."""
        return float(self.joined / max(self.quality, 1.0))

    @property
    def taps(self) -> int:
        """Pixels per side that a point meets; 0 for the area filter."""
        if isinstance(self.pixel_filter, Area):
            return 0
        return max(1, math.ceil(2.0 * self.pixel_filter.radius))


class SourceBlocks(NamedTuple):
    """Blocks of a source, and their bounds on the target."""

    axes: Integers  # (B, 2, 6)
    bounds: Integers  # (B, 4) px
    matrix: Doubles  # (3, 3) source to target
    x: Doubles  # (H + 2, W + 2) positions of texel centers; empty under a homography
    y: Doubles

    @property
    def places(self) -> TexelMapping:
        """Positions of texels on the target, as kernels take them."""
        return TexelMapping(self.matrix, self.x, self.y)


def texels(
    source: Floats,
    interpolation: Interpolation,
    edge: Edge,
    kinds: frozenset[int] = frozenset(range(4)),
) -> Texels:
    """Return a source with prefiltered coefficients of the given kinds, see `kind_of`."""
    weights = prefilter(interpolation)
    if weights.size == 1:
        return Texels(source, source, source, source)
    filters = (ONE, ONE), (weights, ONE), (ONE, weights), (weights, weights)
    ready = [
        filtered(source, *filters[kind], edge) if kind in kinds and kind > 0 else source
        for kind in range(4)
    ]
    return Texels(*ready)


def kinds_of(axes: Integers) -> frozenset[int]:
    """Return the kinds of texels that blocks read; see `kind_of`."""
    is_cut = axes[:, :, CUT] > 1
    return frozenset(np.unique(is_cut[:, 0] + 2 * is_cut[:, 1]).tolist())


def widened(source: Floats, edge: Edge, interpolation: Interpolation) -> tuple[Floats, int]:
    """Pad a source where coefficients cannot be continued beyond its edges; return the margin."""
    margin = margin_of(edge, interpolation)
    if margin == 0:
        return source, 0
    return np.pad(source, ((margin, margin), (margin, margin), (0, 0)), mode="edge"), margin


def margin_of(edge: Edge, interpolation: Interpolation) -> int:
    """Return the margin that `widened` adds on each side."""
    return prefilter(interpolation).size // 2 if edge is Edge.CLAMP else 0


def moved(geometry: Homography, margin: int) -> Homography:
    """Return the homography of a source padded by `margin` texels on each side."""
    back = np.array([[1.0, 0.0, -margin], [0.0, 1.0, -margin], [0.0, 0.0, 1.0]])
    return Homography(geometry.matrix @ back, geometry.is_signed)


@once
def tap_table(interpolation: Interpolation) -> Floats:
    """Return the taps of an interpolation for cells (K, R), in the order of `phase`."""
    counts = [*range(1, EXACT + 1), DENSE]
    middle = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in counts])
    return taps(interpolation, middle, np.repeat(1.0 / np.array(counts), counts))


def blocks_of(
    geometry: Geometry, source_shape: Size, shape: Size, edge: Edge, cells: CellGrid
) -> SourceBlocks:
    """Return the blocks of a source that are visible in a frame (height, width)."""
    if isinstance(geometry, ForwardMap):
        if geometry.x.shape != source_shape:
            raise ValueError(f"a map of {geometry.x.shape} does not fit a source of {source_shape}")
        # Reject texels that are stretched too far to be drawn.
        for places in (geometry.x, geometry.y):
            if np.abs(places).max(initial=0.0, where=np.isfinite(places)) <= MOST_APART / 2:
                continue
            with np.errstate(invalid="ignore", over="ignore"):
                steps = [np.abs(np.diff(places, axis=axis)) for axis in (0, 1)]
            apart = max(step.max(initial=0.0, where=np.isfinite(step)) for step in steps)
            if apart > MOST_APART:
                raise ValueError(
                    f"a forward map moves neighbours {apart:.3g} px apart, at most {MOST_APART:g} "
                    "are allowed; give NaN for texels to drop"
                )
        axes, bounds = split_map(geometry.x, geometry.y, shape, cells.reach, cells.cut_quality)
        x, y = with_margins(geometry.x, geometry.y)
        return SourceBlocks(axes, bounds, np.eye(3), x, y)
    if isinstance(geometry, BackwardMap):
        raise ValueError("a backward map cannot be projected forward")
    # Find the rectangles (R, 4) of the plane to draw: the source and its continuation.
    matrix, (height, width) = geometry.normalized(source_shape), source_shape
    roots = np.array([[0, 0, width, height]])
    if edge is not Edge.TRANSPARENT:
        polygon = visible_polygon(view_bounds_of(matrix, shape, cells.reach), FARTHEST)
        roots = np.zeros((0, 4), np.int64)
        if polygon.size and not cells.joined:
            check_texels(polygon, source_shape)
        if polygon.size:
            low, high = np.floor(polygon.min(axis=0)), np.ceil(polygon.max(axis=0))
            across, down = (
                list(pairwise(sorted({int(low[axis]), 0, size, int(high[axis])})))
                for axis, size in enumerate((width, height))
            )
            roots = np.array([[u, v, w - u, h - v] for u, w in across for v, h in down])
    sizes = cells.reach, cells.cut_quality, cells.longest
    axes, bounds, is_whole = split_plane(matrix, roots, shape, *sizes)
    if not is_whole:
        raise ValueError(
            "the matrix stretches texels without limit near the camera's plane; give one with "
            "numbers closer to each other, or keep that part out of the frame"
        )
    return SourceBlocks(axes, bounds, matrix, NOTHING, NOTHING)


def with_margins(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
    """Extrapolate a map by one position on each side; a single row by steps of 1."""
    step_x, step_y = np.zeros((1, 3)), np.zeros((3, 1))
    step_x[0], step_y[:, 0] = [-1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]
    for axis in (0, 1):
        if x.shape[axis] > 1:
            pad = [(0, 0), (0, 0)]
            pad[axis] = (1, 1)
            x, y = (np.pad(a, pad, mode="reflect", reflect_type="odd") for a in (x, y))
        else:
            x = x + (step_x if axis == 1 else np.zeros((3, 1)))
            y = y + (step_y if axis == 0 else np.zeros((1, 3)))
    return x, y


def check_texels(polygon: Doubles, source_shape: Size) -> None:
    """Reject a continued source drawn texel by texel if too much of it is visible."""
    x, y = polygon.T
    area = 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
    if area > max(MOST_TEXELS, source_shape[0] * source_shape[1]):
        raise ValueError(
            f"{area:.0e} texels of the continued source are visible, and this method draws them "
            "one by one; leave the edges transparent, keep the horizon out, or use method hybrid"
        )


def visible_polygon(lines: Doubles, farthest: float) -> Doubles:
    """Clip a square around the origin by lines (L, 3); return its corners (N, 2)."""
    polygon = farthest * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    for line in lines:
        value = polygon @ line[:2] + line[2]
        kept = []
        for n in range(len(polygon)):
            if (value[n - 1] >= 0) != (value[n] >= 0):
                share = value[n - 1] / (value[n - 1] - value[n])
                kept.append(polygon[n - 1] + share * (polygon[n] - polygon[n - 1]))
            if value[n] >= 0:
                kept.append(polygon[n])
        polygon = np.array(kept).reshape(-1, 2)
    return polygon


def borders(geometry: Geometry, source_shape: Size, edge: Edge) -> tuple[Doubles, float]:
    """Return the screen lines (N, 3) around a source, and the weight of pixels that are filled."""
    if not isinstance(geometry, Homography):
        return np.array([[0.0, 0.0, -1.0]]), NEARLY_FULL
    matrix = geometry.normalized(source_shape)
    u, v, front = np.linalg.inv(matrix)
    if edge is not Edge.TRANSPARENT:
        return front[None], math.inf
    height, width = source_shape
    return np.stack([u, width * front - u, v, height * front - v, front]), math.inf


class PointSums:
    """Weighted sums per pixel, from column and row `first` on, to which blocks are added."""

    def __init__(
        self, shape: Size, channels: int, cells: CellGrid, first: tuple[int, int] = (0, 0)
    ) -> None:
        self.shape, self.first = shape, first
        self.cells = cells
        self.taps = tap_table(cells.interpolation)
        self.spread = spread_of(cells)
        self.groups = channel_groups(channels)
        self.pictures = [np.zeros((*shape, count + 1), np.float32) for _, count in self.groups]

    def add(
        self, source: Floats, blocks: SourceBlocks, edge: Edge, totals_help: bool | None = None
    ) -> None:
        """Add blocks of a source (H, W, C); `totals_help`: use a summed-area table."""
        if totals_help is None:
            totals_help = needs_totals(blocks.axes, source.shape[:2], edge)
        ready = texels(source, self.cells.interpolation, edge, kinds_of(blocks.axes))
        # Summed-area tables (K, H + 1, W + 1, C), if a block needs them.
        height, width, channels = source.shape
        kinds = [ready.plain] if all(one is ready.plain for one in ready) else ready[:3]
        totals = np.zeros((len(kinds) if totals_help else 0, height + 1, width + 1, channels))
        for total, kind in zip(totals, kinds, strict=False):
            total[1:, 1:] = kind.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
        self.paint(ready, Extract(*source.shape[:2]), totals, blocks, edge)

    def paint(
        self, ready: Texels, extract: Extract, totals: Doubles, blocks: SourceBlocks, edge: Edge
    ) -> None:
        """Add blocks of a source, given all the texels that they read."""
        for channels, picture in zip(self.groups, self.pictures, strict=True):
            for batch in batches(blocks.bounds, channels[1] + 1):
                texture = Texture(
                    ready, extract, totals, EDGES[edge], channels, self.taps, blocks.axes[batch],
                    blocks.places,
                )  # fmt: skip
                parts = parts_of(blocks.bounds[batch], channels[1] + 1)
                paint_blocks(texture, self.spread, parts)
                here = parts.bounds - np.array([*self.first, *self.first])
                collect(here, parts.start, parts.sums, picture)

    def warped(self, lines: Doubles, full: float) -> Warped:
        """Return the picture of all blocks added; see `borders`."""
        image = np.empty((*self.shape, sum(count for _, count in self.groups)), np.float32)
        coverage = np.empty(self.shape, np.float32)
        radius = 0.5 if self.cells.taps == 0 else self.cells.pixel_filter.radius
        border = Border(lines, radius, full, *self.first)
        for (first, _), picture in zip(self.groups, self.pictures, strict=True):
            finish(picture, border, bool(self.cells.is_sum), Means(image, coverage, first))
        return Warped(image, coverage)


def spread_of(cells: CellGrid) -> FilterTaps:
    """Return the spreading of cells over pixels, for kernels."""
    return FilterTaps(cells.taps, bool(cells.is_sum), profile_table(cells.pixel_filter, cells.taps))


def project(
    source: Floats,
    geometry: Geometry,
    shape: Size,
    edge: Edge,
    cells: CellGrid,
    *,
    wanted: Bounds | None = None,
) -> Warped:
    """Project the cells of a source (H, W, C) as points to a target, or the wanted part of it."""
    if isinstance(geometry, Homography):
        source, margin = widened(source, edge, cells.interpolation)
        geometry = moved(geometry, margin) if margin else geometry
    else:
        edge = Edge.TRANSPARENT  # a map places only the source's own texels
    source_shape = source.shape[0], source.shape[1]
    sums = sums_of(wanted or (0, 0, shape[1], shape[0]), source.shape[2], cells)
    blocks = blocks_of(geometry, source_shape, shape, edge, cells)
    kept = blocks if wanted is None else meeting(blocks, wanted)
    sums.add(source, kept, edge, needs_totals(blocks.axes, source_shape, edge))
    return sums.warped(*borders(geometry, source_shape, edge))


def sums_of(sides: Bounds, channels: int, cells: CellGrid) -> PointSums:
    """Return an accumulator for the pixels between left, top, right and bottom."""
    left, top, right, bottom = sides
    return PointSums((max(0, bottom - top), max(0, right - left)), channels, cells, (left, top))


def meeting(blocks: SourceBlocks, sides: Bounds) -> SourceBlocks:
    """Return the blocks that may touch a rectangle of the target."""
    left, top, right, bottom = blocks.bounds.T
    kept = (left < sides[2]) & (right > sides[0]) & (top < sides[3]) & (bottom > sides[1])
    return blocks._replace(axes=blocks.axes[kept], bounds=blocks.bounds[kept])


def needs_totals(axes: Integers, source_shape: Size, edge: Edge) -> bool:
    """Whether blocks merge so many texels beyond the edges that a summed-area table pays."""
    if edge is Edge.TRANSPARENT:
        return False
    height, width = source_shape
    start, end = axes[:, :, START], axes[:, :, START] + axes[:, :, LENGTH]
    outside = ((start < 0) | (end > np.array([width, height]))).any(axis=1)
    joined = (axes[:, :, LEVEL] > 0).any(axis=1)
    texels_beyond = axes[:, :, LENGTH].astype(np.float64).prod(axis=1)[outside & joined].sum()
    return bool(texels_beyond > FEW_BEYOND * height * width)


class TexelReader(Protocol):
    """A source with texels that are read on demand."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels."""

    def read(self, rows: Integers, columns: Integers) -> Floats:
        """Read texels (R, K, C) of rows (R,) and columns (K,), in any order."""


class Widened(NamedTuple):
    """A source padded with its outermost texels; see `forward.widened`."""

    reader: TexelReader
    margin: int

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels, with the margins."""
        height, width, channels = self.reader.shape
        return height + 2 * self.margin, width + 2 * self.margin, channels

    def read(self, rows: Integers, columns: Integers) -> Floats:
        """Read texels (R, K, C), see `TexelReader`."""
        height, width, _ = self.reader.shape
        rows, columns = rows - self.margin, columns - self.margin
        return self.reader.read(np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1))


def can_be_projected_partly(
    source_shape: tuple[int, int, int], geometry: Homography, shape: Size, edge: Edge,
    cells: CellGrid,
) -> bool:  # fmt: skip
    """Whether all blocks of a source (height, width, channels) read few enough texels."""
    margin = margin_of(edge, cells.interpolation)
    height, width = source_shape[0] + 2 * margin, source_shape[1] + 2 * margin
    axes = blocks_of(moved(geometry, margin), (height, width), shape, edge, cells).axes
    if needs_totals(axes, (height, width), edge):
        return False
    reach = math.ceil(cells.interpolation.radius)
    across, down = (_read(axes[:, n], (width, height)[n], edge, reach) for n in (0, 1))
    values = np.ptp(across, axis=1) * np.ptp(down, axis=1) * source_shape[2]
    large = np.flatnonzero(values > MOST_OF_BLOCK * MOST_VALUES)
    return all(_is_joinable(axes[n], (height, width)) for n in large)


def _is_joinable(block: Integers, size: Size) -> bool:
    """Whether a block lies within a source (height, width) and sums rows first."""
    start, end = block[:, START], block[:, START] + block[:, LENGTH]
    is_inside = bool((start >= 0).all() and end[0] <= size[1] and end[1] <= size[0])
    return is_inside and block[0, CUT] == block[1, CUT] == 1 and block[1, LEVEL] > 0


def project_partly(
    reader: TexelReader,
    geometry: Homography,
    shape: Size,
    edge: Edge,
    cells: CellGrid,
    wanted: Bounds,
) -> Warped:
    """Project a source that is read on demand, as `project` does; see `can_be_projected_partly`."""
    margin = margin_of(edge, cells.interpolation)
    source: TexelReader = Widened(reader, margin) if margin else reader
    geometry = moved(geometry, margin) if margin else geometry
    height, width, channels = source.shape
    sums = sums_of(wanted, channels, cells)
    blocks = meeting(blocks_of(geometry, (height, width), shape, edge, cells), wanted)
    weights = prefilter(cells.interpolation)
    filters = (ONE, ONE), (weights, ONE), (ONE, weights), (weights, weights)
    for which, across, down in _runs(blocks.axes, source.shape, edge, sums.taps.shape[0] // 2):
        some = blocks._replace(axes=blocks.axes[which], bounds=blocks.bounds[which])
        values = (across[1] - across[0]) * (down[1] - down[0]) * channels
        if values > MOST_VALUES and _is_joinable(some.axes[0], (height, width)):
            step = 1 << int(some.axes[0, 1, LEVEL])
            ready = _joined_rows(source, across, down, step)
            held = Texels(ready, ready, ready, ready)
            extract = Extract(height, width, down[0], across[0], step)
        else:
            kinds = kinds_of(some.axes) if weights.size > 1 else frozenset({0})
            made = {n: _coefficients(source, across, down, filters[n], edge) for n in kinds}
            plain = made.get(0, next(iter(made.values())))
            held = Texels(*(made.get(kind, plain) for kind in range(4)))
            extract = Extract(height, width, down[0], across[0])
        sums.paint(held, extract, NO_TOTALS, some, edge)
    return sums.warped(*borders(geometry, (height, width), edge))


def _joined_rows(source: TexelReader, across: Range, down: Range, step: int) -> Floats:
    """Sum every `step` rows of a part of a source, read strip by strip."""
    columns = np.arange(*across)
    several = max(1, MOST_VALUES // (columns.size * source.shape[2] * step)) * step
    joined = []
    for first in range(*down, several):
        rows = source.read(np.arange(first, min(first + several, down[1])), columns)
        total = rows[::step].copy()
        for n in range(1, step):
            total += rows[n::step]
        joined.append(total)
    return np.concatenate(joined)


def _coefficients(
    source: TexelReader, across: Range, down: Range, filters: tuple[Floats, Floats], edge: Edge
) -> Floats:
    """Apply a separable filter to a part of a source (H, W, C) that is read on demand."""
    along_u, along_v = filters
    left, above = along_u.size // 2, along_v.size // 2
    height, width, channels = source.shape
    rows = texels_at(np.arange(down[0] - above, down[1] + above), height, edge)
    columns = texels_at(np.arange(across[0] - left, across[1] + left), width, edge)
    texels = source.read(rows, columns)
    if left == above == 0:
        return np.ascontiguousarray(texels)
    flat = np.concatenate([texels.ravel(), np.zeros(SPARE, np.float32)])
    made = np.empty((down[1] - down[0], across[1] - across[0], channels), np.float32)
    filter_plate(flat, texels.shape, Filters(along_u, along_v), channels, made.reshape(-1))
    return made


def _runs(
    axes: Integers, source_shape: tuple[int, int, int], edge: Edge, reach: int
) -> Iterator[tuple[slice, Range, Range]]:
    """Yield runs of consecutive blocks, with columns and rows that they read, few enough texels."""
    across, down = (_read(axes[:, n], source_shape[1 - n], edge, reach) for n in (0, 1))
    most = MOST_VALUES // source_shape[2]
    first, sides = 0, None
    for n, (columns, rows) in enumerate(zip(across.tolist(), down.tolist(), strict=True)):
        left, right, top, bottom = both = *columns, *rows
        if sides is not None:
            left, right = min(left, sides[0]), max(right, sides[1])
            top, bottom = min(top, sides[2]), max(bottom, sides[3])
            if (right - left) * (bottom - top) > most:
                yield slice(first, n), sides[:2], sides[2:]
                first = n
            else:
                both = left, right, top, bottom
        sides = both
    if sides is not None:
        yield slice(first, len(axes)), sides[:2], sides[2:]


def _read(axis: Integers, size: int, edge: Edge, reach: int) -> Integers:
    """Return the first and last + 1 texel (B, 2) that blocks read along an axis."""
    pad = reach * (axis[:, CUT] > 1) << axis[:, LEVEL]
    ends = np.stack([axis[:, START] - pad, axis[:, START] + axis[:, LENGTH] + pad], axis=1)
    for n in np.flatnonzero((ends[:, 0] < 0) | (ends[:, 1] > size)):
        first, last = ends[n]
        if last - first >= size:
            ends[n] = 0, size
        else:
            there = texels_at(np.arange(first, last), size, edge)
            ends[n] = there.min(), there.max() + 1
    return ends


def texels_at(index: Integers, size: int, edge: Edge) -> Integers:
    """Return the texels that filters read at indices within and beyond the source."""
    continued = Edge.MIRROR if edge is Edge.TRANSPARENT else edge
    return regions.texels_at(index, size, continued)[0]


class SourcePart(NamedTuple):
    """A source, or a part of one."""

    texels: Floats  # (H, W, C)
    size: Size  # of the whole source: height, width
    first: tuple[int, int] = (0, 0)  # column and row at which the part begins

    @property
    def shape(self) -> tuple[int, int, int]:
        """Height, width and channels of the whole."""
        return (*self.size, self.texels.shape[2])

    def read(self, rows: Integers, columns: Integers) -> Floats:
        """Read texels, see `TexelReader`; texels outside the part are not visible."""
        held, (left, top) = self.texels, self.first
        rows, columns = np.clip(rows - top, 0, len(held) - 1), columns - left
        return np.ascontiguousarray(held[rows][:, np.clip(columns, 0, held.shape[1] - 1)])


class Sides(NamedTuple):
    """A rectangle of the continued plane of a source."""

    across: Range
    down: Range

    def wider(self, margin: int) -> "Sides":
        """Return the rectangle with a margin on each side."""
        (left, right), (top, bottom) = self
        return Sides((left - margin, right + margin), (top - margin, bottom + margin))

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.down[1] - self.down[0], self.across[1] - self.across[0]

    def plate(self, flat: Floats, part: "Sides", channels: int) -> Plate:
        """Return a plate of the rectangle, with only a part of it stored."""
        (left, _), (top, _) = self
        columns = part.shape[1]
        before = ((part.down[0] - top) * columns + part.across[0] - left) * channels
        return Plate(flat, float(left), float(top), *self.shape, channels, columns, before)


def plates_of(
    source: SourcePart, whole: Sides, part: Sides, edge: Edge, interpolation: Interpolation
) -> tuple[Plate, Plate]:
    """Return coefficients and texels of a part of a rectangle of a source's continued plane."""
    weights, channels = prefilter(interpolation), source.texels.shape[2]
    # Coefficients of two to four channels have four numbers; texels have a margin.
    lanes, margin = 4 if 2 <= channels <= 4 else channels, weights.size // 2
    outer = part.wider(margin)
    flat = _continued(source, outer, edge, FEW - 1)
    plain = whole.wider(margin).plate(flat, outer, channels)
    if margin == 0 and lanes == channels:
        return plain, plain
    smooth = _empty_flat(part.shape, lanes, FEW - 1)
    filter_plate(flat, (*outer.shape, channels), Filters(weights, weights), lanes, smooth)
    return whole.plate(smooth, part, lanes), plain


def _empty_flat(shape: Size, channels: int, rows: int) -> Floats:
    """Allocate a rectangle's numbers, and zeros for `rows` read beyond the last."""
    height, width = max(shape[0], 0), max(shape[1], 0)
    count, spare = height * width * channels, (SPARE + rows * width) * channels
    flat = np.empty(count + spare, np.float32)
    flat[count:] = 0.0
    return flat


def filtered(source: Floats, along_u: Floats, along_v: Floats, edge: Edge) -> Floats:
    """Apply a separable filter to a source (H, W, C), continued beyond its edges by `edge`."""
    height, width, channels = source.shape
    whole = SourcePart(source, (height, width)), Sides((0, width), (0, height))
    return filtered_grid(*whole, edge, along_u, along_v).reshape(height, width, channels)


def filtered_grid(
    source: SourcePart, sides: Sides, edge: Edge, along_u: Floats, along_v: Floats
) -> Floats:
    """Return a rectangle of a source's continued plane, filtered, row by row."""
    height, width, channels = source.texels.shape
    left, above = along_u.size // 2, along_v.size // 2
    is_whole = source.first == (0, 0) and sides == Sides((0, width), (0, height))
    if is_whole and left == above == 0:
        return source.texels.reshape(-1)
    (first, last), (top, bottom) = sides
    outer = Sides((first - left, last + left), (top - above, bottom + above))
    flat = _continued(source, outer, edge)
    if left == above == 0:
        return flat
    result = np.empty(sides.shape[0] * sides.shape[1] * channels, np.float32)
    filter_plate(flat, (*outer.shape, channels), Filters(along_u, along_v), channels, result)
    return result


def _continued(source: SourcePart, sides: Sides, edge: Edge, spare: int = 0) -> Floats:
    """Return the texels of a rectangle of the continued plane, row by row, with extra rows."""
    height, width, channels = source.texels.shape
    rows = texels_at(np.arange(*sides.down), source.size[0], edge) - source.first[1]
    columns = texels_at(np.arange(*sides.across), source.size[1], edge) - source.first[0]
    # Texels outside the stored part are never shown; they copy the nearest one.
    rows, columns = np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)
    flat = _empty_flat((rows.size, columns.size), channels, spare)
    if not (rows.size and columns.size):  # nothing of it is shown
        return flat
    count = rows.size * columns.size * channels
    plane = flat[:count].reshape(rows.size, columns.size, channels)
    # Copy the stored part at once, and its continuation texel by texel.
    down, across = _straight(rows), _straight(columns)
    plane[down, across] = source.texels[_of(rows, down), _of(columns, across)]
    for part in (slice(0, down.start), slice(down.stop, rows.size)):
        plane[part] = source.texels[rows[part]][:, columns]
    for part in (slice(0, across.start), slice(across.stop, columns.size)):
        plane[down, part] = source.texels[_of(rows, down)][:, columns[part]]
    return flat


def _straight(index: Integers) -> slice:
    """Return the longest run of indices that count up by one."""
    ends = np.flatnonzero(np.diff(index) != 1) + 1
    starts = np.concatenate([[0], ends])
    count = np.diff(np.concatenate([starts, [index.size]]))
    first = int(starts[count.argmax()])
    return slice(first, first + int(count.max()))


def _of(index: Integers, part: slice) -> slice:
    """Return the texels of a run of indices."""
    return slice(int(index[part.start]), int(index[part.stop - 1]) + 1)
