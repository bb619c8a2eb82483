"""Gather pixels from the source, where that is cheaper than projecting texels.

A pixel's area filter sums the interpolation kernels of texels; the sum is the same whether texels
are projected or pixels gather. Where texels grow, or a pixel covers few of them, gathering is
cheaper; where a pixel covers many, projecting is (`texels.forward`).
"""

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, collect
from resample.engine.cells.parts import batches, parts_of
from resample.engine.windows.boxes import (
    FINE_PHASES,
    LONGEST,
    ONES,
    PHASES,
    POINTLIKE,
    SHORTEST,
    Plate,
    PointTaps,
)
from resample.engine.windows.footprints import OWN, GridView
from resample.engine.windows.gather import Extent
from resample.engine.windows.limits import Limits
from resample.profiles.interpolation import (
    Interpolation,
    blur,
    excess,
    faint,
    integrals,
    own_extent,
    point_taps,
    prefilter,
)
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap, Homography, Size, TargetRegion
from resample_texture.geometry.regions import VisibleTiles
from resample_texture.texels import forward
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.texels.kernels.gather import (
    Map,
    Pixels,
    Plane,
    collect_tiles,
    fill_tiles,
    measure,
)
from resample_texture.texels.separable import SeparablePlan, separable_plan, weigh, weigh_in_blocks
from resample_texture.types import Edge, Warped

TILE = 32  # px per side; a thread takes a tile at a time
MOST_WORK = 12.0  # boxes per pixel up to which pixels gather; above, texels are projected
MOST_AROUND = 1 << 30  # px of a target up to which a region measures all of its tiles
MOST_BEYOND = 256  # texels beyond the source that are stored; coordinates farther out are folded
NOTHING = np.zeros(0, np.float32)
ALL = np.zeros((0, 0), np.bool_)  # of the pixels


class TargetTiles(NamedTuple):
    """Tiles of the target, and the extent of the source that each gathers from."""

    bounds: Integers  # (T, 4) px
    extent: Extent
    is_near: NDArray[np.bool_]  # (T,) its pixels gather

    @property
    def beyond(self) -> tuple[Doubles, Doubles]:
        """Least and greatest source coordinates (2,) of near tiles."""
        bounds = self.extent.bounds[self.is_near]
        bounds = bounds[bounds[:, 0] <= bounds[:, 2]]
        low = bounds[:, :2].min(axis=0, initial=math.inf)
        return low, bounds[:, 2:].max(axis=0, initial=-math.inf)


class GatherPlan(NamedTuple):
    """Plan of gathering a target from a source, independent of its texels."""

    size: Size  # of the source: height, width
    geometry: Homography | BackwardMap
    shape: Size
    edge: Edge
    cells: forward.CellGrid
    places: Plane | Map
    tiles: TargetTiles
    around: TargetTiles  # of the whole target if the picture is a region of it, or `tiles`
    axes: SeparablePlan | None  # of a warp along the axes: all tiles gather


def planned(
    size: Size, geometry: Homography | BackwardMap, shape: Size, edge: Edge,
    cells: forward.CellGrid,
) -> GatherPlan:  # fmt: skip
    """Plan how a target (height, width) gathers from sources (height, width)."""
    region = geometry.region if isinstance(geometry, Homography) else None
    whole = size if region is None else region.size or size
    places, view = places_of(size, geometry, shape), _view((*whole, 1), edge, cells)
    tiles = around = _measured(places, view, shape)
    axes = separable_plan(size, geometry, shape, edge, cells)
    if axes is not None:
        tiles = tiles._replace(is_near=np.ones(len(tiles.bounds), np.bool_))
        return GatherPlan(size, geometry, shape, edge, cells, places, tiles, tiles, axes)
    if region is not None and 0 < math.prod(region.shape) <= MOST_AROUND:
        target = (region.whole, region.shape, whole, edge, cells)
        try:
            around = _measured_once(*target)
        except TypeError:  # a plugin's options that cannot be hashed
            around = _measured_once.__wrapped__(*target)
    return GatherPlan(size, geometry, shape, edge, cells, places, tiles, around, None)


def gather(
    plan: GatherPlan,
    source: Floats,
    *,
    near_only: bool = False,
    wanted: NDArray[np.bool_] | None = None,
) -> Warped:
    """Warp a source (H, W, C) under the area filter: all of it, near tiles, or wanted pixels."""
    _, geometry, shape, edge, cells, places, tiles, around, axes = plan
    region = geometry.region if isinstance(geometry, Homography) else None
    held = forward.SourcePart(source, (source.shape[0], source.shape[1]))
    if region is not None and region.size is not None:
        held = forward.SourcePart(source, region.size, region.first)
    if axes is not None:
        return weigh(axes, held, edge, cells)
    view = _view((*held.size, source.shape[2]), edge, cells)
    is_far = ~tiles.is_near
    if wanted is not None:
        down, across = (np.arange(0, count, TILE) for count in shape)
        rows = np.logical_or.reduceat(wanted, down, axis=0)
        is_wanted = np.logical_or.reduceat(rows, across, axis=1).ravel()
        is_far, tiles = is_far & is_wanted, tiles._replace(is_near=tiles.is_near & is_wanted)
    is_whole = wanted is None and not near_only
    make = np.empty if is_whole else np.zeros  # mending of gaps reads all pixels
    warped = Warped(make((*shape, source.shape[2]), np.float32), make(shape, np.float32))
    if is_far.any() and not near_only:
        far, finer = far_of(plan), cells.finer()
        made = forward.project(source, far.geometry, far.shape, edge, finer, wanted=far.wanted)
        warped.image[far.part], warped.coverage[far.part] = made
    if tiles.is_near.any():
        view = _with_plate(held, view, edge, cells.interpolation, tiles, around)
        near, seen = tiles.bounds[tiles.is_near], tiles.extent.bounds[tiles.is_near]
        some = ALL if wanted is None else wanted
        fill_tiles(places, view, near, seen, some, warped.image, warped.coverage)
    if wanted is not None and is_far.any():  # the rectangle of far texels covers others, too
        warped.image[~wanted] = warped.coverage[~wanted] = 0
    return warped


class Far(NamedTuple):
    """Projection of texels to far tiles, and the part of the picture that it fills."""

    geometry: Homography  # source to a rectangle, the same for all parts of a target
    shape: Size  # of the rectangle
    wanted: forward.Bounds  # part of it
    part: tuple[slice, slice]  # of the picture


def far_of(plan: GatherPlan) -> Far:
    """Return the rectangle around far tiles, of the whole target if there is one."""
    geometry, region, around = plan.geometry, None, plan.around
    assert isinstance(geometry, Homography)
    if around is not plan.tiles:
        region = geometry.region
    tiles = around if region else plan.tiles
    far = tiles.bounds[~tiles.is_near]
    sides = *far[:, :2].min(axis=0), *far[:, 2:].max(axis=0)
    left, top, right, bottom = (int(side) for side in sides)
    back = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
    whole = region.whole if region else geometry
    moved = Homography(back @ whole.normalized(plan.size), is_signed=True)
    x, y = (region.left, region.top) if region else (0, 0)  # of the picture
    first = max(left - x, 0), max(top - y, 0)
    last = min(right - x, plan.shape[1]), min(bottom - y, plan.shape[0])
    wanted = first[0] + x - left, first[1] + y - top, last[0] + x - left, last[1] + y - top
    part = np.s_[first[1] : last[1], first[0] : last[0]]
    return Far(moved, (bottom - top, right - left), wanted, part)


def visible_tiles(
    size: Size, geometry: Homography | BackwardMap, shape: Size, edge: Edge,
    cells: forward.CellGrid,
) -> VisibleTiles | None:  # fmt: skip
    """Return the source bounds that tiles of a picture gather from; None unless all do."""
    plan = planned(size, geometry, shape, edge, cells)
    if plan.axes is not None and plan.axes.is_long:
        return None
    return _visible(plan.tiles, edge, cells) if plan.tiles.is_near.all() else None


def _visible(tiles: TargetTiles, edge: Edge, cells: forward.CellGrid) -> VisibleTiles:
    """Return the source bounds of near tiles; empty bounds for others."""
    reach = prefilter(cells.interpolation).size // 2 + math.ceil(cells.interpolation.radius) + 3
    nothing = np.array([math.inf, math.inf, -math.inf, -math.inf])
    bounds = np.where(tiles.is_near[:, None], tiles.extent.bounds, nothing)
    return VisibleTiles(tiles.bounds, bounds, reach, edge in (Edge.WRAP, Edge.MIRROR))


class MixedTiles(NamedTuple):
    """Tiles of a picture: near ones gather, and texels are projected to far ones."""

    near: VisibleTiles  # near tiles; bounds of far ones are empty
    is_near: NDArray[np.bool_]  # (T,)
    far: Far
    edge: Edge
    cells: forward.CellGrid
    axes: SeparablePlan | None = None  # of a warp along the axes: all tiles are far

    def projected(self, reader: forward.TexelReader) -> Warped:
        """Project the texels of a source that is read on demand to the far tiles."""
        if self.axes is not None:
            return weigh_in_blocks(self.axes, reader, self.edge)
        geometry, shape, wanted, _ = self.far
        return forward.project_partly(reader, geometry, shape, self.edge, self.cells, wanted)


def mixed_tiles(
    source_shape: tuple[int, int, int], geometry: Homography, shape: Size, edge: Edge,
    cells: forward.CellGrid,
) -> MixedTiles | None:  # fmt: skip
    """Split tiles into near and far ones, for a source read in parts; None if impossible."""
    plan = planned(source_shape[:2], geometry, shape, edge, cells)
    if plan.axes is not None and plan.axes.is_long:
        nowhere = np.zeros(len(plan.tiles.bounds), np.bool_)
        far = Far(geometry, shape, (0, 0, shape[1], shape[0]), np.s_[:, :])
        near = _visible(plan.tiles._replace(is_near=nowhere), edge, cells)
        return MixedTiles(near, nowhere, far, edge, cells, plan.axes)
    if plan.tiles.is_near.all():
        return None
    far, finer = far_of(plan), cells.finer()
    if not forward.can_be_projected_partly(source_shape, far.geometry, far.shape, edge, finer):
        return None
    return MixedTiles(_visible(plan.tiles, edge, cells), plan.tiles.is_near, far, edge, finer)


def places_of(size: Size, geometry: Homography | BackwardMap, shape: Size) -> Plane | Map:
    """Return the map from pixels to the source, as kernels take it."""
    if isinstance(geometry, Homography):
        region = geometry.region or TargetRegion(geometry, 0, 0, shape)
        matrix = region.whole.normalized(region.size or size)
        inverse = np.ascontiguousarray(np.linalg.inv(matrix))
        return Plane(inverse, region.left, region.top)
    if geometry.x.shape != shape:
        raise ValueError(f"a map of {geometry.x.shape} does not fit a target of {shape}")
    return Map(extended(geometry.x, 1), extended(geometry.y, 1))


def _measured(places: Plane | Map, view: GridView, shape: Size) -> TargetTiles:
    """Measure the tiles of a target; under a homography corners suffice."""
    bounds = tiles_of(shape, TILE)
    count = len(bounds)
    extent = Extent(np.empty((count, 4)), np.empty(count), np.empty(count))
    if isinstance(places, Map):
        measure(places, bounds, 1, view, extent)
        return TargetTiles(bounds, extent, np.ones(count, bool))
    measure(places, bounds, TILE - 1, view, extent)
    return TargetTiles(bounds, extent, (extent.work <= MOST_WORK) & (extent.span <= LONGEST))


@lru_cache(maxsize=2)  # for targets drawn chunk by chunk
def _measured_once(
    geometry: Homography, shape: Size, size: Size, edge: Edge, cells: forward.CellGrid
) -> TargetTiles:
    """Measure the tiles of a whole target, cached; `size` is the source's."""
    return _measured(places_of(size, geometry, shape), _view((*size, 1), edge, cells), shape)


def _with_plate(
    source: forward.SourcePart, view: GridView, edge: Edge, interpolation: Interpolation,
    tiles: TargetTiles, around: TargetTiles,
) -> GridView:  # fmt: skip
    """Attach the part of the source that near tiles of the whole target read to a view."""
    span = around.extent.span[around.is_near]
    size = np.array(source.size[::-1])
    (low, high), (lowest, highest) = tiles.beyond, around.beyond
    reach = math.ceil(interpolation.radius) + 2
    if edge is Edge.TRANSPARENT or low[0] > high[0]:
        low, high = np.clip(low, 0, size - 1), np.clip(high, 1, size)
        lowest, highest = np.clip(lowest, 0, size - 1), np.clip(highest, 1, size)
        reach += math.ceil(min(span.max(initial=0.0) / 8, LONGEST / 2))
    elif (lowest < -MOST_BEYOND).any() or (highest > size + MOST_BEYOND).any():
        reach += math.ceil(min(span.max(), LONGEST))
        beyond = 0 if edge is not Edge.CLAMP else prefilter(interpolation).size // 2 + reach
        view = view._replace(margin=float(beyond))
        lowest, highest = np.full(2, -beyond), size + beyond
        is_told = edge is Edge.CLAMP or bool(((low >= 0) & (high <= size)).all())
        low = np.clip(low, lowest, highest) if is_told else lowest
        high = np.clip(high, lowest, highest) if is_told else highest
    part, whole = _sides(low, high, reach), _sides(lowest, highest, reach)
    plate, plain = forward.plates_of(source, whole, part, edge, interpolation)
    return view._replace(plate=plate, limits=view.limits._replace(plain=plain))


def _sides(low: Doubles, high: Doubles, reach: int) -> forward.Sides:
    """Return the whole texels between two corners, with some around them."""
    (left, top), (right, bottom) = np.floor(low) - reach, np.ceil(high) + reach
    return forward.Sides((int(left), int(right)), (int(top), int(bottom)))


def _view(form: tuple[int, ...], edge: Edge, cells: forward.CellGrid) -> GridView:
    """Return a view for gathering from a source (H, W, C), still without its texels."""
    height, width, channels = form
    plate = Plate(NOTHING, 0.0, 0.0, 0, 0, channels, 0, 0)
    finest = float(1.5 / cells.quality)
    points = PointTaps(NOTHING, 0, 0, 0.0)
    if cells.shrinking:
        points = PointTaps(
            *point_taps(cells.interpolation, FINE_PHASES), OWN + blur(cells.interpolation)
        )
    shortest = POINTLIKE if cells.shrinking else SHORTEST
    integral = integrals(cells.interpolation, PHASES, ONES)._replace(shortest=shortest)
    chosen = cells.interpolation
    limits = Limits(plate, excess(chosen), own_extent(chosen), faint(chosen))
    return GridView(
        plate, integral, points, (height, width), forward.EDGES[edge], math.inf, finest, limits
    )


def collect_from(
    source: Floats, geometry: BackwardMap, shape: Size, edge: Edge, cells: forward.CellGrid
) -> Warped:
    """Warp a source (H, W, C) by a backward map to (height, width)."""
    if geometry.x.shape != shape:
        raise ValueError(f"a map of {geometry.x.shape} does not fit a target of {shape}")
    if cells.is_sum and min(shape) == 1:
        raise ValueError(f"a map of {shape} tells no areas, which sums need; give 2 × 2 px or more")
    source, margin = forward.widened(source, edge, cells.interpolation)
    sums = forward.PointSums(shape, source.shape[2], cells)
    ready = forward.texels(source, cells.interpolation, edge, frozenset({3})).both
    reach = int(np.ceil(cells.reach)) + 1
    around = 0 if cells.taps == 0 else reach  # px around the picture, with points extending into it
    map_u, map_v = (extended(a + margin, around + 1) for a in (geometry.x, geometry.y))
    tiles = tiles_of((shape[0] + 2 * around, shape[1] + 2 * around), TILE)
    bounds = tiles + np.array([-reach, -reach, reach, reach])
    quality = float(cells.quality) if cells.cut else 1.0
    for channels, picture in zip(sums.groups, sums.pictures, strict=True):
        for batch in batches(bounds, channels[1] + 1):
            pixels = Pixels(
                ready, forward.EDGES[edge], channels, sums.taps, map_u, map_v, tiles[batch], quality
            )
            parts = parts_of(bounds[batch], channels[1] + 1)
            collect_tiles(pixels, sums.spread, parts)
            collect(bounds[batch] - around, parts.start, parts.sums, picture)
    nowhere = np.array([[0.0, 0.0, -1.0]])
    return sums.warped(nowhere, forward.NEARLY_FULL)


def extended(places: Doubles, margin: int) -> Doubles:
    """Extrapolate a map on each side; a single row or column is repeated."""
    return np.pad(places, margin, mode="reflect", reflect_type="odd")


def tiles_of(shape: Size, side: int) -> Integers:
    """Return the tiles (T, 4) of a picture: left, top, right and bottom, px."""
    top, left = (a.ravel() for a in np.mgrid[0 : shape[0] : side, 0 : shape[1] : side])
    tiles = np.empty((top.size, 4), np.int64)
    tiles[:, LEFT], tiles[:, TOP] = left, top
    tiles[:, RIGHT] = np.minimum(left + side, shape[1])
    tiles[:, BOTTOM] = np.minimum(top + side, shape[0])
    return tiles
