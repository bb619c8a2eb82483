"""Warp by backward maps: parts of pixels sample the source, then splat as points."""

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.cells.parts import batches, parts_of
from resample.engine.cells.sums import collect
from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap
from resample_texture.texels.forward import (
    EDGES,
    NEARLY_FULL,
    CellGrid,
    PointSums,
    texels,
    widened,
)
from resample_texture.texels.kernels.blocks import Integers
from resample_texture.texels.kernels.gathering import Pixels, gather_tiles
from resample_texture.types import Edge, Warped

TILE = 32  # px per side; a thread takes a tile at a time


def collect_from(
    source: Floats, geometry: BackwardMap, shape: tuple[int, int], edge: Edge, cells: CellGrid
) -> Warped:
    """Warp a source (H, W, C) by a backward map to (height, width)."""
    if geometry.x.shape != shape:
        raise ValueError(f"a map of {geometry.x.shape} does not fit a target of {shape}")
    if cells.is_sum and min(shape) == 1:
        raise ValueError(f"a map of {shape} tells no areas, which sums need; give 2 × 2 px or more")
    source, margin = widened(source, edge, cells.interpolation)
    sums = PointSums(shape, source.shape[2], cells)
    ready = texels(source, cells.interpolation, edge, frozenset({3})).both
    reach = int(np.ceil(cells.reach)) + 1
    around = 0 if cells.taps == 0 else reach  # px around the picture whose points extend into it
    map_u, map_v = (extended(a + margin, around + 1) for a in (geometry.x, geometry.y))
    tiles = tiles_of((shape[0] + 2 * around, shape[1] + 2 * around), TILE)
    bounds = tiles + np.array([-reach, -reach, reach, reach])
    quality = float(cells.quality) if cells.cut else 1.0
    for channels, picture in zip(sums.groups, sums.pictures, strict=True):
        for batch in batches(bounds, channels[1] + 1):
            pixels = Pixels(
                ready, EDGES[edge], channels, sums.taps, map_u, map_v, tiles[batch], quality
            )
            parts = parts_of(bounds[batch], channels[1] + 1)
            gather_tiles(pixels, sums.spread, parts)
            collect(bounds[batch] - around, parts.start, parts.sums, picture)
    nowhere = np.array([[0.0, 0.0, -1.0]])
    return sums.warped(nowhere, NEARLY_FULL)


def extended(places: Doubles, margin: int) -> Doubles:
    """Extrapolate a map on each side; a single row or column is repeated."""
    return np.pad(places, margin, mode="reflect", reflect_type="odd")


def tiles_of(shape: tuple[int, int], side: int) -> Integers:
    """Return the tiles (T, 4) of a picture: left, top, right and bottom, px."""
    top, left = (a.ravel() for a in np.mgrid[0 : shape[0] : side, 0 : shape[1] : side])
    tiles = np.empty((top.size, 4), np.int64)
    tiles[:, LEFT], tiles[:, TOP] = left, top
    tiles[:, RIGHT] = np.minimum(left + side, shape[1])
    tiles[:, BOTTOM] = np.minimum(top + side, shape[0])
    return tiles
