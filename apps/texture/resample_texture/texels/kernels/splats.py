"""Texels as elliptical Gaussians, or points where they are small: placed, then added to pixels.

A splat is a Gaussian around a texel, taken to the screen by the Jacobian J at the texel's center
and spread by a Gaussian there: its covariance is V = J V_r Jᵀ + V_h (Heckbert, Fundamentals of
Texture Mapping and Image Warping, 1989). With q the squared distance from the center in units of V,
it weighs |det J| exp(−q / 2) / (2π √det V) in the centers of pixels, as far as q ≤ `RIM`.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats, Single
from resample_texture.texels.kernels.adding import add_points_color, add_points_gray
from resample_texture.texels.kernels.blocks import (
    BOTTOM,
    LEFT,
    LENGTH,
    RIGHT,
    TOP,
    Integers,
)
from resample_texture.texels.kernels.splat_shapes import (
    CURVE,
    HIGH,
    MASS,
    PEAK,
    REST,
    RIM,
    ROWS,
    SLOPE,
    WIDE,
    Shape,
    X,
    Y,
    splat_on_map,
    splat_on_plane,
)
from resample_texture.texels.kernels.texels import fetch

# exp(−z) as a polynomial, for 0 ≤ z ≤ RIM / 32; errs by 8e-8 of the value at most.
LAST_Z = np.float32(RIM / 32.0)
C0, C1, C2 = np.float32(0.99999992), np.float32(-0.99998921), np.float32(0.49975581)
C3, C4 = np.float32(-0.16469862), np.float32(0.035043686)

# A splat is weighed in stamps of up to SIDE × SIDE pixels, in one loop over all of them:
# pixel n of a stamp w pixels wide is in column ACROSS[w, n] and row DOWN[w, n].
SIDE = 16  # px
_PIXEL, _WIDTH = np.arange(SIDE * SIDE), np.maximum(np.arange(SIDE + 1), 1)[:, None]
ACROSS = (_PIXEL % _WIDTH).astype(np.float32)
DOWN = (_PIXEL // _WIDTH).astype(np.float32)


@kernel
def _bell(z: Single) -> Single:
    """exp(−16 z), for z up to RIM / 32; errs by 3e-6 of the value at most."""
    power = C0 + z * (C1 + z * (C2 + z * (C3 + z * C4)))
    power *= power
    power *= power
    power *= power
    return power * power


@kernel
def _first_pixel(bound: Single) -> int:
    """First pixel whose center is not before a bound."""
    return math.ceil(float(max(bound - np.float32(0.5), np.float32(0))))


@kernel
def _last_pixel(bound: Single, size: int) -> int:
    """One past the last of `size` pixels whose center is not after a bound."""
    return math.floor(float(min(bound + np.float32(0.5), np.float32(size))))


@kernel
def _weigh(
    weight: Floats, count: int, width: int, x: Single, y: Single, line: Floats, splat: int
) -> None:
    """Weights of the `count` pixels of a stamp whose first center is at (x, y) from a splat's."""
    scale = np.float32(1.0 / 32.0)
    slope, peak = line[SLOPE, splat], line[PEAK, splat]
    curve, rest = line[CURVE, splat] * scale, line[REST, splat] * scale
    for n in range(count):
        m = np.uint64(n)
        below = y + DOWN[width, m]
        across = x + ACROSS[width, m] - slope * below
        z = curve * across * across + rest * below * below
        full = peak * _bell(min(z, LAST_Z))
        weight[m] = full if z <= LAST_Z else np.float32(0)


@kernel
def _add_stamp(
    sums: Floats,
    at: int,
    stride: int,
    weight: Floats,
    size: tuple[int, int],
    values: Floats,
    n: int,
) -> None:
    """Add a stamp of weights to the pixels from `at` on."""
    width, height = size
    lanes = values.shape[0] + 1
    from_weight = np.uint64(0)
    if lanes == 2:
        value = values[0, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                sums[to + m + m] += share * value
                sums[to + m + m + np.uint64(1)] += share
            from_weight += np.uint64(width)
    else:
        red, green, blue = values[0, n], values[1, n], values[2, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                i = to + np.uint64(4) * m
                j, k, o = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
                sums[i] += share * red
                sums[j] += share * green
                sums[k] += share * blue
                sums[o] += share
            from_weight += np.uint64(width)


@kernel
def _add_splats(
    sums: Floats,
    start: int,
    size: tuple[int, int],
    values: Floats,
    line: Floats,
    count: int,
    weight: Floats,
) -> None:
    """Add a row of splats to the pixels (width, height) of a block."""
    width, height = size
    lanes = values.shape[0] + 1
    half = np.float32(0.5)
    for n in range(count):
        if not line[PEAK, n] > np.float32(0):
            continue
        x, y = line[X, n], line[Y, n]
        leftmost = _first_pixel(x - line[WIDE, n])
        rightmost = _last_pixel(x + line[WIDE, n], width)
        last = _last_pixel(y + line[HIGH, n], height)
        for top in range(_first_pixel(y - line[HIGH, n]), last, SIDE):
            bottom = min(top + SIDE, last)
            dy = np.float32(top) + half - y
            left, right = leftmost, rightmost
            if right - left > SIDE:
                left, right = _columns(line, n, dy, bottom - top, left, right)
            for column in range(left, right, SIDE):
                wide, high = min(SIDE, right - column), bottom - top
                _weigh(weight, wide * high, wide, np.float32(column) + half - x, dy, line, n)
                at = start + (top * width + column) * lanes
                _add_stamp(sums, at, width * lanes, weight, (wide, high), values, n)


@kernel
def _columns(line: Floats, n: int, dy: Single, rows: int, left: int, right: int) -> tuple[int, int]:
    """First and last + 1 of the columns that a splat may meet in some rows from `dy` below it."""
    half = math.sqrt(np.float32(RIM) / line[CURVE, n])
    first = line[X, n] + line[SLOPE, n] * dy
    last = first + line[SLOPE, n] * np.float32(rows - 1)
    return (
        max(left, _first_pixel(min(first, last) - half)),
        _last_pixel(max(first, last) + half, right),
    )


@kernel
def _add_points(
    sums: Floats,
    start: int,
    size: tuple[int, int],
    values: Floats,
    line: Floats,
    count: int,
    profile: Floats,
) -> None:
    """Add those of a row that are points to the pixels (width, height) of a block."""
    width, height = size
    taps = profile.shape[1]
    before = np.float32(0.5 * taps - 0.5)
    limit_x, limit_y = np.float32(width - taps + 1), np.float32(height - taps + 1)
    pixel, mass = np.empty(count, np.int32), np.empty(count, np.float32)
    along_x, along_y = np.empty(count, np.float32), np.empty(count, np.float32)
    zero = np.float32(0)
    for n in range(count):
        x, y = line[X, n] - before, line[Y, n] - before
        is_in = (x >= zero) & (y >= zero) & (x < limit_x) & (y < limit_y)
        is_in &= line[PEAK, n] == zero
        column, row = (np.int32(x), np.int32(y)) if is_in else (np.int32(0), np.int32(0))
        along_x[n] = x - np.float32(column)
        along_y[n] = y - np.float32(row)
        mass[n] = line[MASS, n] if is_in else zero
        pixel[n] = row * width + column
    if values.shape[0] == 1:
        add_points_gray(sums, start, width, values, pixel, along_x, along_y, mass, profile)
    else:
        add_points_color(sums, start, width, values, pixel, along_x, along_y, mass, profile)


@kernel
def _values(patch: Floats, row: int, line: Floats, is_sum: bool, values: Floats) -> None:
    """Values of a row of texels, per px² if they are totals."""
    for c in range(values.shape[0]):
        for n in range(values.shape[1]):
            values[c, n] = patch[c, row, n]
            if is_sum:
                values[c, n] = values[c, n] / line[MASS, n] if line[MASS, n] > 0 else np.float32(0)


@kernel
def _splat_block(
    plain: Floats,
    coefficient: Floats,
    edge: int,
    channels: tuple[int, int],
    matrix: Doubles,
    map_x: Doubles,
    map_y: Doubles,
    block: Integers,
    bounds: Integers,
    profile: Floats,
    shape: Shape,
    start: int,
    sums: Floats,
) -> None:
    """Add all texels of one block to its pixels, from `start` on."""
    first, channel_count = channels
    size = bounds[RIGHT] - bounds[LEFT], bounds[BOTTOM] - bounds[TOP]
    for n in range(start, start + size[0] * size[1] * (channel_count + 1)):
        sums[n] = np.float32(0)
    count, rows = block[0, LENGTH], block[1, LENGTH]
    no_totals, no_pad = np.empty((0, 0, 0, 0)), (0, 0)
    patch = np.empty((channel_count, rows, count), np.float32)
    fetch(coefficient, no_totals, block, no_pad, edge, patch, first)
    as_points = np.empty((channel_count, rows, count), np.float32)
    fetch(plain, no_totals, block, no_pad, edge, as_points, first)
    line = np.empty((ROWS, count), np.float32)
    values = np.empty((channel_count, count), np.float32)
    weight = np.empty(SIDE * SIDE, np.float32)
    for row in range(rows):
        if map_x.size > 0:
            splat_on_map(map_x, map_y, block, bounds, row, shape, line)
        else:
            splat_on_plane(matrix, block, bounds, row, shape, line)
        points, splats = 0, 0
        for n in range(count):
            splats += line[PEAK, n] > np.float32(0)
            points += (line[PEAK, n] == np.float32(0)) & (line[MASS, n] > np.float32(0))
        if splats > 0:
            _values(patch, row, line, shape.is_sum, values)
            _add_splats(sums, start, size, values, line, count, weight)
        if points > 0:
            _values(as_points, row, line, shape.is_sum, values)
            _add_points(sums, start, size, values, line, count, profile)


@parallel_kernel
def splat_blocks(
    counter: Counter,
    plain: Floats,
    coefficient: Floats,
    edge: int,
    channels: tuple[int, int],
    matrix: Doubles,
    map_x: Doubles,
    map_y: Doubles,
    axes: Integers,
    bounds: Integers,
    profile: Floats,
    shape: Shape,
    start: Integers,
    sums: Floats,
) -> None:
    """Add the texels of every block to pixels of its own.

    Parameters
    ----------
    plain, coefficient
        (H, W, C) values of texels as points and as splats.
    channels
        First of them and how many: 1 or 3.
    matrix
        (3, 3) source to target; taken where the map is empty.
    map_x, map_y
        (H + 2, W + 2) places of the texels' centers, with a margin of one.
    axes, bounds
        (B, 2, 6) and (B, 4) blocks, of whole texels.
    profile
        (PHASES, T) weights of the point filter by phase.
    start
        (B + 1,) where the sums of each block begin.
    sums
        Space for all blocks' pixels, interleaved channels and weight.
    """
    for n in tasks(counter, axes.shape[0]):
        _splat_block(
            plain,
            coefficient,
            edge,
            channels,
            matrix,
            map_x,
            map_y,
            axes[n],
            bounds[n],
            profile,
            shape,
            start[n],
            sums,
        )
