"""Texels as elliptical Gaussians, or points where they are small: placed, then added to pixels.

A splat is a Gaussian around a texel, taken to the screen by the Jacobian J at the texel's center
and spread by a Gaussian there: its covariance is V = J V_r Jᵀ + V_h (Heckbert, Fundamentals of
Texture Mapping and Image Warping, 1989). With q the squared distance from the center in units of V,
it weighs |det J| exp(−q / 2) / (2π √det V) in the centers of pixels, as far as q ≤ `RIM`.
"""

from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.cells.boxes import Batch, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts, stamp
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import Counter, kernel, parallel_kernel
from resample.engine.roles import plays
from resample.engine.surfaces.stamps import MASS, PEAK, ROWS, SIDE, Ground, X, Y, add_splats
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import LENGTH, Integers
from resample_texture.texels.kernels.splat_shapes import Shape, splat_on_map, splat_on_plane
from resample_texture.texels.kernels.texels import Extract, fetch


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
    """What rows of a block's texels are made of and with."""

    batch: Batch
    splat: Floats  # (ROWS, N) of the engine's stamps
    values: Floats  # (channels, N) that splats have
    weight: Floats  # (SIDE²,) to work with
    as_point: Floats  # (channels, rows, N) of texels
    as_splat: Floats


@kernel
def _place_points(line: Floats, size: tuple[int, int], taps: int, batch: Batch) -> None:
    """Place those of a row that are points on pixels (width, height)."""
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
    """Add the texels of every block to pixels of its own."""
    paint_parts(counter, source, spread, parts)
