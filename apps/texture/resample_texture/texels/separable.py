"""Warps along a picture's axes: shifts, scales and flips, as weighted sums along each axis.

A pixel is then a box, and its mean a sum down the columns and one across the rows. Weights are
exact for sides of any length, and where nothing is left to interpolate, as in the mean of two whole
texels, only those weights remain.
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from resample.engine.windows.footprints import LIMITED, NEARLY, OWN
from resample.engine.windows.gather import LONGEST_LIMITED
from resample.engine.windows.limits import MARGIN, Limits
from resample.engine.windows.separable import ROWS, AxisTaps, SeparableGrid, TileSizes, weigh_grid
from resample.profiles.interpolation import (
    blur,
    exact_prefilter,
    excess,
    faint,
    own_extent,
    own_weights,
    point_weights,
    prefilter,
    side_weights,
)
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap, Homography, Size, TargetRegion
from resample_texture.texels.forward import (
    CellGrid,
    Sides,
    SourcePart,
    TexelReader,
    filtered_grid,
    texels_at,
)
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.types import Edge, Warped

FARTHEST = 256  # texels beyond the source that are stored
TRIMMED = 1e-6  # weights below this share of the largest are left out; the rest sums to 1
MOST_COLUMNS = 64  # of a tile
NUMBERS = 4096  # in a row of the grid that a tile reads, unless a single pixel reads more
BLOCK = 64  # rows that are added at a time where pixels read more
MOST_WEIGHTS = 1 << 24  # of an axis
ONE = np.ones(1, np.float32)
NONE = np.zeros(0, np.float32)
NO_TAPS = AxisTaps(np.zeros(0, np.int64), NONE, 0, NONE)
NO_LIMITS = Limits(Sides((0, 0), (0, 0)).plate(NONE, Sides((0, 0), (0, 0)), 1), -1.0, 0.0)


class Weights(NamedTuple):
    """Weights of the texels that pixels along one axis read, on the continued plane."""

    first: Integers  # (N,)
    table: Floats  # (N, K)
    share: Floats  # (N,) share of each pixel that lies on the source
    prefilter: Floats  # of the texels, along this axis

    def ends(self, other: "Weights | None" = None) -> tuple[int, int]:
        """First texel that is read, also by other pixels, and last + 1."""
        first, last = int(self.first.min()), int(self.first.max()) + self.table.shape[1]
        if other is None:
            return first, last
        return min(first, other.ends()[0]), max(last, other.ends()[1])

    def from_start(self, start: int) -> AxisTaps:
        """Weights as kernels take them, of a grid that begins at a texel."""
        stride = self.table.shape[1]
        return AxisTaps(self.first - start, self.table.reshape(-1), stride, self.share)

    def of(self, pixels: slice) -> "Weights":
        """Return the weights of some of the pixels."""
        return self._replace(
            first=self.first[pixels], table=self.table[pixels], share=self.share[pixels]
        )

    def within(self, start: int, stop: int) -> tuple[Integers, "Weights"]:
        """Return the pixels that read texels of a stretch, and their weights of these."""
        many = self.table.shape[1]
        which = np.flatnonzero((self.first < stop) & (self.first + many > start))
        at = np.arange(start, stop) - self.first[which, None]
        is_read = (at >= 0) & (at < many)
        table = np.take_along_axis(self.table[which], np.where(is_read, at, 0), 1) * is_read
        first, share = np.full(which.size, start), np.ones(which.size, np.float32)
        return which, Weights(first, table, share, self.prefilter)

    def most(self, step: int) -> int:
        """Most texels that are read by `step` pixels side by side."""
        starts = np.arange(0, self.first.size, step)
        low = np.minimum.reduceat(self.first, starts)
        high = np.maximum.reduceat(self.first, starts)
        return int((high - low).max()) + int(self.table.shape[1])


class SeparablePlan(NamedTuple):
    """Weights along both axes of a warp, whatever the texels."""

    down: Weights
    across: Weights
    limits_down: Weights | None  # of the corners between texels; None: no limits hold
    limits_across: Weights | None
    beside_down: Weights | None  # of the two texels beside pixels; None: limits alone hold
    beside_across: Weights | None

    @property
    def is_long(self) -> bool:
        """Whether pixels read so many rows that these are added block by block."""
        down, across = self.down, self.across
        return down.table.shape[1] > BLOCK and across.prefilter.size == down.prefilter.size == 1


def separable_plan(
    size: Size, geometry: Homography | BackwardMap, shape: Size, edge: Edge, cells: CellGrid
) -> SeparablePlan | None:
    """Plan the warp of sources (height, width) to a target; None unless it is along the axes."""
    if not isinstance(geometry, Homography):
        return None
    region = geometry.region or TargetRegion(geometry, 0, 0, shape)
    is_known = min(region.shape) > 0
    target = region.shape if is_known else (region.top + shape[0], region.left + shape[1])
    whole_size = region.size or size
    inverse = np.linalg.inv(region.whole.normalized(whole_size))
    if inverse[[0, 1, 2, 2], [1, 0, 0, 1]].any() or not inverse[2, 2] > 0.0:
        return None
    scale, start = inverse[[1, 0], [1, 0]] / inverse[2, 2], inverse[[1, 0], 2] / inverse[2, 2]
    whole = tuple(scale.tolist()), tuple(start.tolist()), target, whole_size, edge, cells
    try:
        plan = _whole_plan(*whole)
    except TypeError:  # a plugin's options that cannot be hashed
        plan = _whole_plan.__wrapped__(*whole)
    if plan is None:
        return None
    # Cut the region out of the whole target's plan, which has the same bits.
    rows = slice(region.top, region.top + shape[0])
    columns = slice(region.left, region.left + shape[1])
    parts = zip(plan, (rows, columns) * 3, strict=True)
    return SeparablePlan._make(weights and weights.of(part) for weights, part in parts)


@lru_cache(maxsize=2)  # for targets drawn chunk by chunk, and pictures one after the other
def _whole_plan(
    scale: tuple[float, float],  # texels from a pixel to the next
    start: tuple[float, float],  # source coordinates of the target's corner
    shape: Size,
    size: Size,  # of the source
    edge: Edge,
    cells: CellGrid,
) -> SeparablePlan | None:
    """Plan the warp to a whole target, cached; down and across."""
    sides: Doubles = np.abs(np.array(scale))
    if any(
        count * (side + 64.0) > MOST_WEIGHTS
        for count, side in zip(shape, sides.tolist(), strict=True)
    ):
        return None
    middles: list[Doubles] = [
        start[n] + scale[n] * np.arange(0.5, count, dtype=np.float64)
        for n, count in enumerate(shape)
    ]
    for middle, side, texels in zip(middles, sides, size, strict=True):
        beyond = max(-middle.min(), middle.max() - texels) + 0.5 * side
        if edge is not Edge.TRANSPARENT and beyond > FARTHEST:
            return None
    corners = _limits(middles, sides, cells)
    # Beyond limits, texels themselves tell whether a sum may be below zero.
    of_texels = corners[0] is None and excess(cells.interpolation) >= 0.0
    axes = [
        _weights(middle, float(side), texels, edge, cells, of_texels=of_texels)
        for middle, side, texels in zip(middles, sides, size, strict=True)
    ]
    if all(axis.prefilter.size == 1 and (axis.table >= 0.0).all() for axis in axes):
        corners = None, None  # means of texels, which never ring
    beside: list[Weights | None] = [None, None]
    if corners[0] is not None and sides.max() <= LIMITED:
        for n, (middle, axis) in enumerate(zip(middles, axes, strict=True)):
            # Interpolate linearly between the two texels beside, or the coefficients of these.
            before, taps = np.floor(middle - 0.5), axis.prefilter
            part = (middle - 0.5 - before)[:, None]
            first, own = own_weights(cells.interpolation) if taps.size > 1 else (0, np.ones(1))
            table = np.zeros((middle.size, own.size + 1), np.float32)
            table[:, :-1] = (1.0 - part) * own
            table[:, 1:] += part * own
            share = np.ones(middle.size, np.float32)
            beside[n] = Weights(before.astype(np.int64) + first, table, share, taps)
    return SeparablePlan(axes[0], axes[1], *corners, beside[0], beside[1])


def weigh(plan: SeparablePlan, source: SourcePart, edge: Edge, cells: CellGrid) -> Warped:
    """Warp a source (H, W, C), or a part of it with all texels that pixels read."""
    if plan.is_long:
        return weigh_in_blocks(plan, source, edge)
    down, across, limits_down, limits_across, beside_down, beside_across = plan
    channels = source.texels.shape[2]
    shape = down.first.size, across.first.size
    warped = Warped(np.empty((*shape, channels), np.float32), np.empty(shape, np.float32))
    sides = Sides(across.ends(beside_across), down.ends(beside_down))
    flat = filtered_grid(source, sides, edge, across.prefilter, down.prefilter)
    taps = down.from_start(sides.down[0]), across.from_start(sides.across[0])
    # The texels that limit, and the weights of the corners between them.
    plain, corners = NO_LIMITS._replace(excess=excess(cells.interpolation)), taps
    if limits_down is not None and limits_across is not None:
        outer = Sides(limits_across.ends(), limits_down.ends()).wider(MARGIN)
        plate = outer.plate(filtered_grid(source, outer, edge, ONE, ONE), outer, channels)
        own = own_extent(cells.interpolation)
        plain = Limits(plate, plain.excess, own, faint(cells.interpolation))
        corners = limits_down.from_start(outer.down[0]), limits_across.from_start(outer.across[0])
    beside = (
        beside_down.from_start(sides.down[0]) if beside_down else NO_TAPS,
        beside_across.from_start(sides.across[0]) if beside_across else NO_TAPS,
    )
    grid = SeparableGrid(flat, sides.shape[1], channels, *taps, plain, *corners, *beside)
    sizes = _tile_sizes(plan, channels)
    weigh_grid(grid, sizes, warped.image.reshape(-1), warped.coverage.reshape(-1))
    return warped


def weigh_in_blocks(plan: SeparablePlan, reader: TexelReader, edge: Edge) -> Warped:
    """Warp a source, reading `BLOCK` rows at a time; any part of a target has the same bits."""
    down, across, *_ = plan
    height, width, channels = reader.shape
    sides = Sides(across.ends(), down.ends())
    columns = texels_at(np.arange(*sides.across), width, edge)
    total = np.zeros((down.first.size, across.first.size, channels))
    taps = across.from_start(sides.across[0])
    for start in range(sides.down[0] // BLOCK * BLOCK, sides.down[1], BLOCK):
        which, part = down.within(start, start + BLOCK)
        if not which.size:
            continue
        rows = texels_at(np.arange(start, start + BLOCK), height, edge)
        flat = reader.read(rows, columns).reshape(-1)
        here = part.from_start(start)
        limits = NO_LIMITS, here, taps, NO_TAPS, NO_TAPS
        grid = SeparableGrid(flat, columns.size, channels, here, taps, *limits)
        image = np.empty((which.size, across.first.size, channels), np.float32)
        sizes = _tile_sizes(SeparablePlan(part, across, None, None, None, None), channels)
        weigh_grid(grid, sizes, image.reshape(-1), np.empty(image[..., 0].size, np.float32))
        total[which] += image
    coverage = down.share[:, None] * across.share
    return Warped((total * down.share[:, None, None]).astype(np.float32), coverage)


def _tile_sizes(plan: SeparablePlan, channels: int) -> TileSizes:
    """Return the sizes of tiles, and of the scratch for them."""
    _, across, limits_down, limits_across, _, _ = plan
    # So many columns that the rows of the grid that a tile reads stay in the cache.
    steps = np.abs(np.diff(across.first))
    each = max(1.0, float(steps.mean())) if steps.size else 1.0
    room = (NUMBERS / channels - across.table.shape[1]) / each
    wide = int(min(max(room, 1.0), MOST_COLUMNS, across.first.size))
    numbers, beside, corners = across.most(wide), 0, 0
    if limits_down is not None and limits_across is not None:
        beside = limits_across.most(wide)
        numbers, corners = max(numbers, beside), beside * limits_down.most(ROWS)
    return TileSizes(wide, numbers * channels, beside * channels, corners * channels)


def _weights(
    middle: Doubles, side: float, size: int, edge: Edge, cells: CellGrid, *, of_texels: bool
) -> Weights:
    """Return the weights of pixels `side` texels long along an axis, of coefficients or texels."""
    low, high = middle - 0.5 * side, middle + 0.5 * side
    share = np.ones(middle.size, np.float32)
    if edge is Edge.TRANSPARENT:
        low, high = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
        share = ((high - low) / side).astype(np.float32)
        share[share > 1.0 - NEARLY], share[share < NEARLY] = 1.0, 0.0
    interpolation = cells.interpolation
    if cells.shrinking:
        middle = 0.5 * (low + high)
        longer = math.sqrt(max(side * side - OWN - blur(interpolation), 0.0))
        low, high = middle - 0.5 * longer, middle + 0.5 * longer
        if edge is Edge.TRANSPARENT:
            low, high = np.clip(low, 0.0, size), np.clip(high, 0.0, size)
    if cells.shrinking and longer == 0.0:
        first, table = point_weights(interpolation, low)
    else:
        first, table = side_weights(interpolation, low, high)
    taps = prefilter(interpolation)
    if taps.size > 1 and (side > 1.0 or of_texels):
        # Turn weights of coefficients into weights of texels.
        exact, many = exact_prefilter(interpolation), table.shape[1]
        wide = np.zeros((len(table), many + exact.size - 1))
        for n, tap in enumerate(exact.tolist()):
            wide[:, n : n + many] += tap * table
        first, table, taps = first - exact.size // 2, wide, ONE
    # Leave out weights at both ends that are errors of rounding; the rest sums to 1.
    many = table.shape[1]
    is_some = np.abs(table) > TRIMMED * np.abs(table).max(axis=1, keepdims=True)
    start = is_some.argmax(axis=1)
    end = many - is_some[:, ::-1].argmax(axis=1)
    most = int((end - start).max())
    start = np.minimum(start, many - most)
    kept = np.take_along_axis(np.where(is_some, table, 0.0), start[:, None] + np.arange(most), 1)
    first, table = first + start, kept / kept.sum(axis=1, keepdims=True)
    return Weights(first, table.astype(np.float32), share, taps)


def _limits(
    middles: list[Doubles], sides: Doubles, cells: CellGrid
) -> tuple[Weights | None, Weights | None]:
    """Return the weights of the corners that limit pixels down and across, if any do."""
    shorter, longer = sorted(sides.tolist())
    if excess(cells.interpolation) < 0.0 or shorter > LIMITED or longer > LONGEST_LIMITED:
        return None, None
    counts = [1 if side == shorter or longer <= LIMITED else math.ceil(side) for side in sides]
    found = []
    for middle, side, count in zip(middles, sides.tolist(), counts, strict=True):
        parts = middle[:, None] + side * ((np.arange(count) + 0.5) / count - 0.5)
        corner = np.floor(parts)
        first = corner.min(axis=1).astype(np.int64)
        many = int((corner.max(axis=1) - first).max()) + 2
        table = np.zeros((middle.size, many))
        rows = np.arange(middle.size)
        for n in range(count):
            at, part = corner[:, n].astype(np.int64) - first, parts[:, n] - corner[:, n]
            table[rows, at] += (1.0 - part) / count
            table[rows, at + 1] += part / count
        share = np.ones(middle.size, np.float32)
        found.append(Weights(first, table.astype(np.float32), share, ONE))
    return found[0], found[1]
