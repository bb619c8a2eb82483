"""Texels as elliptical Gaussians, or points where they are small: placed, then added to pixels.

A splat is a Gaussian around a texel, taken to the screen by the Jacobian J at the texel's center
and spread by a Gaussian there: its covariance is V = J V_r Jᵀ + V_h (Heckbert, Fundamentals of
Texture Mapping and Image Warping, 1989). With q the squared distance from the center in units of V,
it weighs |det J| exp(−q / 2) / (2π √det V) in the centers of pixels, as far as q ≤ `RIM`.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts, stamp
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import Counter, kernel, parallel_kernel, plays
from resample.engine.surfaces import (
    CURVE,
    HIGH,
    MASS,
    PEAK,
    REST,
    RIM,
    ROWS,
    SIDE,
    SLOPE,
    UNIT,
    WIDE,
    Ground,
    X,
    Y,
    add_splats,
    blurred_ellipse,
    longest_stretch,
)
from resample.types import Doubles, Floats, Single
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
from resample_texture.texels.kernels.placing import determinant
from resample_texture.texels.kernels.texels import Extract, fetch

MOST = 128  # texels along a side of a block
FEW = 4  # texels; a block of no more along each side is not split for being large on screen
LARGE = 1 << 14  # px²


class Shape(NamedTuple):
    """Width of splats, and threshold for points."""

    variance: float  # texels², of V_r along an axis
    filter_variance: float  # px², of V_h
    threshold: float  # px; a texel stretched by no more than this along any direction is a point
    nearest: float  # third homogeneous coordinate; texels nearer to the eye are left out
    taps: int  # px per side that a point meets


@kernel
def _form(
    line: Floats,
    n: int,
    place: tuple[Single, Single],
    along_u: tuple[Single, Single],
    along_v: tuple[Single, Single],
    mass: Single,
    shape: tuple[Single, Single, Single],
) -> None:
    """Fill in a splat by its place, the columns of J, |det J| and the first three of `Shape`."""
    variance, filter_variance, threshold = shape
    ellipse, both = blurred_ellipse(along_u, along_v, mass, variance, filter_variance)
    peak = np.float32(UNIT) * mass / math.sqrt(both)
    is_splat = longest_stretch(along_u, along_v) > threshold
    line[X, n], line[Y, n] = place
    line[WIDE, n] = math.sqrt(np.float32(RIM) * ellipse.wide)
    line[HIGH, n] = math.sqrt(np.float32(RIM) * ellipse.high)
    line[SLOPE, n], line[CURVE, n] = ellipse.slope, ellipse.curve
    line[REST, n] = np.float32(1) / ellipse.high
    line[PEAK, n] = peak if is_splat else np.float32(0)
    line[MASS, n] = mass


@kernel
def _widths(shape: Shape) -> tuple[Single, Single, Single]:
    return (
        np.float32(shape.variance),
        np.float32(shape.filter_variance),
        np.float32(shape.threshold),
    )


@kernel
def splat_on_plane(
    matrix: Doubles, block: Integers, bounds: Integers, row: int, shape: Shape, line: Floats
) -> None:
    """Place a row of a block's texels by a homography."""
    left, top = float(bounds[LEFT]), float(bounds[TOP])
    u, v = block[0, START] + 0.5, block[1, START] + row + 0.5
    # Rows of the matrix with the block's corner as origin: float32 then tells small fractions.
    xu, xv = matrix[0, 0] - left * matrix[2, 0], matrix[0, 1] - left * matrix[2, 1]
    yu, yv = matrix[1, 0] - top * matrix[2, 0], matrix[1, 1] - top * matrix[2, 1]
    x0 = np.float32(xu * u + xv * v + matrix[0, 2] - left * matrix[2, 2])
    y0 = np.float32(yu * u + yv * v + matrix[1, 2] - top * matrix[2, 2])
    d0 = np.float32(matrix[2, 0] * u + matrix[2, 1] * v + matrix[2, 2])
    a, b, c, d = np.float32(xu), np.float32(xv), np.float32(yu), np.float32(yv)
    du, dv = np.float32(matrix[2, 0]), np.float32(matrix[2, 1])
    area, nearest = np.float32(abs(determinant(matrix))), np.float32(shape.nearest)
    widths = _widths(shape)
    for n in range(block[0, LENGTH]):
        along = np.float32(n)
        depth = d0 + along * du
        inverse = np.float32(1) / depth
        x, y = (x0 + along * a) * inverse, (y0 + along * c) * inverse
        mass = area * inverse * inverse * inverse if depth >= nearest else np.float32(0)
        along_u = (a - x * du) * inverse, (c - y * du) * inverse
        along_v = (b - x * dv) * inverse, (d - y * dv) * inverse
        _form(line, n, (x, y), along_u, along_v, mass, widths)


@kernel
def slope(before: float, here: float, after: float) -> float:
    """Central difference, or one-sided where the other side has no place."""
    if math.isfinite(before):
        return 0.5 * (after - before) if math.isfinite(after) else here - before
    return after - here


@kernel
def splat_on_map(
    x: Doubles, y: Doubles, block: Integers, bounds: Integers, row: int, shape: Shape, line: Floats
) -> None:
    """Place a row of a block's texels by a map (H + 2, W + 2), which has one more on each side."""
    r = block[1, START] + row + 1
    widths = _widths(shape)
    for n in range(block[0, LENGTH]):
        c = block[0, START] + n + 1
        px, py = x[r, c], y[r, c]
        xu, yu = slope(x[r, c - 1], px, x[r, c + 1]), slope(y[r, c - 1], py, y[r, c + 1])
        xv, yv = slope(x[r - 1, c], px, x[r + 1, c]), slope(y[r - 1, c], py, y[r + 1, c])
        mass = abs(xu * yv - xv * yu)
        if math.isfinite(px + py + mass):
            place = np.float32(px - bounds[LEFT]), np.float32(py - bounds[TOP])
            along_u = np.float32(xu), np.float32(yu)
            along_v = np.float32(xv), np.float32(yv)
            _form(line, n, place, along_u, along_v, np.float32(mass), widths)
        else:
            line[PEAK, n], line[MASS, n] = np.float32(0), np.float32(0)


class Splatted(NamedTuple):
    """A source in blocks of whole texels."""

    plain: Floats  # (H, W, C) values of texels as points
    coefficient: Floats  # (H, W, C) and as splats
    edge: int
    channels: tuple[int, int]  # first of them and how many: 1 or 3
    matrix: Doubles  # (3, 3) source to target; taken where the map is empty
    map_x: Doubles  # (H + 2, W + 2) places of the texels' centers, with a margin of one
    map_y: Doubles
    axes: Integers  # (B, 2, 6) blocks
    shape: Shape


class Rows(NamedTuple):
    """Sources and scratch of rows of a block's texels."""

    batch: Batch
    splat: Floats  # (ROWS, N) of the engine's stamps
    values: Floats  # (channels, N) that splats have
    weight: Floats  # (SIDE²,) to work with
    as_point: Floats  # (channels, rows, N) of texels
    as_splat: Floats


@kernel
def _place_points(line: Floats, size: tuple[int, int], taps: int, batch: Batch) -> None:
    """Place the points of a row on pixels (width, height)."""
    width, height = size
    before = np.float32(0.5 * taps - 0.5)
    limit_x, limit_y = np.float32(width - taps + 1), np.float32(height - taps + 1)
    zero = np.float32(0)
    for n in range(line.shape[1]):
        x, y = line[X, n] - before, line[Y, n] - before
        is_in = (x >= zero) & (y >= zero) & (x < limit_x) & (y < limit_y)
        is_in &= line[PEAK, n] == zero
        column, row = (np.int32(x), np.int32(y)) if is_in else (np.int32(0), np.int32(0))
        batch.along_x[n] = x - np.float32(column)
        batch.along_y[n] = y - np.float32(row)
        batch.mass[n] = line[MASS, n] if is_in else zero
        batch.pixel[n] = row * width + column


@kernel
def _write_values(patch: Floats, row: int, line: Floats, is_sum: bool, values: Floats) -> None:
    """Values of a row of texels, per px² if they are totals."""
    for c in range(values.shape[0]):
        for n in range(values.shape[1]):
            values[c, n] = patch[c, row, n]
            if is_sum:
                values[c, n] = values[c, n] / line[MASS, n] if line[MASS, n] > 0 else np.float32(0)


@plays(begun, Splatted)
def _begun(source: Splatted, part: int) -> Rows:
    block, (first, channels) = source.axes[part], source.channels
    count, rows = block[0, LENGTH], block[1, LENGTH]
    no_totals, no_pad = np.empty((0, 0, 0, 0)), (0, 0)
    as_point = np.empty((channels, rows, count), np.float32)
    all_of_it = Extract(source.plain.shape[0], source.plain.shape[1], 0, 0, 1)
    fetch(source.plain, all_of_it, no_totals, block, no_pad, source.edge, as_point, first)
    as_splat = np.empty((channels, rows, count), np.float32)
    fetch(source.coefficient, all_of_it, no_totals, block, no_pad, source.edge, as_splat, first)
    return Rows(
        new_batch(channels, count),
        np.empty((ROWS, count), np.float32),
        np.empty((channels, count), np.float32),
        np.empty(SIDE * SIDE, np.float32),
        as_point,
        as_splat,
    )


@plays(lines, Splatted)
def _lines(source: Splatted, part: int) -> int:
    return int(source.axes[part, 1, LENGTH])


@plays(fill, Splatted)
def _fill(
    source: Splatted, part: int, line: int, box: Integers, spread: FilterTaps, work: Rows
) -> int:
    splat, shape = work.splat, source.shape
    if source.map_x.size > 0:
        splat_on_map(source.map_x, source.map_y, source.axes[part], box, line, shape, splat)
    else:
        splat_on_plane(source.matrix, source.axes[part], box, line, shape, splat)
    points, splats = 0, 0
    for n in range(splat.shape[1]):
        splats += splat[PEAK, n] > np.float32(0)
        points += (splat[PEAK, n] == np.float32(0)) & (splat[MASS, n] > np.float32(0))
    if splats > 0:
        _write_values(work.as_splat, line, splat, spread.is_sum, work.values)
    if points > 0:
        _write_values(work.as_point, line, splat, spread.is_sum, work.batch.values)
        size = box[RIGHT] - box[LEFT], box[BOTTOM] - box[TOP]
        _place_points(splat, size, spread.taps, work.batch)
    return int(splat.shape[1]) if points > 0 else 0


@plays(stamp, Rows)
def _stamp(work: Rows, ground: Ground) -> None:
    add_splats(ground, work.values, work.splat, work.splat.shape[1], work.weight)


@parallel_kernel
def splat_blocks(
    counter: Counter, source: Splatted, spread: FilterTaps, parts: SourceParts
) -> None:
    """Add the texels of every block to its own pixels."""
    paint_parts(counter, source, spread, parts)


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
    """Bounds on screen of all splats of texels with centers in a rectangle."""
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
    """Blocks of a plane with splats in a frame: axes (B, 2, 6), and bounds (B, 4), px.

    `lines`: (L, 3) around the centers of texels that can be seen; behind the last, J is unreliable.
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
    """Blocks of a source by a map (H + 2, W + 2), see `blocks_on_plane`."""
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
