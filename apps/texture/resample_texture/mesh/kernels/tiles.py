"""Tiles of sub-pixels, each painted by one thread, and which triangles touch which."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.types import Doubles, Floats
from resample_texture.mesh.kernels.surfaces import Ints, Place, Surfaces, bounds


class Grid(NamedTuple):
    """Tiles of sub-pixels."""

    height: int  # px
    width: int
    size: int  # px, side of a tile
    columns: int  # tiles in a row of them
    samples: int  # sub-pixels per side of a pixel
    margin: int  # px around a tile that its pixels' filter reads
    quality: float  # cells per sub-pixel and axis, at least


class Members(NamedTuple):
    """Which triangles touch which tile (compressed rows)."""

    start: Ints  # (tiles + 1,)
    triangle: Ints  # (M,) ascending in every tile


class Block(NamedTuple):
    """The sub-pixels of one tile with its margin, and what is needed to fill them."""

    left: float  # px
    top: float
    samples: int  # sub-pixels per side of a pixel
    triangles: Ints  # the tile's members
    owner: NDArray[np.int32]  # (R, C) the member that is seen; -1: none
    nearness: Doubles  # (R, C)
    total: Floats  # (R, C, 4) weighted red, green, blue and weight
    edge: Doubles  # (4, 5) of the triangle at hand: a point, a direction, the side that is inside
    polygon: Doubles  # (8, 2) px, the part of a triangle at hand
    spare: Doubles  # (8, 2)
    rim: Doubles  # (8, 2) texture coordinates of the polygon
    corner: Doubles  # (3, 2) of the triangle


@kernel
def new_block(tile: int, triangles: Ints, grid: Grid) -> Block:
    """An empty tile, without what lies beyond the frame and its margin."""
    left, top = tile % grid.columns * grid.size, tile // grid.columns * grid.size
    rows = (min(grid.size, grid.height - top) + 2 * grid.margin) * grid.samples
    columns = (min(grid.size, grid.width - left) + 2 * grid.margin) * grid.samples
    return Block(
        float(left - grid.margin),
        float(top - grid.margin),
        grid.samples,
        triangles,
        np.full((rows, columns), -1, np.int32),
        np.full((rows, columns), -np.inf),
        np.zeros((rows, columns, 4), np.float32),
        np.empty((4, 5)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((3, 2)),
    )


@kernel
def _within(value: float, least: int, most: int) -> int:
    """Whole number below a value, kept within bounds, whatever the value."""
    return math.floor(max(float(least), min(float(most), value)))


@kernel
def deal(surfaces: Surfaces, grid: Grid, position: Ints, triangle: Ints) -> None:
    """Write each tile's triangles from its `position` on, which moves to their end.

    With an empty `triangle` the positions move and nothing is written: that counts them.
    """
    last_row, last_column = len(position) // grid.columns - 1, grid.columns - 1
    margin, size = grid.margin, grid.size
    for n in range(len(surfaces.corners)):
        left, top, right, bottom = bounds(surfaces, n)
        left, top, right, bottom = left - margin, top - margin, right + margin, bottom + margin
        if right < 0.0 or bottom < 0.0 or left > grid.width or top > grid.height or left > right:
            continue
        first, last = _within(left / size, 0, last_column), _within(right / size, 0, last_column)
        start, end = _within(top / size, 0, last_row), _within(bottom / size, 0, last_row)
        for row in range(start, end + 1):
            for column in range(first, last + 1):
                tile = row * grid.columns + column
                if len(triangle) > 0:
                    triangle[position[tile]] = n
                position[tile] += 1


@kernel
def columns_within(block: Block, left: float, right: float) -> tuple[int, int]:
    """First and last column of the sub-pixels between two places, px."""
    last = block.owner.shape[1] - 1
    return (
        _within((left - block.left) * block.samples, 0, last + 1),
        _within((right - block.left) * block.samples, -1, last),
    )


@kernel
def span(surfaces: Surfaces, n: int, block: Block) -> tuple[int, int, int, int]:
    """First and last row, first and last column of the sub-pixels that a triangle may touch."""
    left, top, right, bottom = bounds(surfaces, n)
    first, last = columns_within(block, left, right)
    rows = block.owner.shape[0]
    return (
        _within((top - block.top) * block.samples, 0, rows),
        _within((bottom - block.top) * block.samples, -1, rows - 1),
        first,
        last,
    )


@kernel
def sample(block: Block, row: int, column: int) -> Place:
    """Where on screen a sub-pixel is tested for visibility.

    The samples' grid is turned a little, so that upright edges pass the samples of a pixel one by
    one and not by columns.
    """
    fine = 1.0 / block.samples
    return (
        block.left + (column + 0.25 + 0.5 * fine * (row % block.samples + 0.5)) * fine,
        block.top + (row + 0.75 - 0.5 * fine * (column % block.samples + 0.5)) * fine,
    )
