"""A tile's sub-pixels, and the surfaces that show there one behind the other."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.types import Floats, Single, Tiles

FULL: Single = np.float32(1 - 1e-3)  # coverage beyond which nothing shows through

# Lanes of the surface at hand: three weighted channels, weight, weighted nearness and coverage.
WEIGHT, NEAR, COVER = 3, 4, 5
# Lanes of what is seen: three channels, coverage, coverage × depth, nearness of the first surface.
DEPTH, FIRST = 4, 5
LANES = 6


class Surfaces(NamedTuple):
    """How many surfaces show one behind the other, and on how many sub-pixels."""

    most: int  # surfaces
    subpixels: int  # per side of a pixel


class Block(NamedTuple):
    """The sub-pixels of one tile."""

    left: int  # px
    top: int  # px
    subpixels: int  # per side of a pixel
    floor: Floats  # (R, C) nearness by which a batch tells what belongs to the surface in front
    limit: Floats  # (R, C) nearness below which the next surface is looked for; 0: full
    sums: Floats  # (R, C, LANES) over the surface at hand
    visible: Floats  # (R, C, LANES)
    box: NDArray[np.int64]  # (4,) first and last row, first and last column that are not full
    step: NDArray[np.int64]  # (1,) of the sub-pixels of a row, one in how many is used


@kernel
def new_block(tile: int, tiles: Tiles, size: tuple[int, int], surfaces: Surfaces) -> Block:
    """An empty tile of a frame (height, width), without what lies beyond."""
    row, column = divmod(int(np.int64(tile)), tiles.columns)
    left, top, fine = column * tiles.size, row * tiles.size, surfaces.subpixels
    rows, columns = min(tiles.size, size[0] - top) * fine, min(tiles.size, size[1] - left) * fine
    return Block(
        left,
        top,
        fine,
        np.zeros((rows, columns), np.float32),
        np.full((rows, columns), np.inf, np.float32),
        np.zeros((rows, columns, LANES), np.float32),
        np.zeros((rows, columns, LANES), np.float32),
        np.array([0, rows - 1, 0, columns - 1]),
        np.ones(1, np.int64),
    )


@kernel
def whole_within(value: float, least: int, most: int) -> int:
    """Whole number below a value, kept within bounds, whatever the value."""
    return math.floor(max(float(least), min(float(most), value)))


@kernel
def row_shift(row: int, subpixels: int) -> float:
    """How far a row of sub-pixels is moved to the right, sub-pixels.

    So upright edges pass the samples of a pixel one by one and not by columns.
    """
    return (row % subpixels + 0.5) / subpixels - 0.5


@kernel
def first_used(block: Block, row: int, column: int) -> int:
    """First column from one on that is used; few of a pixel are the corners of a turned square."""
    step = block.step[0]
    if step == 1:
        return column
    used = (2 * (row % step) + 1) % (step + 1)
    return int(column + (used - column % step) % step)


@kernel
def put_behind(block: Block, surface: int, surfaces: Surfaces) -> bool:
    """Put the surface at hand behind those before; gives whether another may show through."""
    floor, limit, sums, seen, box = block.floor, block.limit, block.sums, block.visible, block.box
    rows, columns = floor.shape
    top, bottom, left, right = rows, -1, columns, -1
    one, is_last = np.float32(1), surface + 1 == surfaces.most
    for row in range(box[0], box[1] + 1):
        for column in range(first_used(block, row, box[2]), box[3] + 1, block.step[0]):
            weight = sums[row, column, WEIGHT]
            if weight > 0:
                room = one - seen[row, column, 3]
                cover = room * min(one, sums[row, column, COVER])
                share = cover / weight
                seen[row, column, 0] += share * sums[row, column, 0]
                seen[row, column, 1] += share * sums[row, column, 1]
                seen[row, column, 2] += share * sums[row, column, 2]
                seen[row, column, 3] += cover
                near = sums[row, column, NEAR] / weight
                seen[row, column, DEPTH] += cover / near
                if seen[row, column, FIRST] == 0:
                    seen[row, column, FIRST] = near
            if is_last:
                continue
            # Found behind a full sub-pixel, or nothing at all: nothing more to come.
            is_open = seen[row, column, 3] < FULL and floor[row, column] > 0
            limit[row, column] = floor[row, column] if is_open else np.float32(0)
            if is_open:
                top, bottom = min(top, row), max(bottom, row)
                left, right = min(left, column), max(right, column)
    if is_last or bottom < 0:
        return False
    box[0], box[1], box[2], box[3] = top, bottom, left, right
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            floor[row, column] = 0
            for k in range(sums.shape[2]):
                sums[row, column, k] = 0
    return True
