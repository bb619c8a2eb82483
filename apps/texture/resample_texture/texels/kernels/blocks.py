"""Split and dice: blocks of the source, cut evenly into cells small on screen.

A *cell* is projected as one point: a texel, a part of one (where the texture is magnified)
or the mean of several (where it is minified strongly), per axis. All cells of a block are alike:
their values come from few phases of an interpolation, and one walk along a row places them.
The term is from Cook, Carpenter and Catmull, The Reyes Image Rendering Architecture, 1987.

A block is two rows of numbers, along u and along v: see `START` and those that follow.
"""

import math
from inspect import unwrap

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.jit import kernel
from resample.types import Doubles

Integers = NDArray[np.int64]

# Columns of a block's axis. FIRST and LAST count cells from START on; they leave some out only
# where a block is a part of one texel.
START, LENGTH, CUT, FIRST, LAST, LEVEL = range(6)
# While blocks are split, a part of one texel is the PART-th of 2^DEPTH.
PART, DEPTH = 2, 3

LARGEST = 128  # cells along a side of a block
UNEVEN = 1.5  # stretches within a block may differ by this factor
EVEN_ENOUGH = 16  # cells along an axis; so few are not split for being uneven
COARSEST = 40  # log₂ of the texels along a cell
FINEST = 20  # log₂ of the parts of a texel
# Rectangles that are visited at most to find the blocks of a plane: a number, and more per pixel.
MOST_SPLITS, PER_PIXEL = 1 << 18, 16
TILE = 32  # texels along a side of a block of a map, before it is split


# Scratch for the rectangle that is being split: first and last source coordinate, along u and v;
# least and most stretch per axis (2, 2); bounds (4,), px; cells per axis; and the block (2, 6).
Rectangle = tuple[Doubles, Doubles, Doubles, Doubles, Integers, Integers]


@kernel
def projected(matrix: Doubles, u: float, v: float) -> tuple[float, float, float]:
    """Target point of a source point, and its third homogeneous coordinate."""
    d = matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2]
    x = (matrix[0, 0] * u + matrix[0, 1] * v + matrix[0, 2]) / d
    y = (matrix[1, 0] * u + matrix[1, 1] * v + matrix[1, 2]) / d
    return x, y, d


@kernel
def stretch(matrix: Doubles, axis: int, x: float, y: float, d: float) -> float:
    """Length of a texel on screen, px, at target point (x, y); d as projected."""
    along_x = matrix[0, axis] - x * matrix[2, axis]
    along_y = matrix[1, axis] - y * matrix[2, axis]
    return math.hypot(along_x, along_y) / d


@kernel
def _span(rectangle: Integers, axis: int) -> tuple[float, float]:
    """First and last source coordinate of a rectangle that is being split."""
    # A part of one texel spans 2^-DEPTH of it, a larger rectangle whole texels.
    start, parts = float(rectangle[axis, START]), 2.0 ** rectangle[axis, DEPTH]
    part = rectangle[axis, PART]
    end = (
        start + (part + 1) / parts
        if rectangle[axis, DEPTH] > 0
        else start + rectangle[axis, LENGTH]
    )
    return start + part / parts, end


@kernel
def _split(stack: Integers, top: int, axis: int) -> bool:
    """Replace the rectangle on a stack by its halves; False if it is too small."""
    length, depth = stack[top, axis, LENGTH], stack[top, axis, DEPTH]
    # Give up on a texel that is cut as finely as numbers allow.
    if length == 1 and depth == FINEST:
        return False
    _copy(stack[top], stack[top + 1], stack.shape[2])
    # Cut whole texels at the largest power of two, so that later cuts stay aligned.
    if length > 1:
        half = 1
        while half * 2 < length:
            half *= 2
        _cut_off(stack, top, axis, half)
    # Halve a single texel.
    else:
        part = 2 * stack[top, axis, PART]
        stack[top : top + 2, axis, DEPTH] = depth + 1
        stack[top, axis, PART], stack[top + 1, axis, PART] = part, part + 1
    return True


@kernel
def _copy(source: Integers, target: Integers, count: int) -> None:
    """Copy the first `count` columns of each axis."""
    for axis in range(source.shape[0]):
        for n in range(count):
            target[axis, n] = source[axis, n]


@kernel
def _cut_off(stack: Integers, top: int, axis: int, length: int) -> None:
    """Shorten the rectangle on top of a stack and put the rest above it."""
    _copy(stack[top], stack[top + 1], stack.shape[2])
    stack[top, axis, LENGTH] = length
    stack[top + 1, axis, START] += length
    stack[top + 1, axis, LENGTH] -= length


@kernel
def beside(lines: Doubles, u: Doubles, v: Doubles) -> tuple[bool, bool]:
    """Whether a rectangle lies outside one of some lines, and whether the last one cuts it."""
    is_cut = False
    for line in range(lines.shape[0]):
        # Count the corners outside the line.
        beyond = 0
        for corner in range(4):
            value = lines[line, 0] * u[corner % 2] + lines[line, 1] * v[corner // 2]
            beyond += value + lines[line, 2] < 0.0
        # Cull the rectangle when one line has all corners outside.
        if beyond == 4:
            return True, False
        is_cut = beyond > 0
    return False, is_cut


@kernel
def view_bounds(matrix: Doubles, height: int, width: int, reach: float) -> Doubles:
    """Lines (5, 3) around the source that a frame, wider by `reach` px, sees; negative outside."""
    lines = np.empty((5, 3))
    for c in range(3):  # left, right, above, below and behind
        d = matrix[2, c]
        lines[0, c] = matrix[0, c] + reach * d
        lines[1, c] = (width + reach) * d - matrix[0, c]
        lines[2, c] = matrix[1, c] + reach * d
        lines[3, c] = (height + reach) * d - matrix[1, c]
        lines[4, c] = d
    return lines


def view_bounds_of(matrix: Doubles, frame: tuple[int, int], reach: float) -> Doubles:
    """Return `view_bounds` in plain Python, which is fast enough for five lines."""
    return np.asarray(unwrap(view_bounds)(matrix, *frame, reach))


@kernel
def _stretches(matrix: Doubles, u: Doubles, v: Doubles, ranges: Doubles, box: Doubles) -> bool:
    """Least and most stretch (2, 2) per axis, and bounds; False if a corner is behind the eye."""
    ranges[:, 0], ranges[:, 1] = math.inf, 0.0
    box[:2], box[2:] = math.inf, -math.inf
    # Project the corners; a homography takes its extremes there.
    for corner in range(4):
        x, y, d = projected(matrix, u[corner % 2], v[corner // 2])
        if not d > 0.0:
            return False
        # Grow the screen bounds.
        box[LEFT], box[RIGHT] = min(box[LEFT], x), max(box[RIGHT], x)
        box[TOP], box[BOTTOM] = min(box[TOP], y), max(box[BOTTOM], y)
        # Measure how long a texel is on screen, along u and v.
        for axis in range(2):
            length = stretch(matrix, axis, x, y, d)
            ranges[axis, 0] = min(ranges[axis, 0], length)
            ranges[axis, 1] = max(ranges[axis, 1], length)
    return True


@kernel
def _dice(rectangle: Integers, axis: int, length: float, quality: float, largest: float) -> int:
    """Turn an axis of a rectangle, of `length` px per texel, into a block's; count cells."""
    # Cut each texel into cells no longer than 1 / quality px.
    parts = 1 << rectangle[axis, DEPTH]
    cells = max(1, math.ceil(length * quality / parts - 1e-6))
    # Join texels, in powers of two, while the joined cell stays short enough.
    level, part, texels = 0, rectangle[axis, PART], rectangle[axis, LENGTH]
    while 2 << level <= texels and level < COARSEST and length * 2.0 ** (level + 1) <= largest:
        level += 1
    # Write the axis of the block.
    rectangle[axis, CUT] = cells * parts
    rectangle[axis, FIRST] = part * cells
    rectangle[axis, LAST] = (part + 1) * cells if parts > 1 else texels * cells >> level
    rectangle[axis, LEVEL] = level
    return int(rectangle[axis, LAST] - rectangle[axis, FIRST])


@kernel
def _longer(ranges: Doubles, cells: Integers) -> int:
    """Axis along which to split a block; -1 if it may stay whole."""
    axis = 0 if cells[0] >= cells[1] else 1
    # Split if there are too many cells.
    if cells[axis] > LARGEST:
        return axis
    # Split if cells are too uneven, as under strong perspective, and not few.
    for axis in range(2):
        if cells[axis] > EVEN_ENOUGH and ranges[axis, 1] > UNEVEN * ranges[axis, 0]:
            return 0 if cells[0] >= cells[1] else 1
    return -1


@kernel
def grown(array: Integers) -> Integers:
    """Return an array twice as long, with the same beginning."""
    more = np.empty((2 * array.shape[0], *array.shape[1:]), array.dtype)
    source, target = array.reshape(-1), more.reshape(-1)
    for n in range(source.size):
        target[n] = source[n]
    return more


@kernel
def _noted(
    found: tuple[Integers, Integers, int],
    block: Integers,
    box: Doubles,
    reach: float,
    frame: tuple[int, int],
) -> tuple[Integers, Integers, int]:
    """Append a block and its pixels to the list, if it meets the frame."""
    blocks, bounds, count = found
    # Grow the arrays when they are full.
    if count == blocks.shape[0]:
        blocks, bounds = grown(blocks), grown(bounds)
    # Bound whole pixels: a point that just touches the frame has its first tap 2 × reach outside.
    # Clamp in floating point first: bounds near the horizon are too large for an integer.
    height, width = frame
    margin = math.ceil(2.0 * reach)
    left = max(math.floor(max(box[LEFT], -1e9) - reach), -margin)
    top = max(math.floor(max(box[TOP], -1e9) - reach), -margin)
    right = min(math.ceil(min(box[RIGHT], 1e9) + reach) + 1, width + margin)
    bottom = min(math.ceil(min(box[BOTTOM], 1e9) + reach) + 1, height + margin)
    if left < right and top < bottom:
        bounds[count, LEFT], bounds[count, TOP] = left, top
        bounds[count, RIGHT], bounds[count, BOTTOM] = right, bottom
        _copy(block, blocks[count], block.shape[1])
        count += 1
    return blocks, bounds, count


@kernel
def _divided(
    matrix: Doubles,
    lines: Doubles,
    stack: Integers,
    top: int,
    cut: tuple[float, float],  # least cells per px, and the greatest length of a cell, px
    seen: Rectangle,
) -> int:
    """Split the rectangle on top of a stack; count what replaces it, or −1: it is a block."""
    u, v, ranges, box, cells, block = seen
    # Cull what lies outside the frame.
    u[0], u[1] = _span(stack[top], 0)
    v[0], v[1] = _span(stack[top], 1)
    if beside(lines, u, v)[0]:
        return 0
    # Halve what crosses the horizon, along its longer side.
    if not _stretches(matrix, u, v, ranges, box):
        return 2 * _split(stack, top, 0 if u[1] - u[0] >= v[1] - v[0] else 1)
    # Dice both axes by their largest stretch.
    _copy(stack[top], block, 4)
    for axis in range(2):
        cells[axis] = _dice(block, axis, ranges[axis, 1], cut[0], cut[1])
    # Split if cells are too many, or too uneven.
    axis = _longer(ranges, cells)
    if axis >= 0:
        return 2 * _split(stack, top, axis)
    # Cut off texels that fill no whole cell.
    for axis in range(2):
        rest = stack[top, axis, LENGTH] % (1 << block[axis, LEVEL])
        if rest:
            _cut_off(stack, top, axis, stack[top, axis, LENGTH] - rest)
            return 2
    return -1


@kernel
def split_plane(
    matrix: Doubles,
    roots: Integers,  # (R, 4) first column and row, width and height, texels
    frame: tuple[int, int],
    reach: float,  # of a point's filter, px
    quality: float,  # cells per px, at least
    largest: float,  # of a cell of several texels, px
) -> tuple[Integers, Integers, bool]:
    """Split a plane into the blocks that a frame shows: axes (B, 2, 6), and bounds (B, 4), px.

    Also return whether these are all: False if there are too many to visit.
    """
    # Prepare the frustum's lines, growing results, and a stack for a depth-first descent.
    height, width = frame
    left_over = MOST_SPLITS + PER_PIXEL * height * width  # rectangles that may be visited
    lines, cut = view_bounds(matrix, height, width, reach), (quality, largest)
    found = np.empty((256, 2, 6), np.int64), np.empty((256, 4), np.int64), 0
    stack = np.zeros((256, 2, 4), np.int64)
    block, box = np.empty((2, 6), np.int64), np.empty(4)
    seen = np.empty(2), np.empty(2), np.empty((2, 2)), box, np.empty(2, np.int64), block

    # Descend from each root.
    for root in range(roots.shape[0]):
        stack[0] = 0
        for axis in range(2):
            stack[0, axis, START], stack[0, axis, LENGTH] = roots[root, axis], roots[root, 2 + axis]
        depth = 1
        while depth > 0:
            # Stop at the visit limit: near a degenerate horizon the descent would not end.
            left_over -= 1
            if left_over < 0:
                return found[0][:0], found[1][:0], False
            top = depth - 1
            # A split needs one more place on the stack.
            if top + 2 > stack.shape[0]:
                stack = grown(stack)
            # Pop the rectangle, or replace it by its parts.
            more = _divided(matrix, lines, stack, top, cut, seen)
            depth = top + max(more, 0)
            if more < 0:
                found = _noted(found, block, box, reach, frame)
    blocks, bounds, count = found
    return blocks[:count], bounds[:count], True


@kernel
def _stretches_of_map(
    x: Doubles, y: Doubles, rectangle: Integers, ranges: Doubles, box: Doubles
) -> bool:
    """Return `_stretches` of a rectangle of a map; False if it has no places."""
    ranges[:, 0], ranges[:, 1] = math.inf, 0.0
    box[:2], box[2:] = math.inf, -math.inf
    column, row = rectangle[0, START], rectangle[1, START]
    for r in range(row, row + rectangle[1, LENGTH]):
        for c in range(column, column + rectangle[0, LENGTH]):
            # Skip texels without a place.
            if not (math.isfinite(x[r, c]) and math.isfinite(y[r, c])):
                continue
            # Grow the screen bounds by the texel's center.
            box[LEFT], box[RIGHT] = min(box[LEFT], x[r, c]), max(box[RIGHT], x[r, c])
            box[TOP], box[BOTTOM] = min(box[TOP], y[r, c]), max(box[BOTTOM], y[r, c])
            # Measure the distances to the neighbours along u and v.
            for axis in range(2):
                for side in (-1, 1):
                    q, p = r + side * (axis == 1), c + side * (axis == 0)
                    if 0 <= q < x.shape[0] and 0 <= p < x.shape[1]:
                        length = math.hypot(x[q, p] - x[r, c], y[q, p] - y[r, c])
                        if math.isfinite(length):
                            ranges[axis, 0] = min(ranges[axis, 0], length)
                            ranges[axis, 1] = max(ranges[axis, 1], length)
    # Widen the bounds from the centers of texels to their outlines, with a margin.
    half = ranges[0, 1] + ranges[1, 1]
    box[:2] -= half
    box[2:] += half
    return bool(box[LEFT] <= box[RIGHT])


@kernel
def split_map(
    x: Doubles, y: Doubles, frame: tuple[int, int], reach: float, quality: float
) -> tuple[Integers, Integers]:
    """Split a source by a map with the texels' places (H, W); otherwise as `split_plane`."""
    height, width = frame
    rows, columns = x.shape

    # Prepare growing results and a stack.
    found = np.empty((256, 2, 6), np.int64), np.empty((256, 4), np.int64), 0
    stack = np.zeros((256, 2, 4), np.int64)
    ranges, box = np.empty((2, 2)), np.empty(4)
    block, cells = np.empty((2, 6), np.int64), np.empty(2, np.int64)

    # Descend from each tile of the map.
    tiles = (columns + TILE - 1) // TILE
    for tile in range(tiles * ((rows + TILE - 1) // TILE)):
        stack[0] = 0
        stack[0, 0, START], stack[0, 1, START] = tile % tiles * TILE, tile // tiles * TILE
        stack[0, 0, LENGTH] = min(TILE, columns - stack[0, 0, START])
        stack[0, 1, LENGTH] = min(TILE, rows - stack[0, 1, START])
        depth = 1
        while depth > 0:
            top = depth - 1
            depth -= 1
            # Cull rectangles without a place, or outside the frame.
            if not _stretches_of_map(x, y, stack[top], ranges, box):
                continue
            if (
                box[RIGHT] < -reach
                or box[BOTTOM] < -reach
                or box[LEFT] > width + reach
                or box[TOP] > height + reach
            ):
                continue
            # Dice both axes; texels of a map are not joined.
            _copy(stack[top], block, 4)
            for axis in range(2):
                cells[axis] = _dice(block, axis, ranges[axis, 1], quality, 0.0)
            # Split blocks with too many or too uneven cells, down to single texels.
            axis = _longer(ranges, cells)
            if axis >= 0 and stack[top, axis, LENGTH] > 1:
                depth += 2 * _split(stack, top, axis)
                continue
            found = _noted(found, block, box, reach, frame)
    blocks, bounds, count = found
    return blocks[:count], bounds[:count]
