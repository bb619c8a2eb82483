"""Which texels may leave a splat within a frame: blocks of whole texels."""

import math

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.jit import kernel
from resample.engine.surfaces.stamps import HIGH, MASS, RIM, ROWS, WIDE, X, Y
from resample.types import Doubles
from resample_texture.texels.kernels.blocks import (
    CUT,
    FIRST,
    LAST,
    LENGTH,
    LEVEL,
    START,
    TILE,
    Integers,
    beside,
    grown,
    projected,
)
from resample_texture.texels.kernels.splat_shapes import Shape, splat_on_map

MOST = 128  # texels along a side of a block
FEW = 4  # texels; a block of no more along each side is not split for being large on screen
LARGE = 1 << 14  # px²


@kernel
def _clip(box: Doubles, frame: tuple[int, int], margin: int, bounds: Integers) -> bool:
    """Whole pixels of the frame and its margin that a box on screen meets; False if none."""
    height, width = frame
    bounds[LEFT] = math.floor(max(box[LEFT], -margin))
    bounds[TOP] = math.floor(max(box[TOP], -margin))
    bounds[RIGHT] = math.ceil(min(box[RIGHT], width + margin))
    bounds[BOTTOM] = math.ceil(min(box[BOTTOM], height + margin))
    return bool(bounds[LEFT] < bounds[RIGHT]) and bool(bounds[TOP] < bounds[BOTTOM])


@kernel
def _box_on_plane(matrix: Doubles, u: Doubles, v: Doubles, shape: Shape, box: Doubles) -> None:
    """Bounds on screen of all splats whose texels have their centers in a rectangle."""
    box[:2], box[2:] = math.inf, -math.inf
    across, down, nearest = 0.0, 0.0, math.inf
    for corner in range(4):
        x, y, d = projected(matrix, u[corner % 2], v[corner // 2])
        box[LEFT], box[RIGHT] = min(box[LEFT], x), max(box[RIGHT], x)
        box[TOP], box[BOTTOM] = min(box[TOP], y), max(box[BOTTOM], y)
        # The rows of J are these, divided by d; they are largest in corners, as is 1 / d.
        a, b = matrix[0, 0] - x * matrix[2, 0], matrix[0, 1] - x * matrix[2, 1]
        across = max(across, a * a + b * b)
        a, b = matrix[1, 0] - y * matrix[2, 0], matrix[1, 1] - y * matrix[2, 1]
        down = max(down, a * a + b * b)
        nearest = min(nearest, d)
    share = shape.variance / (nearest * nearest)
    reach = max(float(shape.taps), math.sqrt(RIM * (share * across + shape.filter_variance)))
    box[LEFT] -= reach
    box[RIGHT] += reach
    reach = max(float(shape.taps), math.sqrt(RIM * (share * down + shape.filter_variance)))
    box[TOP] -= reach
    box[BOTTOM] += reach


@kernel
def _whole_block(rectangle: Integers, block: Integers) -> None:
    """Block of whole texels: first column and row, columns and rows."""
    for axis in range(2):
        block[axis, START], block[axis, LENGTH] = rectangle[axis], rectangle[2 + axis]
        block[axis, CUT], block[axis, LEVEL] = 1, 0
        block[axis, FIRST], block[axis, LAST] = 0, rectangle[2 + axis]


@kernel
def blocks_on_plane(
    matrix: Doubles, root: Integers, lines: Doubles, frame: tuple[int, int], shape: Shape
) -> tuple[Integers, Integers]:
    """Blocks of a plane under a homography whose splats a frame sees.

    Parameters
    ----------
    matrix
        (3, 3) source to target, positive third coordinate in front of the eye.
    root
        (4,) rectangle of the source: first column and row, width and height, texels.
    lines
        (L, 3) that bound the centers of texels that can be seen: the product with (u, v, 1) is
        negative beyond. Behind the last, J cannot be relied on.
    frame
        Height and width of the target, px.

    Returns
    -------
    The axes (B, 2, 6) of the blocks and what they may touch (B, 4): left, top, right, bottom, px;
    the last two are one beyond.
    """
    blocks, bounds, count = np.empty((256, 2, 6), np.int64), np.empty((256, 4), np.int64), 0
    stack = np.empty((256, 4), np.int64)
    u, v, box = np.empty(2), np.empty(2), np.empty(4)
    stack[0] = root
    depth = 1 if root[2] > 0 and root[3] > 0 else 0
    while depth > 0:
        top = depth - 1
        depth -= 1
        if top + 2 > stack.shape[0]:
            stack = grown(stack)
        u[0], u[1] = stack[top, 0] + 0.5, stack[top, 0] + stack[top, 2] - 0.5
        v[0], v[1] = stack[top, 1] + 0.5, stack[top, 1] + stack[top, 3] - 0.5
        is_unseen, is_cut = beside(lines, u, v)
        if is_unseen:
            continue
        axis = 2 if stack[top, 2] >= stack[top, 3] else 3
        longest = stack[top, axis]
        is_split = longest > MOST or is_cut
        if count == blocks.shape[0]:
            blocks, bounds = grown(blocks), grown(bounds)
        if not is_split:
            _box_on_plane(matrix, u, v, shape, box)
            if not _clip(box, frame, shape.taps, bounds[count]):
                continue
            width = bounds[count, RIGHT] - bounds[count, LEFT]
            height = bounds[count, BOTTOM] - bounds[count, TOP]
            is_split = longest > FEW and width * height > LARGE
        if is_split:
            half = 1
            while half * 2 < longest:
                half *= 2
            stack[top + 1] = stack[top]
            stack[top, axis] = half
            stack[top + 1, axis - 2] += half
            stack[top + 1, axis] -= half
            depth += 2
            continue
        _whole_block(stack[top], blocks[count])
        count += 1
    return blocks[:count], bounds[:count]


@kernel
def blocks_on_map(
    x: Doubles, y: Doubles, frame: tuple[int, int], shape: Shape
) -> tuple[Integers, Integers]:
    """Blocks of a source whose splats a frame sees; otherwise as `blocks_on_plane`.

    Parameters
    ----------
    x, y
        (H + 2, W + 2) places of the texels' centers, with a margin of one.
    """
    height, width = x.shape[0] - 2, x.shape[1] - 2
    tiles = (width + TILE - 1) // TILE, (height + TILE - 1) // TILE
    blocks = np.empty((tiles[0] * tiles[1], 2, 6), np.int64)
    bounds = np.empty((tiles[0] * tiles[1], 4), np.int64)
    line, box = np.empty((ROWS, TILE), np.float32), np.empty(4)
    rectangle, origin, count = np.empty(4, np.int64), np.zeros(4, np.int64), 0
    for tile in range(tiles[0] * tiles[1]):
        rectangle[0], rectangle[1] = tile % tiles[0] * TILE, tile // tiles[0] * TILE
        rectangle[2] = min(TILE, width - rectangle[0])
        rectangle[3] = min(TILE, height - rectangle[1])
        _whole_block(rectangle, blocks[count])
        box[:2], box[2:] = math.inf, -math.inf
        for row in range(rectangle[3]):
            splat_on_map(x, y, blocks[count], origin, row, shape, line)
            for n in range(rectangle[2]):
                if line[MASS, n] > 0:
                    wide = max(line[WIDE, n], shape.taps) + 0.5
                    high = max(line[HIGH, n], shape.taps) + 0.5
                    box[LEFT] = min(box[LEFT], line[X, n] - wide)
                    box[RIGHT] = max(box[RIGHT], line[X, n] + wide)
                    box[TOP] = min(box[TOP], line[Y, n] - high)
                    box[BOTTOM] = max(box[BOTTOM], line[Y, n] + high)
        count += _clip(box, frame, shape.taps, bounds[count])
    return blocks[:count], bounds[:count]
