"""Adjoint of the forward warp: texels' gradients from those of pixels.

The weights are those of the forward warp. Every step of `painting` transposed, in reverse order:
cells gather from the pixels they meet, texels gather from the cells between them, and the source
from the texels of all blocks. Blocks gather in parallel into their own patches, which are then
added one after the other: the same bits for any number of threads.
"""

import numpy as np

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP, Batch, new_batch
from resample.engine.cells.taps import FilterTaps, gather
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.windows.boxes import mapped
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.blocks import CUT, LENGTH, LEVEL, START, Integers
from resample_texture.texels.kernels.placing import TexelMapping, place
from resample_texture.texels.kernels.texels import (
    _prefix,
    cell_offsets,
    extents,
    kind_of,
    line_at,
    line_count,
    parts_along,
    phase,
    texels_along,
)


@kernel
def _pads(block: Integers, taps: int) -> tuple[int, int]:
    """Padding of a block that interpolation needs on each side, along u and v."""
    return taps // 2 * (block[0, CUT] > 1), taps // 2 * (block[1, CUT] > 1)


@kernel
def _patch_shape(block: Integers, taps: int) -> tuple[int, int]:
    """Rows and columns of a block's texels with their padding."""
    pad_u, pad_v = _pads(block, taps)
    return texels_along(block, 1) + 2 * pad_v, texels_along(block, 0) + 2 * pad_u


def patch_offsets(axes: Integers, taps: int, channels: int) -> Integers:
    """Where the patch of each block begins (B + 1,)."""
    padded = 2 * (taps // 2) * (axes[:, :, CUT] > 1)
    sides = (axes[:, :, LENGTH] >> axes[:, :, LEVEL]) + padded
    return np.concatenate([[0], np.cumsum(sides.prod(axis=1) * channels)]).astype(np.int64)


@kernel
def _copy_pixels(gradient: Floats, bounds: Integers, pixels: Floats) -> None:
    """Copy a block's pixels (channels, P) from a picture; 0 outside the frame."""
    at = 0
    for row in range(bounds[TOP], bounds[BOTTOM]):
        for column in range(bounds[LEFT], bounds[RIGHT]):
            is_in = 0 <= row < gradient.shape[0] and 0 <= column < gradient.shape[1]
            for c in range(pixels.shape[0]):
                pixels[c, at] = gradient[row, column, c] if is_in else np.float32(0)
            at += 1


@kernel
def _spread_row(
    values: Doubles, block: Integers, parts: tuple[int, int], taps: Floats, line: Doubles
) -> None:
    """Transposed `filter_row`: scatter cells to a line (channels, columns)."""
    cut, texels, count = block[0, CUT], texels_along(block, 0), parts[1] - parts[0]
    line[:] = 0.0
    for c in range(line.shape[0]):
        for part in range(count):
            # All cells of one phase have the same taps.
            at = phase(parts[0] + part, cut)
            for texel in range(texels):
                # Cells are ordered as `cell_offsets` orders them.
                n = part * texels + texel if count <= texels else texel * count + part
                # An uncut texel is its own cell; the others scatter through the taps.
                if cut == 1:
                    line[c, texel] += values[c, n]
                else:
                    for k in range(taps.shape[0]):
                        line[c, texel + k] += taps[k, at] * values[c, n]


@kernel
def _spread_line(
    line: Doubles, row: int, part: int, cut: int, taps: Floats, patch: Doubles
) -> None:
    """Transposed `filter_rows`: scatter a line to the rows of the patch."""
    count = 1 if cut == 1 else taps.shape[0]
    at = phase(part, cut)
    for k in range(count):
        weight = 1.0 if cut == 1 else float(taps[k, at])
        for c in range(line.shape[0]):
            for column in range(line.shape[1]):
                patch[c, row + k, column] += weight * line[c, column]


@kernel
def _share_out(mass: Floats, texels: float) -> None:
    """Replace areas by the texels per cell, for totals; cells out of reach stay 0."""
    for n in range(mass.size):
        if mass[n] > np.float32(0):
            mass[n] = np.float32(texels)


@kernel
def _gather_block(
    gradient: Floats,
    geometry: TexelMapping,
    block: Integers,
    box: Integers,
    taps: Floats,
    spread: FilterTaps,
    patch: Doubles,
) -> None:
    """Fill the patch (channels, rows, columns) of one block."""
    # Copy the pixels that the block may meet, zero outside the frame.
    channels, width = gradient.shape[2], box[RIGHT] - box[LEFT]
    pixels = np.empty((channels, width * (box[BOTTOM] - box[TOP])), np.float32)
    _copy_pixels(gradient, box, pixels)

    # Allocate scratch; the values are float64, unlike those of the forward pass.
    patch[:] = 0.0
    line = np.empty((channels, patch.shape[2]))
    (size_u, _), (size_v, _) = extents(block, 0), extents(block, 1)
    parts, offset = parts_along(block, 0), cell_offsets(block)
    room = new_batch(0, offset.size)
    values = np.empty((channels, offset.size))
    batch = Batch(room.pixel, room.along_x, room.along_y, room.mass, values)
    for n in range(line_count(block)):
        row, part, v = line_at(block, n)
        # Place the row of cells as the forward pass does.
        place(geometry, block, box, v, offset, spread.taps, batch)
        if spread.is_sum:
            _share_out(batch.mass, size_u * size_v)
        # Transpose the steps of the forward pass: pixels to cells, to a line, to the patch.
        gather(pixels, width, batch, offset.size, spread)
        _spread_row(values, block, parts, taps, line)
        _spread_line(line, row, part, block[1, CUT], taps, patch)


@parallel_kernel
def gather_blocks(
    counter: Counter,
    gradient: Floats,
    geometry: TexelMapping,
    axes: Integers,
    bounds: Integers,
    taps: Floats,
    spread: FilterTaps,
    patches: tuple[Integers, Doubles],
) -> None:
    """Gather the gradients of every block's texels from the gradient of the picture.

    Parameters
    ----------
    gradient
        (height, width, C) gradient of the picture's sums.
    axes, bounds
        (B, 2, 6) blocks, and (B, 4) the pixels that they meet.
    taps
        (K, R) of the interpolation; see `texels`.
    patches
        (B + 1,) where the patch of each block begins, see `patch_offsets`; and all of them, filled:
        (C, rows, columns) of each block.
    """
    channels, (start, values) = gradient.shape[2], patches
    for n in tasks(counter, axes.shape[0]):
        rows, columns = _patch_shape(axes[n], taps.shape[0])
        patch = values[start[n] : start[n + 1]].reshape((channels, rows, columns))
        _gather_block(gradient, geometry, axes[n], bounds[n], taps, spread, patch)


@kernel
def _add_mean(
    totals: Doubles,
    kind: int,
    place: tuple[int, int],
    extent: tuple[int, int],
    edge: int,
    at: tuple[int, float],
) -> None:
    """Transposed `_mean`: add to the sums that a mean was taken from.

    `at` is the channel and the gradient of the mean.
    """
    # A mean divides by its texels, and so does its gradient.
    height, width = totals.shape[1] - 1, totals.shape[2] - 1
    channel, value = at[0], at[1] / (float(extent[0]) * float(extent[1]))
    # Add to the four corners of the rectangle, with the signs of a summed-area table.
    for corner in range(4):
        below, beyond = corner // 2, corner % 2
        # Beyond the edges a prefix sum is a combination of two within the source, per axis.
        i, f, j, g = _prefix(place[1] + below * extent[1], height, edge)
        m, p, n, q = _prefix(place[0] + beyond * extent[0], width, edge)
        signed = value if below == beyond else -value
        totals[kind, i, m, channel] += signed * f * p
        totals[kind, i, n, channel] += signed * f * q
        totals[kind, j, m, channel] += signed * g * p
        totals[kind, j, n, channel] += signed * g * q


@kernel
def _scatter_means(
    patches: Doubles,
    start: int,
    block: Integers,
    pad: tuple[int, int],
    shape: tuple[int, int],
    edge: int,
    totals: Doubles,
) -> None:
    """Transposed `_fetch_means` of a patch (rows, columns)."""
    extent = 1 << block[0, LEVEL], 1 << block[1, LEVEL]
    at = start
    kind = min(kind_of(block), totals.shape[0] - 1)
    for c in range(totals.shape[3]):
        for row in range(shape[0]):
            for column in range(shape[1]):
                place = (
                    block[0, START] + (column - pad[0]) * extent[0],
                    block[1, START] + (row - pad[1]) * extent[1],
                )
                _add_mean(totals, kind, place, extent, edge, (c, patches[at]))
                at += 1


@kernel
def _scatter_blocks(
    patches: Doubles,
    start: int,
    corner: tuple[int, int],
    step: tuple[int, int],
    shape: tuple[int, int],
    edge: int,
    texels: Doubles,
    kind: int,
) -> None:
    """Add a patch (rows, columns) to the texels that its values are means of.

    `corner` and `step` are the first texel and how many make a value, along u and v.
    """
    at, share = start, 1.0 / (float(step[0]) * float(step[1]))
    for c in range(texels.shape[3]):
        for row in range(shape[0]):
            for column in range(shape[1]):
                value = share * patches[at]
                at += 1
                # Share the value's gradient evenly among the texels that it is the mean of.
                for v in range(corner[1] + row * step[1], corner[1] + (row + 1) * step[1]):
                    r = mapped(v, texels.shape[1], edge)
                    left = corner[0] + column * step[0]
                    for u in range(left, left + step[0]):
                        texels[kind, r, mapped(u, texels.shape[2], edge), c] += value


@kernel
def scatter_texels(
    patches: Doubles,
    start: Integers,
    axes: Integers,
    edge: int,
    taps: int,
    totals: Doubles,
    texels: Doubles,
) -> None:
    """Transposed `fetch`: add the patches of all blocks to their texels.

    Parameters
    ----------
    patches, start
        See `gather_blocks`.
    taps
        Length of an interpolation's taps.
    totals
        (K, H + 1, W + 1, C) gradient of the sums of texels, see `fetch`.
    texels
        (K, H, W, C) gradient of the texels. K is 4 if they were prefiltered: as they are, along u,
        along v, along both; otherwise 1.
    """
    height, width = texels.shape[1], texels.shape[2]
    for n in range(axes.shape[0]):
        block = axes[n]
        pad, shape = _pads(block, taps), _patch_shape(block, taps)
        # Find the texels that the padded patch was fetched from.
        step = 1 << block[0, LEVEL], 1 << block[1, LEVEL]
        left, top = block[0, START] - pad[0] * step[0], block[1, START] - pad[1] * step[1]
        right, bottom = left + shape[1] * step[0], top + shape[0] * step[1]
        is_outside = left < 0 or top < 0 or right > width or bottom > height
        # Large means that cross an edge were read from the summed-area table.
        if totals.shape[0] > 0 and (step[0] > 1 or step[1] > 1) and is_outside:
            _scatter_means(patches, start[n], block, pad, shape, edge, totals)
        else:
            # The others were read from the texels, prefiltered along the cut axes.
            kind = min(kind_of(block), texels.shape[0] - 1)
            _scatter_blocks(patches, start[n], (left, top), step, shape, edge, texels, kind)
