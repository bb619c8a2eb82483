"""The way back: from gradients of pixels to gradients of texels, by the weights of the way forward.

Every step of `painting` transposed, in reverse order: cells gather from the pixels they meet,
texels gather from the cells between them, and the source from the texels of all blocks. Blocks
gather side by side into patches of their own, which are then added one after the other: the same
bits for any number of threads.
"""

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.adding import phase_of
from resample_texture.texels.kernels.blocks import (
    BOTTOM,
    CUT,
    LEFT,
    LEVEL,
    RIGHT,
    START,
    TOP,
    Integers,
)
from resample_texture.texels.kernels.placing import Places, Spread, place_on_map, place_on_plane
from resample_texture.texels.kernels.texels import (
    _prefix,
    cell_offsets,
    extents,
    kind_of,
    mapped,
    parts_along,
    phase,
    texels_along,
)


@kernel
def _pads(block: Integers, taps: int) -> tuple[int, int]:
    """Texels that interpolation needs on each side of a block, along u and v."""
    return taps // 2 * (block[0, CUT] > 1), taps // 2 * (block[1, CUT] > 1)


@kernel
def _patch_shape(block: Integers, taps: int) -> tuple[int, int]:
    """Rows and columns of a block's texels and of those around it."""
    pad_u, pad_v = _pads(block, taps)
    return texels_along(block, 1) + 2 * pad_v, texels_along(block, 0) + 2 * pad_u


@kernel
def patch_offsets(axes: Integers, taps: int, channels: int) -> Integers:
    """Where the patch of each block begins (B + 1,)."""
    start = np.zeros(axes.shape[0] + 1, np.int64)
    for n in range(axes.shape[0]):
        rows, columns = _patch_shape(axes[n], taps)
        start[n + 1] = start[n] + rows * columns * channels
    return start


@kernel
def _copy_pixels(gradient: Floats, bounds: Integers, pixels: Floats) -> None:
    """Fill in the pixels (channels, P) of a block; beyond the frame they are 0."""
    at = 0
    for row in range(bounds[TOP], bounds[BOTTOM]):
        for column in range(bounds[LEFT], bounds[RIGHT]):
            is_in = 0 <= row < gradient.shape[0] and 0 <= column < gradient.shape[1]
            for c in range(pixels.shape[0]):
                pixels[c, at] = gradient[row, column, c] if is_in else np.float32(0)
            at += 1


@kernel
def _gather_areas(
    pixels: Floats,
    width: int,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
    values: Doubles,
) -> None:
    """Take cells' gradients from the 2 × 2 pixels each overlaps."""
    for n in range(mass.size):
        at, x, y, area = pixel[n], float(along_x[n]), float(along_y[n]), float(mass[n])
        for c in range(values.shape[0]):
            values[c, n] = 0.0
            if area == 0.0:
                continue
            above = (1.0 - x) * pixels[c, at] + x * pixels[c, at + 1]
            below = (1.0 - x) * pixels[c, at + width] + x * pixels[c, at + width + 1]
            values[c, n] = area * ((1.0 - y) * above + y * below)


@kernel
def _gather_points(
    pixels: Floats,
    width: int,
    pixel: Places,
    along_x: Floats,
    along_y: Floats,
    mass: Floats,
    profile: Floats,
    values: Doubles,
) -> None:
    """Take points' gradients from the taps × taps pixels around each."""
    taps = profile.shape[1]
    for n in range(mass.size):
        if mass[n] == np.float32(0):
            for c in range(values.shape[0]):
                values[c, n] = 0.0
            continue
        phase_x, phase_y = phase_of(along_x[n]), phase_of(along_y[n])
        for c in range(values.shape[0]):
            total, at = 0.0, pixel[n]
            for row in range(taps):
                along_row = 0.0
                for column in range(taps):
                    along_row += float(profile[phase_x, column]) * pixels[c, at + column]
                total += profile[phase_y, row] * along_row
                at += width
            values[c, n] = total * mass[n]


@kernel
def _spread_row(
    values: Doubles, block: Integers, parts: tuple[int, int], taps: Floats, line: Doubles
) -> None:
    """Transposed `filter_row`: a line (channels, columns) from the cells of a row."""
    cut, texels, count = block[0, CUT], texels_along(block, 0), parts[1] - parts[0]
    line[:] = 0.0
    for c in range(line.shape[0]):
        for part in range(count):
            at = phase(parts[0] + part, cut)
            for texel in range(texels):
                n = part * texels + texel if count <= texels else texel * count + part
                if cut == 1:
                    line[c, texel] += values[c, n]
                else:
                    for k in range(taps.shape[0]):
                        line[c, texel + k] += taps[k, at] * values[c, n]


@kernel
def _spread_line(
    line: Doubles, row: int, part: int, cut: int, taps: Floats, patch: Doubles
) -> None:
    """Transposed `filter_rows`: add a line at one part of a row of texels to the patch."""
    count = 1 if cut == 1 else taps.shape[0]
    at = phase(part, cut)
    for k in range(count):
        weight = 1.0 if cut == 1 else float(taps[k, at])
        for c in range(line.shape[0]):
            for column in range(line.shape[1]):
                patch[c, row + k, column] += weight * line[c, column]


@kernel
def _share_out(mass: Floats, texels: float) -> None:
    """Turn areas into what a cell has of a texel's total, wherever it is in reach."""
    for n in range(mass.size):
        if mass[n] > np.float32(0):
            mass[n] = np.float32(texels)


@kernel
def _gather_block(
    gradient: Floats,
    matrix: Doubles,
    map_x: Doubles,
    map_y: Doubles,
    block: Integers,
    bounds: Integers,
    taps: Floats,
    profile: Floats,
    spread: Spread,
    start: int,
    patches: Doubles,
) -> None:
    """Fill in the patch of one block, from `start` on."""
    channels, width = gradient.shape[2], bounds[RIGHT] - bounds[LEFT]
    pixels = np.empty((channels, width * (bounds[BOTTOM] - bounds[TOP])), np.float32)
    _copy_pixels(gradient, bounds, pixels)
    rows, columns = _patch_shape(block, taps.shape[0])
    patch, line = np.zeros((channels, rows, columns)), np.empty((channels, columns))
    (size_u, _), (size_v, joined_v) = extents(block, 0), extents(block, 1)
    parts_u, (first_v, last_v) = parts_along(block, 0), parts_along(block, 1)
    offset = cell_offsets(block)
    cells = offset.size
    values, pixel = np.empty((channels, cells)), np.empty(cells, np.int32)
    along_x, along_y = np.empty(cells, np.float32), np.empty(cells, np.float32)
    mass = np.empty(cells, np.float32)
    for row in range(texels_along(block, 1)):
        for part in range(first_v, last_v):
            v = block[1, START] + (row + (part + 0.5) / block[1, CUT]) * joined_v
            if map_x.size > 0:
                place_on_map(
                    map_x, map_y, block, bounds, v, offset, spread, pixel, along_x, along_y, mass
                )
            else:
                place_on_plane(
                    matrix, block, bounds, v, offset, spread, pixel, along_x, along_y, mass
                )
            if spread.is_sum:
                _share_out(mass, size_u * size_v)
            if spread.taps == 0:
                _gather_areas(pixels, width, pixel, along_x, along_y, mass, values)
            else:
                _gather_points(pixels, width, pixel, along_x, along_y, mass, profile, values)
            _spread_row(values, block, parts_u, taps, line)
            _spread_line(line, row, part, block[1, CUT], taps, patch)
    at = start
    for c in range(channels):
        for row in range(rows):
            for column in range(columns):
                patches[at] = patch[c, row, column]
                at += 1


@parallel_kernel
def gather_blocks(
    counter: Counter,
    gradient: Floats,
    matrix: Doubles,
    map_x: Doubles,
    map_y: Doubles,
    axes: Integers,
    bounds: Integers,
    taps: Floats,
    profile: Floats,
    spread: Spread,
    start: Integers,
    patches: Doubles,
) -> None:
    """Gather what pixels say about the texels of every block.

    Parameters
    ----------
    gradient
        (height, width, C) of the sums of the picture.
    matrix, map_x, map_y, axes, bounds, taps, profile, spread
        As for `paint_blocks`.
    start
        (B + 1,) where the patch of each block begins; see `patch_offsets`.
    patches
        Filled: (C, rows, columns) of each block.
    """
    for n in tasks(counter, axes.shape[0]):
        _gather_block(
            gradient,
            matrix,
            map_x,
            map_y,
            axes[n],
            bounds[n],
            taps,
            profile,
            spread,
            start[n],
            patches,
        )


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
    height, width = totals.shape[1] - 1, totals.shape[2] - 1
    channel, value = at[0], at[1] / (float(extent[0]) * float(extent[1]))
    for corner in range(4):
        below, beyond = corner // 2, corner % 2
        i, f, j, g = _prefix(place[1] + below * extent[1], height, edge)
        m, p, n, q = _prefix(place[0] + beyond * extent[0], width, edge)
        signed = value if below == beyond else -value
        totals[kind, i, m, channel] += signed * f * p
        totals[kind, i, n, channel] += signed * f * q
        totals[kind, j, m, channel] += signed * g * p
        totals[kind, j, n, channel] += signed * g * q


@kernel
def _give_back_means(
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
def _give_back_texels(
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
                for v in range(corner[1] + row * step[1], corner[1] + (row + 1) * step[1]):
                    r = mapped(v, texels.shape[1], edge)
                    left = corner[0] + column * step[0]
                    for u in range(left, left + step[0]):
                        texels[kind, r, mapped(u, texels.shape[2], edge), c] += value


@kernel
def give_back(
    patches: Doubles,
    start: Integers,
    axes: Integers,
    edge: int,
    taps: int,
    totals: Doubles,
    texels: Doubles,
) -> None:
    """Transposed `fetch`: add the patches of all blocks to the texels they were fetched from.

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
        step = 1 << block[0, LEVEL], 1 << block[1, LEVEL]
        left, top = block[0, START] - pad[0] * step[0], block[1, START] - pad[1] * step[1]
        right, bottom = left + shape[1] * step[0], top + shape[0] * step[1]
        is_outside = left < 0 or top < 0 or right > width or bottom > height
        if totals.shape[0] > 0 and (step[0] > 1 or step[1] > 1) and is_outside:
            _give_back_means(patches, start[n], block, pad, shape, edge, totals)
        else:
            kind = min(kind_of(block), texels.shape[0] - 1)
            _give_back_texels(patches, start[n], (left, top), step, shape, edge, texels, kind)
