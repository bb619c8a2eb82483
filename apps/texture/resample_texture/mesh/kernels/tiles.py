"""Sub-pixels of a tile, and which of them a triangle may touch."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, kernel
from resample.engine.surfaces.blocks import whole_within
from resample.types import Doubles, Floats, Tiles
from resample_texture.mesh.kernels.surfaces import Ints, Place, ProjectedTriangles


class SubpixelGrid(NamedTuple):
    """Sampling of a frame."""

    samples: int  # sub-pixels per side of a pixel
    margin: int  # px around a tile that its pixels' filter reads
    quality: float  # cells per sub-pixel and axis, at least


class TileBuffer(NamedTuple):
    """Sub-pixels of one tile with its margin, and scratch to fill them."""

    left: float  # px
    top: float
    samples: int  # sub-pixels per side of a pixel
    margin: int  # px on all sides
    owner: NDArray[np.int32]  # (R, C) the visible triangle; -1: none
    nearness: Doubles  # (R, C) in the end depths, infinite where nothing is
    sums: Floats  # (R, C, 4) weighted red, green, blue and weight; in the end means and coverage
    taken: NDArray[np.uint64]  # (R, C) which of its points are covered, a bit for each
    # (R, C) nearness beyond which the next layer is peeled, infinite at first; empty, like the
    # next two, where there is only one layer.
    limit: Doubles
    visible: Floats  # (R, C, 4) red, green, blue and alpha of the layers in front
    front: Doubles  # (R, C) nearness of the first of them
    tally: Ints  # (4,) see `MeshScene`
    edge: Doubles  # (4, 5) of the current triangle: a point, a direction, the side that is inside
    polygon: Doubles  # (8, 2) px, the clipped part of the current triangle
    spare: Doubles  # (8, 2)
    rim: Doubles  # (8, 2) texture coordinates of the polygon
    corner: Doubles  # (3, 2) of the triangle


@kernel
def new_block(
    tile: int,
    tiles: Tiles,
    size: tuple[int, int],
    grid: SubpixelGrid,
    tally: Ints,
    is_layered: bool,
) -> TileBuffer:
    """Allocate an empty tile, clipped to the frame (height, width) and its margin."""
    # Clip the tile to the frame, and add the margin.
    row, column = divmod(int(np.int64(tile)), tiles.columns)
    left, top = column * tiles.size, row * tiles.size
    rows = (min(tiles.size, size[0] - top) + 2 * grid.margin) * grid.samples
    columns = (min(tiles.size, size[1] - left) + 2 * grid.margin) * grid.samples

    # Allocate buffers for layers only if something is translucent.
    layered = (rows, columns) if is_layered else (0, 0)
    return TileBuffer(
        # Origin and sampling.
        float(left - grid.margin),
        float(top - grid.margin),
        grid.samples,
        grid.margin,
        # Owner, nearness (none yet), sums, and points at outlines.
        np.full((rows, columns), -1, np.int32),
        np.full((rows, columns), -np.inf),
        np.zeros((rows, columns, 4), np.float32),
        np.empty((rows, columns), np.uint64),
        # Depth peeling: limit, composite, and nearness of the first layer.
        np.full(layered, np.inf),
        np.zeros((layered[0], layered[1], 4), np.float32),
        np.full(layered, -np.inf),
        tally,
        # Scratch for the current triangle.
        np.empty((4, 5)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((3, 2)),
    )


@inner_kernel
def columns_within(block: TileBuffer, left: float, right: float) -> tuple[int, int]:
    """First and last column of the sub-pixels between two places, px."""
    last = block.owner.shape[1] - 1
    return (
        whole_within((left - block.left) * block.samples, 0, last + 1),
        whole_within((right - block.left) * block.samples, -1, last),
    )


@inner_kernel
def span(triangles: ProjectedTriangles, n: int, block: TileBuffer) -> tuple[int, int, int, int]:
    """First and last row, first and last column of what a triangle may touch."""
    bounds = triangles.bounds[n]
    top, bottom = bounds["top"], bounds["bottom"]
    first, last = columns_within(block, bounds["left"], bounds["right"])
    rows = block.owner.shape[0]
    return (
        whole_within((top - block.top) * block.samples, 0, rows),
        whole_within((bottom - block.top) * block.samples, -1, rows - 1),
        first,
        last,
    )


@inner_kernel
def sample(block: TileBuffer, row: int, column: int) -> Place:
    """Place on screen at which a sub-pixel is tested for visibility.

    The grid of samples is rotated a little, so that vertical edges pass a pixel's samples one by
    one and not a column at a time.
    """
    # Rotated grid: each row of sub-pixels shifts along x, each column along y.
    fine = 1.0 / block.samples
    return (
        block.left + (column + 0.25 + 0.5 * fine * (row % block.samples + 0.5)) * fine,
        block.top + (row + 0.75 - 0.5 * fine * (column % block.samples + 0.5)) * fine,
    )
