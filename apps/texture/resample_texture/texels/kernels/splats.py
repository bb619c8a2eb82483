"""Texels as elliptical Gaussians, or points where they are small: placed, then added to pixels.

A splat is a Gaussian around a texel, taken to the screen by the Jacobian J at the texel's center
and spread by a Gaussian there: its covariance is V = J V_r Jᵀ + V_h (Heckbert, Fundamentals of
Texture Mapping and Image Warping, 1989). With q the squared distance from the center in units of V,
it weighs |det J| exp(−q / 2) / (2π √det V) in the centers of pixels, as far as q ≤ `RIM`.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.batch import Batch
from resample.engine.cells.taps import add_points
from resample.engine.cells.tiles import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.surfaces.stamps import MASS, PEAK, ROWS, SIDE, Ground, X, Y, add_splats
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import LENGTH, Integers
from resample_texture.texels.kernels.splat_shapes import Shape, splat_on_map, splat_on_plane
from resample_texture.texels.kernels.texels import fetch


class Splatted(NamedTuple):
    """A source in blocks of whole texels, and where they show."""

    plain: Floats  # (H, W, C) values of texels as points
    coefficient: Floats  # (H, W, C) and as splats
    edge: int
    channels: tuple[int, int]  # first of them and how many: 1 or 3
    matrix: Doubles  # (3, 3) source to target; taken where the map is empty
    map_x: Doubles  # (H + 2, W + 2) places of the texels' centers, with a margin of one
    map_y: Doubles
    axes: Integers  # (B, 2, 6) blocks
    bounds: Integers  # (B, 4) px they may touch


@kernel
def _add_points(ground: Ground, values: Floats, line: Floats, count: int, profile: Floats) -> None:
    """Add those of a row that are points to the pixels of a block."""
    sums, start, width, height = ground
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
    batch = Batch(pixel, along_x, along_y, mass, values)
    add_points(sums, start, width, batch, count, profile)


@kernel
def _values(patch: Floats, row: int, line: Floats, is_sum: bool, values: Floats) -> None:
    """Values of a row of texels, per px² if they are totals."""
    for c in range(values.shape[0]):
        for n in range(values.shape[1]):
            values[c, n] = patch[c, row, n]
            if is_sum:
                values[c, n] = values[c, n] / line[MASS, n] if line[MASS, n] > 0 else np.float32(0)


@kernel
def _splat_block(source: Splatted, n: int, profile: Floats, shape: Shape, ground: Ground) -> None:
    """Add all texels of one block to its pixels."""
    block, bounds = source.axes[n], source.bounds[n]
    first, channel_count = source.channels
    for k in range(ground.start, ground.start + ground.width * ground.height * (channel_count + 1)):
        ground.sums[k] = np.float32(0)
    count, rows = block[0, LENGTH], block[1, LENGTH]
    no_totals, no_pad = np.empty((0, 0, 0, 0)), (0, 0)
    patch = np.empty((channel_count, rows, count), np.float32)
    fetch(source.coefficient, no_totals, block, no_pad, source.edge, patch, first)
    as_points = np.empty((channel_count, rows, count), np.float32)
    fetch(source.plain, no_totals, block, no_pad, source.edge, as_points, first)
    line = np.empty((ROWS, count), np.float32)
    values = np.empty((channel_count, count), np.float32)
    weight = np.empty(SIDE * SIDE, np.float32)
    for row in range(rows):
        if source.map_x.size > 0:
            splat_on_map(source.map_x, source.map_y, block, bounds, row, shape, line)
        else:
            splat_on_plane(source.matrix, block, bounds, row, shape, line)
        points, splats = 0, 0
        for k in range(count):
            splats += line[PEAK, k] > np.float32(0)
            points += (line[PEAK, k] == np.float32(0)) & (line[MASS, k] > np.float32(0))
        if splats > 0:
            _values(patch, row, line, shape.is_sum, values)
            add_splats(ground, values, line, count, weight)
        if points > 0:
            _values(as_points, row, line, shape.is_sum, values)
            _add_points(ground, values, line, count, profile)


@parallel_kernel
def splat_blocks(
    counter: Counter, source: Splatted, profile: Floats, shape: Shape, start: Integers, sums: Floats
) -> None:
    """Add the texels of every block to pixels of its own.

    Parameters
    ----------
    profile
        (PHASES, T) weights of the point filter by phase.
    start
        (B + 1,) where the sums of each block begin.
    sums
        Space for all blocks' pixels, interleaved channels and weight.
    """
    for n in tasks(counter, source.axes.shape[0]):
        box = source.bounds[n]
        ground = Ground(sums, start[n], box[RIGHT] - box[LEFT], box[BOTTOM] - box[TOP])
        _splat_block(source, n, profile, shape, ground)
