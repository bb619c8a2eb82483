"""Blocks of texels as parts of a source: placing their cells on screen, and adding them to pixels.

Places are in pixels from the top left corner of the block's own pixels.
For the area filter a cell is a box as wide as its projection along x and y (√(a² + b²) of its two
sides); it meets 2 × 2 pixels.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, beyond, length, new_batch
from resample.engine.cells.parts import SourceParts, begun, fill, lines, paint_parts
from resample.engine.cells.taps import FilterTaps
from resample.engine.jit import Counter, inner_kernel, parallel_kernel, plays
from resample.types import Doubles, Floats, Single
from resample_texture.texels.kernels.blocks import CUT, START, Integers
from resample_texture.texels.kernels.texels import (
    Extract,
    cell_offsets,
    extents,
    fetch,
    filter_row,
    filter_rows,
    kind_of,
    line_at,
    line_count,
    parts_along,
    texels_along,
)

Triple = tuple[Single, Single, Single]

SMALLEST: Single = np.float32(1e-5)  # px; keeps divisions finite


class TexelMapping(NamedTuple):
    """Mapping of texels: by a homography, or by a map unless it is empty."""

    matrix: Doubles  # (3, 3) source to target
    x: Doubles  # (H + 2, W + 2) places of the texels' centers, with a margin of one
    y: Doubles


class Walk(NamedTuple):
    """A row of cells under a homography, in homogeneous coordinates."""

    start: Triple
    step: Triple  # from a texel to the next
    side_a: Triple  # of a cell, still to be divided by d; likewise `side_b`
    side_b: Triple
    area: Single  # px² that a cell covers, times d³
    limits: tuple[Single, Single]  # px; first pixels lie before
    width: int  # px, of the block's pixels


@inner_kernel
def _raster_of(
    block: Integers, box: Integers, taps: int
) -> tuple[float, float, int, int, int, float, float]:
    """Left, top and width of a block, px; ends of first pixels; sizes of a cell, texels."""
    width, height = box[RIGHT] - box[LEFT], box[BOTTOM] - box[TOP]
    size_u, _ = extents(block, 0)
    size_v, _ = extents(block, 1)
    # Keep the first pixel of a cell so far from the border that all its taps fit.
    beside = max(2, taps) - 1
    left, top = float(box[LEFT]), float(box[TOP])
    return left, top, width, width - beside, height - beside, size_u, size_v


@inner_kernel
def place(
    geometry: TexelMapping,
    block: Integers,
    box: Integers,  # (4,) pixels that the block may meet
    v: float,  # of the row
    offset: Floats,  # (N,) of the cells along u, texels from the block's start
    taps: int,
    batch: Batch,
) -> None:
    """Place a row of cells on screen: fill the batch but for the values."""
    if geometry.x.size > 0:
        _place_on_map(geometry.x, geometry.y, block, box, v, offset, taps, batch)
        return
    walk = _walk(geometry.matrix, block, box, v, taps)
    if taps == 0:
        _place_boxes(walk, offset, batch)
    else:
        _place_points(walk, offset, taps, batch)


@inner_kernel
def _walk(matrix: Doubles, block: Integers, box: Integers, v: float, taps: int) -> Walk:
    """Set up the walk along a row of a block's cells under a homography."""
    left, top, width, right, bottom, size_u, size_v = _raster_of(block, box, taps)
    u = float(block[0, START])
    # Make the block's corner the origin, so that float32 resolves small fractions.
    xu, xv = matrix[0, 0] - left * matrix[2, 0], matrix[0, 1] - left * matrix[2, 1]
    yu, yv = matrix[1, 0] - top * matrix[2, 0], matrix[1, 1] - top * matrix[2, 1]
    du, dv = matrix[2, 0], matrix[2, 1]
    # Bundle start, step along the row, the cell's two sides, its area times d³, and the limits.
    return Walk(
        (
            np.float32(xu * u + xv * v + matrix[0, 2] - left * matrix[2, 2]),
            np.float32(yu * u + yv * v + matrix[1, 2] - top * matrix[2, 2]),
            np.float32(du * u + dv * v + matrix[2, 2]),
        ),
        (np.float32(xu), np.float32(yu), np.float32(du)),
        (np.float32(xu * size_u), np.float32(yu * size_u), np.float32(du * size_u)),
        (np.float32(xv * size_v), np.float32(yv * size_v), np.float32(dv * size_v)),
        np.float32(abs(determinant(matrix)) * size_u * size_v),
        (np.float32(right), np.float32(bottom)),
        width,
    )


@inner_kernel
def _place_boxes(walk: Walk, offset: Floats, batch: Batch) -> None:
    """Place cells as boxes around their projections, branch-free and in float32, for SIMD."""
    one, zero, half = np.float32(1), np.float32(0), np.float32(0.5)
    pixel, along_x, along_y, mass, _ = batch
    (x0, y0, d0), (x_step, y_step, d_step) = walk.start, walk.step
    (xa, ya, da), (xb, yb, db) = walk.side_a, walk.side_b
    x_limit, y_limit = walk.limits
    area, stride = walk.area, np.int32(walk.width)
    for n in range(offset.size):
        # Divide by d, once per cell.
        along = offset[n]
        inverse = one / (d0 + along * d_step)
        x = (x0 + along * x_step) * inverse
        y = (y0 + along * y_step) * inverse
        # Differentiate for the projected sides, and take the box around them, at most a pixel wide.
        ax, bx = (xa - x * da) * inverse, (xb - x * db) * inverse
        ay, by = (ya - y * da) * inverse, (yb - y * db) * inverse
        across = min(length(ax, bx) + SMALLEST, one)
        down = min(length(ay, by) + SMALLEST, one)
        # Move from the box's center to its top left corner.
        x -= half * across
        y -= half * down
        # Drop cells outside the block's pixels or behind the camera: their mass becomes 0.
        is_in = (x >= zero) & (y >= zero) & (x < x_limit) & (y < y_limit) & (inverse > zero)
        column, row = np.int32(x), np.int32(y)
        # Split the box between the pixel it starts in and the next, along both axes.
        right, below = beyond(x, across, np.float32(column)), beyond(y, down, np.float32(row))
        along_x[n] = right if is_in else zero
        along_y[n] = below if is_in else zero
        mass[n] = area * inverse * inverse * inverse if is_in else zero
        pixel[n] = row * stride + column if is_in else np.int32(0)


@inner_kernel
def _place_points(walk: Walk, offset: Floats, taps: int, batch: Batch) -> None:
    """Place cells as points, by the first of the `taps` pixels along each axis."""
    one, zero, before = np.float32(1), np.float32(0), np.float32(0.5 * taps - 0.5)
    pixel, along_x, along_y, mass, _ = batch
    (x0, y0, d0), (x_step, y_step, d_step) = walk.start, walk.step
    x_limit, y_limit = walk.limits
    area, stride = walk.area, np.int32(walk.width)
    for n in range(offset.size):
        # Project the cell's center, and move to its first tap.
        along = offset[n]
        inverse = one / (d0 + along * d_step)
        x = (x0 + along * x_step) * inverse - before
        y = (y0 + along * y_step) * inverse - before
        # Drop cells outside the block's pixels or behind the camera: their mass becomes 0.
        is_in = (x >= zero) & (y >= zero) & (x < x_limit) & (y < y_limit) & (inverse > zero)
        column, row = np.int32(x), np.int32(y)
        # Store the phase of the filter, the projected area, and the first pixel.
        along_x[n] = x - np.float32(column)
        along_y[n] = y - np.float32(row)
        mass[n] = area * inverse * inverse * inverse if is_in else zero
        pixel[n] = row * stride + column if is_in else np.int32(0)


@inner_kernel
def determinant(m: Doubles) -> float:
    """Determinant of a (3, 3) matrix."""
    return float(
        m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1])
        - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
        + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])
    )


@inner_kernel
def _bent(before: Single, here: Single, after: Single, offset: Single) -> tuple[Single, Single]:
    """Value and slope at an offset from the middle of three, piecewise linear."""
    left, right = here - before, after - here
    if not math.isfinite(left):
        left = right
    if not math.isfinite(right):
        right = left
    slope = 0.5 * (left + right) if offset == 0 else (left if offset < 0 else right)
    return here + offset * slope, slope


@inner_kernel
def _along_row(places: Doubles, row: int, column: int, offset: float) -> tuple[Single, Single]:
    """Place and slope along u, at an offset from one of a map's places."""
    before, here = places[row, column - 1], places[row, column]
    return _bent(before, here, places[row, column + 1], offset)


@inner_kernel
def _near(
    places: Doubles, row: int, column: int, offset_u: float, offset_v: float
) -> tuple[Single, Single, Single]:
    """Place near one of a map's places, bilinear, and its slopes along u and v."""
    # Interpolate along u in the rows above, here and below.
    above, above_u = _along_row(places, row - 1, column, offset_u)
    here, here_u = _along_row(places, row, column, offset_u)
    below, below_u = _along_row(places, row + 1, column, offset_u)
    # Interpolate along v between them.
    place, slope_v = _bent(above, here, below, offset_v)
    # Blend the slope along u towards the row on the offset's side, if that row has a place.
    other_u = above_u if offset_v < 0 else below_u
    if not math.isfinite(other_u):
        other_u = here_u
    return place, here_u + abs(offset_v) * (other_u - here_u), slope_v


@inner_kernel
def _place_on_map(
    x: Doubles,
    y: Doubles,
    block: Integers,
    box: Integers,
    v: float,
    offset: Floats,
    taps: int,
    batch: Batch,
) -> None:
    """Place a row of cells by a map, bilinear between the centers of texels."""
    pixel, along_x, along_y, mass, _ = batch
    left, top, width, right, bottom, size_u, size_v = _raster_of(block, box, taps)
    r = math.floor(v)
    offset_v = v - r - 0.5
    for n in range(offset.size):
        # Interpolate the map and its slopes at the cell's center.
        u = block[0, START] + float(offset[n])
        c = math.floor(u)
        offset_u = u - c - 0.5
        px, xu, xv = _near(x, r + 1, c + 1, offset_u, offset_v)
        py, yu, yv = _near(y, r + 1, c + 1, offset_u, offset_v)
        # Scale the slopes to the sides of a cell, and move the origin to the block's pixels.
        px, xu, xv = px - left, xu * size_u, xv * size_v
        py, yu, yv = py - top, yu * size_u, yv * size_v
        # Area filter: take the box around the cell; others: the first tap of the filter.
        across, down = 1.0, 1.0
        if taps == 0:
            across = min(math.hypot(xu, xv) + SMALLEST, 1.0)
            down = min(math.hypot(yu, yv) + SMALLEST, 1.0)
            px -= 0.5 * across
            py -= 0.5 * down
        else:
            px -= 0.5 * taps - 0.5
            py -= 0.5 * taps - 0.5
        # Drop cells outside the block's pixels, NaN places included.
        mass[n], along_x[n], along_y[n] = np.float32(0), np.float32(0), np.float32(0)
        pixel[n] = 0
        if 0.0 <= px < right and 0.0 <= py < bottom:
            # Split the place into pixel and phase, and store the projected area.
            column, row = int(px), int(py)
            px -= column
            py -= row
            along_x[n] = beyond(px, across, 0.0) if taps == 0 else px
            along_y[n] = beyond(py, down, 0.0) if taps == 0 else py
            mass[n] = abs(xu * yv - xv * yu)
            pixel[n] = row * width + column


class Texels(NamedTuple):
    """A source, ready to be interpolated along u, along v or both."""

    plain: Floats  # (H, W, C)
    along_u: Floats
    along_v: Floats
    both: Floats


class Texture(NamedTuple):
    """A source in blocks."""

    texels: Texels
    extract: Extract
    totals: Doubles  # (K, H + 1, W + 1, C) sums of texels, see `fetch`
    edge: int
    channels: tuple[int, int]  # first of them and how many: 1 or 3
    taps: Floats  # (K, R) of the interpolation; see `kernels.texels`
    axes: Integers  # (B, 2, 6) blocks
    geometry: TexelMapping


class CellRows(NamedTuple):
    """Scratch for the rows of a block's cells."""

    batch: Batch
    offset: Floats  # (N,) of the cells, see `cell_offsets`
    patch: Floats  # (channels, rows, columns) of texels
    line: Floats  # (channels, columns)


@plays(begun, Texture)
def _begun(source: Texture, part: int) -> CellRows:
    """Fetch the texels of a block, and allocate scratch for its rows."""
    # Size the patch: the block's texels, padded along the axes that are interpolated.
    block, (first, count) = source.axes[part], source.channels
    reach = source.taps.shape[0] // 2
    pad = reach * (block[0, CUT] > 1), reach * (block[1, CUT] > 1)
    rows, columns = texels_along(block, 1) + 2 * pad[1], texels_along(block, 0) + 2 * pad[0]
    patch = np.empty((count, rows, columns), np.float32)
    # Fetch the texels, prefiltered as the interpolation needs them.
    texels, kind = source.texels, kind_of(block)
    chosen = texels.along_u if kind == 1 else texels.plain
    if kind > 1:
        chosen = texels.both if kind == 3 else texels.along_v
    fetch(chosen, source.extract, source.totals, block, pad, source.edge, patch, first)
    # Allocate the batch for one row of cells.
    offset = cell_offsets(block)
    line = np.empty((count, columns), np.float32)
    return CellRows(new_batch(count, offset.size), offset, patch, line)


@plays(lines, Texture)
def _lines(source: Texture, part: int) -> int:
    """Count the rows of cells of a block."""
    return line_count(source.axes[part])


@plays(fill, Texture)
def _fill(
    source: Texture, part: int, line: int, box: Integers, spread: FilterTaps, work: CellRows
) -> int:
    """Fill the batch with one row of cells; count them."""
    block, batch, offset = source.axes[part], work.batch, work.offset
    # Interpolate the values, first along v, then along u.
    row, cell, v = line_at(block, line)
    filter_rows(work.patch, row, cell, block[1, CUT], source.taps, work.line)
    filter_row(work.line, block, parts_along(block, 0), source.taps, batch.values)
    # Place the cells on screen.
    place(source.geometry, block, box, v, offset, spread.taps, batch)
    # Spread totals as densities, values per px², over the area that each cell covers.
    if spread.is_sum:
        (size_u, _), (size_v, _) = extents(block, 0), extents(block, 1)
        mass, values, texels = batch.mass, batch.values, np.float32(size_u * size_v)
        for n in range(offset.size):
            density = texels / mass[n] if mass[n] > np.float32(0) else np.float32(0)
            for c in range(values.shape[0]):
                values[c, n] *= density
    return int(offset.size)


@parallel_kernel
def paint_blocks(counter: Counter, source: Texture, spread: FilterTaps, parts: SourceParts) -> None:
    """Paint every block to its own pixels."""
    paint_parts(counter, source, spread, parts)
