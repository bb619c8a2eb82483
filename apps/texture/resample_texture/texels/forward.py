"""Forward projection of cells: the way from texels to sums per pixel, and to a picture.

Each cell of the source (a texel, part of one, or several) is one point: its value, spread by the
pixel filter, with the area |det J| that it covers as its mass. Masses and kernels of unit mass sum
to 1 wherever the source is seen, so that the sum of weights is the coverage (THEORY, section 2).
"""

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from resample.engine.cells.parts import batches, channel_groups, parts_of
from resample.engine.cells.sums import Border, Means, collect, finish
from resample.engine.cells.taps import Spread
from resample.engine.windows.edges import CLAMP, MIRROR, TRANSPARENT, WRAP
from resample.profiles.filters import Area, PixelFilter, profile_table
from resample.profiles.interpolation import AreaSpline, Interpolation, prefilter, remembered, taps
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography
from resample_texture.texels.kernels.blocks import (
    CUT,
    LENGTH,
    LEVEL,
    START,
    Integers,
    sight_of,
    split_map,
    split_plane,
)
from resample_texture.texels.kernels.painting import Texels, Texture, paint_blocks
from resample_texture.texels.kernels.placing import Placement
from resample_texture.texels.kernels.texels import DENSE, EXACT, Extract
from resample_texture.texels.plates import filtered
from resample_texture.types import Edge, Warped

FINER = 2.0  # cells per px where one would do for a smooth filter
JOINED = 0.35  # px; texels are joined to cells no longer than this, at quality 1
FARTHEST = 1 << 22  # texels beyond the source up to which its continuation is drawn
MOST_TEXELS = 1 << 26  # of a continued source that are drawn one by one
MOST_APART = 1e5  # px, neighbours of a forward map
FEW_BEYOND = 0.25  # of a source's texels, read one by one beyond its edges
NEARLY_FULL = 0.97  # weight of a pixel that counts as filled where edges are not known
EDGES = {
    Edge.TRANSPARENT: TRANSPARENT,
    Edge.CLAMP: CLAMP,
    Edge.WRAP: WRAP,
    Edge.MIRROR: MIRROR,
}
NOTHING = np.zeros((0, 0))
Bounds = tuple[int, int, int, int]  # left, top, right and bottom, px


@dataclass(frozen=True)
class Cells:
    """How texels are cut into cells and what each leaves on the screen."""

    pixel_filter: PixelFilter = field(default_factory=Area)
    interpolation: Interpolation = field(default_factory=AreaSpline)
    quality: float = 1.5  # cells per px, at least
    joined: float = JOINED  # px; 0: texels are not joined
    cut: bool = True  # whether texels are cut at all
    is_sum: bool = False

    @property
    def reach(self) -> float:
        """How far a point spreads, px."""
        return 0.5 * max(2, self.taps)

    def finer(self) -> "Cells":
        """Cells that come as near to the truth as pixels that look at the source do."""
        return replace(self, quality=FINER * self.quality)

    @property
    def cut_quality(self) -> float:
        """Cells per px that texels are cut for; 0 if they are not."""
        return float(self.quality) if self.cut else 0.0

    @property
    def longest(self) -> float:
        """Length that joined texels may have, px."""
        return float(self.joined / max(self.quality, 1.0))

    @property
    def taps_reach(self) -> int:
        """Texels beyond a block that its interpolation reads."""
        return math.ceil(self.interpolation.radius)

    @property
    def taps(self) -> int:
        """Pixels per side that a point meets; 0 for the area filter."""
        if isinstance(self.pixel_filter, Area):
            return 0
        return max(1, math.ceil(2.0 * self.pixel_filter.radius))


class Blocks(NamedTuple):
    """Parts of a source and where they show."""

    axes: Integers  # (B, 2, 6)
    bounds: Integers  # (B, 4) px
    matrix: Doubles  # (3, 3) source to target
    x: Doubles  # (H + 2, W + 2) places of texels' centers; empty under a homography
    y: Doubles

    @property
    def places(self) -> Placement:
        """Where texels go, as kernels take it."""
        return Placement(self.matrix, self.x, self.y)


def texels(
    source: Floats,
    interpolation: Interpolation,
    edge: Edge,
    kinds: frozenset[int] = frozenset(range(4)),
) -> Texels:
    """Source with what interpolation needs: coefficients where its kernel passes no sample.

    Of the four there are only those `kinds` (see `kind_of`) that are wanted; others are the source.
    """
    weights = prefilter(interpolation)
    if weights.size == 1:
        return Texels(source, source, source, source)
    one = np.ones(1, np.float32)
    filters = (one, one), (weights, one), (one, weights), (weights, weights)
    ready = [
        filtered(source, *filters[kind], edge) if kind in kinds and kind > 0 else source
        for kind in range(4)
    ]
    return Texels(*ready)


def kinds_of(axes: Integers) -> frozenset[int]:
    """Which texels blocks read; see `kind_of`."""
    is_cut = axes[:, :, CUT] > 1
    return frozenset(np.unique(is_cut[:, 0] + 2 * is_cut[:, 1]).tolist())


def widened(source: Floats, edge: Edge, interpolation: Interpolation) -> tuple[Floats, int]:
    """Source with some of what continues it, where coefficients cannot be continued so.

    Returns
    -------
    The source, and how many texels it has more on each side. Beyond an edge that repeats the
    outermost texels, coefficients of a prefiltered interpolation still vary.
    """
    margin = margin_of(edge, interpolation)
    if margin == 0:
        return source, 0
    return np.pad(source, ((margin, margin), (margin, margin), (0, 0)), mode="edge"), margin


def margin_of(edge: Edge, interpolation: Interpolation) -> int:
    """Texels that a source is widened by on each side, see `widened`."""
    return prefilter(interpolation).size // 2 if edge is Edge.CLAMP else 0


def moved(geometry: Homography, margin: int) -> Homography:
    """Homography of a source that has `margin` texels more on each side."""
    back = np.array([[1.0, 0.0, -margin], [0.0, 1.0, -margin], [0.0, 0.0, 1.0]])
    return Homography(geometry.matrix @ back, geometry.is_signed)


@remembered
def tap_table(interpolation: Interpolation) -> Floats:
    """Taps of an interpolation for cells (K, R), in the order of `phase`."""
    counts = [*range(1, EXACT + 1), DENSE]
    middle = np.concatenate([(np.arange(n) + 0.5) / n - 0.5 for n in counts])
    return taps(interpolation, middle, np.repeat(1.0 / np.array(counts), counts))


def oriented(geometry: Homography, source_shape: tuple[int, int]) -> Doubles:
    """Matrix of a homography: third coordinate positive in front of the eye, at most 1."""
    matrix = geometry.oriented(source_shape)
    height, width = source_shape
    corners = np.array([[u, v, 1.0] for u in (0, width) for v in (0, height)])
    scale = np.abs(corners @ matrix[2]).max()
    return np.ascontiguousarray(matrix / scale)


def blocks_of(
    geometry: Geometry,
    source_shape: tuple[int, int],
    shape: tuple[int, int],
    edge: Edge,
    cells: Cells,
) -> Blocks:
    """Parts of a source that a frame (height, width) sees.

    Raises
    ------
    ValueError
        The map does not fit the source, or leads backward.
    """
    if isinstance(geometry, ForwardMap):
        if geometry.x.shape != source_shape:
            raise ValueError(f"a map of {geometry.x.shape} places no source of {source_shape}")
        _check_apart(geometry)
        axes, bounds = split_map(geometry.x, geometry.y, shape, cells.reach, cells.cut_quality)
        x, y = with_margins(geometry.x, geometry.y)
        return Blocks(axes, bounds, np.eye(3), x, y)
    if isinstance(geometry, BackwardMap):
        raise ValueError("a backward map cannot be followed forward")
    matrix = oriented(geometry, source_shape)
    roots = _roots(matrix, source_shape, shape, edge, cells)
    axes, bounds = split(matrix, roots, shape, cells)
    return Blocks(axes, bounds, matrix, NOTHING, NOTHING)


def split(
    matrix: Doubles, roots: Integers, shape: tuple[int, int], cells: Cells
) -> tuple[Integers, Integers]:
    """Blocks of a plane; parameters and what is returned as of `split_plane`.

    Raises
    ------
    ValueError
        There is no end to them.
    """
    axes, bounds, is_whole = split_plane(
        matrix, roots, shape, cells.reach, cells.cut_quality, cells.longest
    )
    if not is_whole:
        raise ValueError(
            "the matrix draws texels out without end where they come near the eye's plane; give "
            "one whose numbers are nearer to each other, or leave what lies there out of the frame"
        )
    return axes, bounds


def _check_apart(geometry: ForwardMap) -> None:
    """Refuse texels that are drawn out so far that it takes for ever to draw them."""
    for places in (geometry.x, geometry.y):
        if np.abs(places).max(initial=0.0, where=np.isfinite(places)) <= MOST_APART / 2:
            continue
        with np.errstate(invalid="ignore", over="ignore"):
            steps = [np.abs(np.diff(places, axis=axis)) for axis in (0, 1)]
        apart = max(step.max(initial=0.0, where=np.isfinite(step)) for step in steps)
        if apart > MOST_APART:
            raise ValueError(
                f"a forward map leads neighbours {apart:.3g} px apart, at most {MOST_APART:g} are "
                "drawn; give NaN for texels that go nowhere"
            )


def with_margins(x: Doubles, y: Doubles) -> tuple[Doubles, Doubles]:
    """Map with one more place on each side, continued as it ends; a single row by steps of 1."""
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


def _roots(
    matrix: Doubles,
    source_shape: tuple[int, int],
    shape: tuple[int, int],
    edge: Edge,
    cells: Cells,
) -> Integers:
    """Rectangles (R, 4) of the plane to draw: the source, and what continues it around."""
    height, width = source_shape
    if edge is Edge.TRANSPARENT:
        return np.array([[0, 0, width, height]])
    polygon = seen(sight_of(matrix, shape, cells.reach), FARTHEST)
    if not polygon.size:
        return np.zeros((0, 4), np.int64)
    if not cells.joined:
        check_texels(polygon, source_shape)
    low, high = np.floor(polygon.min(axis=0)), np.ceil(polygon.max(axis=0))
    spans = [
        [(a, b) for a, b in pairwise(cuts)]
        for cuts in (
            sorted({int(low[axis]), 0, size, int(high[axis])})
            for axis, size in enumerate((width, height))
        )
    ]
    return np.array([[u, v, w - u, h - v] for u, w in spans[0] for v, h in spans[1]])


def check_texels(polygon: Doubles, source_shape: tuple[int, int]) -> None:
    """Refuse to draw a continued source texel by texel where a frame sees too much of it.

    Raises
    ------
    ValueError
        The polygon (N, 2) has an area of more than `MOST_TEXELS`, and than the source.
    """
    x, y = polygon.T
    area = 0.5 * abs(float(x @ np.roll(y, 1) - y @ np.roll(x, 1)))
    if area > max(MOST_TEXELS, source_shape[0] * source_shape[1]):
        raise ValueError(
            f"the frame sees {area:.0e} texels of the continued source, and this method draws them "
            "one by one; leave the edges transparent, keep the horizon out, or use method hybrid"
        )


def seen(lines: Doubles, farthest: float) -> Doubles:
    """Corners (N, 2) of the polygon within lines (L, 3) and a square around the origin."""
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


def borders(geometry: Geometry, source_shape: tuple[int, int], edge: Edge) -> tuple[Doubles, float]:
    """Lines (N, 3) on screen inside which a source fills pixels, and the weight that shows it.

    The product with (x, y, 1) is positive inside. The weight is infinite where lines tell all.
    """
    if not isinstance(geometry, Homography):
        return np.array([[0.0, 0.0, -1.0]]), NEARLY_FULL
    matrix = oriented(geometry, source_shape)
    u, v, front = np.linalg.inv(matrix)
    if edge is not Edge.TRANSPARENT:
        return front[None], math.inf
    height, width = source_shape
    return np.stack([u, width * front - u, v, height * front - v, front]), math.inf


class Sums:
    """Sums of points per pixel, to which parts of a source are added one by one.

    The pixels may be a part of a screen that begins at some column and row of it.
    """

    def __init__(
        self, shape: tuple[int, int], channels: int, cells: Cells, first: tuple[int, int] = (0, 0)
    ) -> None:
        self.shape, self.first = shape, first
        self.cells = cells
        self.taps = tap_table(cells.interpolation)
        self.spread = spread_of(cells)
        self.groups = channel_groups(channels)
        self.pictures = [np.zeros((*shape, count + 1), np.float32) for _, count in self.groups]

    def add(
        self, source: Floats, blocks: Blocks, edge: Edge, totals_help: bool | None = None
    ) -> None:
        """Add blocks of a source (H, W, C); whether sums save time is asked of them, or said."""
        kinds = kinds_of(blocks.axes)
        ready = texels(source, self.cells.interpolation, edge, kinds)
        if totals_help is None:
            totals_help = needs_totals(blocks.axes, source.shape[:2], edge)
        totals = _totals(ready, is_needed=totals_help)
        self.paint(ready, Extract(*source.shape[:2]), totals, blocks, edge)

    def paint(
        self, ready: Texels, extract: Extract, totals: Doubles, blocks: Blocks, edge: Edge
    ) -> None:
        """Add blocks of a source, of which there is all that they fetch."""
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
        """Picture of all that was added; see `borders`."""
        image = np.empty((*self.shape, sum(count for _, count in self.groups)), np.float32)
        coverage = np.empty(self.shape, np.float32)
        radius = 0.5 if self.cells.taps == 0 else self.cells.pixel_filter.radius
        border = Border(lines, radius, full, *self.first)
        for (first, _), picture in zip(self.groups, self.pictures, strict=True):
            finish(picture, border, bool(self.cells.is_sum), Means(image, coverage, first))
        return Warped(image, coverage)


def spread_of(cells: Cells) -> Spread:
    """How cells are spread over pixels, as kernels take it."""
    return Spread(cells.taps, bool(cells.is_sum), profile_table(cells.pixel_filter, cells.taps))


def project(
    source: Floats,
    geometry: Geometry,
    shape: tuple[int, int],
    edge: Edge,
    cells: Cells,
    *,
    wanted: Bounds | None = None,
) -> Warped:
    """Picture (height, width) of a source (H, W, C) whose cells are projected as points.

    It is what is `wanted` of it: what lies between left, top, right and bottom, px.

    Raises
    ------
    ValueError
        As `blocks_of`.
    """
    if isinstance(geometry, Homography):
        source, margin = widened(source, edge, cells.interpolation)
        geometry = moved(geometry, margin) if margin else geometry
    else:
        edge = Edge.TRANSPARENT  # a map places the source's own texels and no others
    source_shape = source.shape[0], source.shape[1]
    sums = sums_of(wanted or (0, 0, shape[1], shape[0]), source.shape[2], cells)
    blocks = blocks_of(geometry, source_shape, shape, edge, cells)
    kept = blocks if wanted is None else meeting(blocks, wanted)
    sums.add(source, kept, edge, needs_totals(blocks.axes, source_shape, edge))
    return sums.warped(*borders(geometry, source_shape, edge))


def sums_of(sides: Bounds, channels: int, cells: Cells) -> Sums:
    """Sums of the pixels between left, top, right and bottom."""
    left, top, right, bottom = sides
    return Sums((max(0, bottom - top), max(0, right - left)), channels, cells, (left, top))


def meeting(blocks: Blocks, sides: Bounds) -> Blocks:
    """Those blocks that may touch a rectangle of the target."""
    left, top, right, bottom = blocks.bounds.T
    kept = (left < sides[2]) & (right > sides[0]) & (top < sides[3]) & (bottom > sides[1])
    return blocks._replace(axes=blocks.axes[kept], bounds=blocks.bounds[kept])


def needs_totals(axes: Integers, source_shape: tuple[int, int], edge: Edge) -> bool:
    """Whether blocks join so many texels beyond the source's edges that sums save time."""
    if edge is Edge.TRANSPARENT:
        return False
    height, width = source_shape
    start, end = axes[:, :, START], axes[:, :, START] + axes[:, :, LENGTH]
    outside = ((start < 0) | (end > np.array([width, height]))).any(axis=1)
    joined = (axes[:, :, LEVEL] > 0).any(axis=1)
    texels_beyond = axes[:, :, LENGTH].astype(np.float64).prod(axis=1)[outside & joined].sum()
    return bool(texels_beyond > FEW_BEYOND * height * width)


def _totals(ready: Texels, *, is_needed: bool) -> Doubles:
    """Sums (K, H + 1, W + 1, C) of all texels above and to the left, if a block needs them."""
    height, width, channels = ready.plain.shape
    if not is_needed:
        return np.zeros((0, height + 1, width + 1, channels))
    kinds = [ready.plain] if all(kind is ready.plain for kind in ready) else ready[:3]
    sums = np.zeros((len(kinds), height + 1, width + 1, channels))
    for total, kind in zip(sums, kinds, strict=True):
        total[1:, 1:] = kind.cumsum(axis=0, dtype=np.float64).cumsum(axis=1)
    return sums
