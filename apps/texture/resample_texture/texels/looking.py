"""Warps by pixels that look at the source, where that is less work than projecting its texels.

The sum over texels of an interpolation's kernel, as a pixel's area sees it, is the same whether
texels are projected one by one or pixels collect them. Where texels grow, or a pixel covers a few,
pixels do the least; where a pixel covers many, texels do (`texels.forward`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.windows.boxes import LONGEST, ONES, PHASES, Integral, Plate
from resample.engine.windows.limits import Limits
from resample.engine.windows.looking import Extent, View
from resample.profiles.interpolation import Interpolation, excess, integrals, prefilter
from resample.types import Floats
from resample_texture.geometry.mappings import BackwardMap, Homography
from resample_texture.geometry.windows import SeenTiles
from resample_texture.texels.backward import extended, tiles_of
from resample_texture.texels.forward import EDGES, Cells, oriented, project
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.texels.kernels.looking import Map, Plane, look_at, measure
from resample_texture.texels.plates import plates_of
from resample_texture.types import Edge, Warped

TILE = 32  # px along a side of what one thread takes at a time
MOST_WORK = 12.0  # boxes per pixel up to which pixels look; beyond, texels are projected
MOST_BEYOND = 256  # texels beyond the source that are drawn as they are; those farther are folded
NOTHING = np.zeros(0, np.float32)


class Tiles(NamedTuple):
    """The target in tiles, and what they see."""

    bounds: Integers  # (T, 4) px
    extent: Extent
    is_near: NDArray[np.bool_]  # (T,) its pixels look at the source


class Gaze(NamedTuple):
    """Where pixels of a target look in a source, whatever it shows."""

    size: tuple[int, int]  # of the source: height, width
    geometry: Homography | BackwardMap
    shape: tuple[int, int]
    edge: Edge
    cells: Cells
    places: Plane | Map
    tiles: Tiles


def planned(
    size: tuple[int, int], geometry: Homography | BackwardMap, shape: tuple[int, int], edge: Edge,
    cells: Cells,
) -> Gaze:  # fmt: skip
    """Where pixels of a target (height, width) look in sources (height, width).

    Raises
    ------
    ValueError
        A map has another shape than the picture.
    """
    places = _places(size, geometry, shape)
    tiles = _measured(places, _view((*size, 1), edge, cells), shape)
    return Gaze(size, geometry, shape, edge, cells, places, tiles)


def look(plan: Gaze, source: Floats) -> Warped:
    """Picture (height, width) of a source (H, W, C) under the area filter.

    Raises
    ------
    ValueError
        As of `forward.project`.
    """
    _, geometry, shape, edge, cells, places, tiles = plan
    view = _view(source.shape, edge, cells)
    warped = Warped(np.empty((*shape, source.shape[2]), np.float32), np.empty(shape, np.float32))
    if not tiles.is_near.all():
        assert isinstance(geometry, Homography)
        left, top, right, bottom = _around(tiles.bounds[~tiles.is_near])
        back = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]])
        moved = Homography(back @ oriented(geometry, source.shape[:2]), is_signed=True)
        far = project(source, moved, (bottom - top, right - left), edge, cells.finer())
        warped.image[top:bottom, left:right] = far.image
        warped.coverage[top:bottom, left:right] = far.coverage
    if tiles.is_near.any():
        view = _with_plate(source, view, edge, cells.interpolation, tiles)
        near, seen = tiles.bounds[tiles.is_near], tiles.extent.bounds[tiles.is_near]
        look_at(places, view, near, seen, warped.image, warped.coverage)
    return warped


def seen_tiles(
    size: tuple[int, int], geometry: Homography | BackwardMap, shape: tuple[int, int], edge: Edge,
    cells: Cells,
) -> SeenTiles | None:  # fmt: skip
    """What tiles of a picture (height, width) see of a source (height, width).

    None if not all of them look: texels that are projected have no part of their own.
    """
    tiles = planned(size, geometry, shape, edge, cells).tiles
    reach = prefilter(cells.interpolation).size // 2 + math.ceil(cells.interpolation.radius) + 3
    is_endless = edge in (Edge.WRAP, Edge.MIRROR)
    whole = SeenTiles(tiles.bounds, tiles.extent.bounds, reach, is_endless)
    return whole if tiles.is_near.all() else None


def _places(
    size: tuple[int, int], geometry: Homography | BackwardMap, shape: tuple[int, int]
) -> Plane | Map:
    """Where pixels lie, as kernels take it."""
    if isinstance(geometry, Homography):
        return Plane(np.ascontiguousarray(np.linalg.inv(oriented(geometry, size))))
    if geometry.x.shape != shape:
        raise ValueError(f"a map of {geometry.x.shape} makes no picture of {shape}")
    return Map(extended(geometry.x, 1), extended(geometry.y, 1))


def _measured(places: Plane | Map, view: View, shape: tuple[int, int]) -> Tiles:
    """Tiles of a target and what they see; corners tell it of a plane."""
    bounds = tiles_of(shape, TILE)
    count = len(bounds)
    extent = Extent(np.empty((count, 4)), np.empty(count), np.empty(count))
    if isinstance(places, Map):
        measure(places, bounds, 1, view, extent)
        return Tiles(bounds, extent, np.ones(count, bool))
    measure(places, bounds, TILE - 1, view, extent)
    return Tiles(bounds, extent, (extent.work <= MOST_WORK) & (extent.span <= LONGEST))


def _around(bounds: Integers) -> list[int]:
    """Left, top, right and bottom of the rectangle around others."""
    low, high = bounds[:, :2].min(axis=0), bounds[:, 2:].max(axis=0)
    return [int(side) for side in (*low, *high)]


def _with_plate(
    source: Floats, view: View, edge: Edge, interpolation: Interpolation, tiles: Tiles
) -> View:
    """View with the part of the source that near tiles see, or all of it where that is more."""
    bounds, span = tiles.extent.bounds[tiles.is_near], tiles.extent.span[tiles.is_near]
    bounds = bounds[bounds[:, 0] <= bounds[:, 2]]
    size = np.array([source.shape[1], source.shape[0]])
    low = bounds[:, :2].min(axis=0, initial=math.inf)
    high = bounds[:, 2:].max(axis=0, initial=-math.inf)
    reach = math.ceil(interpolation.radius) + 2
    if edge is Edge.TRANSPARENT or not len(bounds):
        low, high = np.clip(low, 0, size - 1), np.clip(high, 1, size)
        reach += math.ceil(span.max(initial=0.0) / 8)
    elif (low < -MOST_BEYOND).any() or (high > size + MOST_BEYOND).any():
        beyond = 0 if edge is not Edge.CLAMP else prefilter(interpolation).size // 2 + reach
        reach += math.ceil(min(span.max(), LONGEST))
        view = view._replace(margin=float(beyond))
        low, high = np.full(2, -beyond), size + beyond
    (left, top), (right, bottom) = np.floor(low) - reach, np.ceil(high) + reach
    across, down = (int(left), int(right)), (int(top), int(bottom))
    plate, plain = plates_of(source, across, down, edge, interpolation)
    return view._replace(plate=plate, limits=view.limits._replace(plain=plain))


def _view(form: tuple[int, ...], edge: Edge, cells: Cells) -> View:
    """How pixels take a source (H, W, C), of which there is no plate as yet."""
    height, width, channels = form
    plate = Plate(NOTHING, 0.0, 0.0, 0, 0, channels)
    finest = 1.5 / cells.quality
    integral = Integral(*integrals(cells.interpolation, PHASES, ONES))
    limits = Limits(plate, excess(cells.interpolation))
    return View(plate, integral, (height, width), EDGES[edge], math.inf, finest, limits)
