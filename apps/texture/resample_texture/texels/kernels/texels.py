"""Values of cells: texels fetched from the source, averaged or interpolated."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, kernel
from resample.engine.windows.boxes import CLAMP, WRAP, mapped
from resample.types import Doubles, Floats, Single
from resample_texture.texels.kernels.blocks import CUT, FIRST, LAST, LENGTH, LEVEL, START, Integers

# An interpolation's taps are (K, R), K odd: tap k weighs the texel k - K // 2 steps from the cell's
# own. Column n (n - 1) / 2 + p is for part p of n, n up to EXACT; DENSE more are for finer parts.
EXACT = 64
DENSE = 4096


class Extract(NamedTuple):
    """Part of a source that an array of texels covers."""

    height: int  # of the source
    width: int
    top: int = 0  # row and column at which the part begins
    left: int = 0
    joined: int = 1  # rows of the source summed in each row of the part


@inner_kernel
def kind_of(block: Integers) -> int:
    """Kind of texels of a block: 0 as they are, 1 prefiltered along u, 2 along v, 3 along both."""
    return int(block[0, CUT] > 1) + 2 * int(block[1, CUT] > 1)


@inner_kernel
def _prefix(index: int, size: int, edge: int) -> tuple[int, float, int, float]:
    """Return i, f, j and g of a prefix sum, f S[i] + g S[j], by those within the source."""
    if 0 <= index <= size:
        return index, 1.0, 0, 0.0
    # Clamped: repeat the first or the last value.
    if edge == CLAMP:
        if index < 0:
            return 1, float(index), 0, 0.0
        beyond = float(index - size)
        return size, 1.0 + beyond, size - 1, -beyond
    # Wrapped: whole periods, and the rest of one.
    if edge == WRAP:
        return size, float(index // size), index % size, 1.0
    # Mirrored: pairs of periods, the second of each reversed.
    pairs, rest = index // (2 * size), index % (2 * size)
    if rest <= size:
        return size, 2.0 * pairs, rest, 1.0
    return size, 2.0 * pairs + 2.0, 2 * size - rest, -1.0


@kernel
def _fetch_means(
    totals: Doubles, block: Integers, pad: tuple[int, int], edge: int, patch: Floats, first: int
) -> None:
    """Fetch cells larger than the source, or that extend beyond its edges."""
    extent = 1 << block[0, LEVEL], 1 << block[1, LEVEL]
    kind = min(kind_of(block), totals.shape[0] - 1)
    for row in range(patch.shape[1]):
        for column in range(patch.shape[2]):
            # Find the first texel of the cell.
            place = (
                block[0, START] + (column - pad[0]) * extent[0],
                block[1, START] + (row - pad[1]) * extent[1],
            )
            for c in range(patch.shape[0]):
                channel = first + c
                height, width = totals.shape[1] - 1, totals.shape[2] - 1
                total = 0.0
                # Add the prefix sums at the four corners, with alternating signs.
                for corner in range(4):
                    below, beyond = corner // 2, corner % 2
                    i, f, j, g = _prefix(place[1] + below * extent[1], height, edge)
                    m, p, n, q = _prefix(place[0] + beyond * extent[0], width, edge)
                    value = f * (p * totals[kind, i, m, channel] + q * totals[kind, i, n, channel])
                    value += g * (p * totals[kind, j, m, channel] + q * totals[kind, j, n, channel])
                    total += value if below == beyond else -value
                patch[c, row, column] = total / (float(extent[0]) * float(extent[1]))


@kernel
def _join_rows(flat: Floats, rows: tuple[int, int], begin: int, line: Floats) -> None:
    """Sum rows of the source, (H, W × C), into a line, from number `begin` on."""
    start = np.uint64(begin)
    for row in range(rows[0], rows[1]):
        # Overwrite with the first row, then add the others; unsigned indices let LLVM vectorize.
        if row == rows[0]:
            for k in range(line.size):
                line[k] = flat[row, start + np.uint64(k)]
        else:
            for k in range(line.size):
                line[k] += flat[row, start + np.uint64(k)]


@kernel
def _join_columns(
    line: Floats, step: int, channels: int, first: int, share: Single, patch: Floats, row: int
) -> None:
    """Sum every `step` texels of a line into a row of the patch."""
    for c in range(patch.shape[0]):
        # Copy with a weight where cells are single texels along u.
        if step == 1:
            for column in range(patch.shape[2]):
                at = np.uint64(column) * np.uint64(channels) + np.uint64(first + c)
                patch[c, row, column] = share * line[at]
            continue
        # Sum `step` texels for each cell.
        for column in range(patch.shape[2]):
            total = np.float32(0)
            for k in range(column * step, (column + 1) * step):
                total += line[np.uint64(k) * np.uint64(channels) + np.uint64(first + c)]
            patch[c, row, column] = share * total


@kernel
def fetch(
    source: Floats,  # (H, W, C), or the part of it that `extract` tells
    extract: Extract,
    totals: Doubles,  # (K, H + 1, W + 1, C) sums, by `kind_of` or for all; K is 0 without need
    block: Integers,
    pad: tuple[int, int],
    edge: int,
    patch: Floats,  # (channels, rows, columns), filled with the channels from `first` on
    first: int,
) -> None:
    """Fetch a block's texels, or their means over a cell, with `pad` more all around."""
    # Find the texels that the padded patch covers, and whether all lie within the source.
    step_u, step_v = 1 << block[0, LEVEL], 1 << block[1, LEVEL]
    height, width, channels = extract.height, extract.width, source.shape[2]
    _, rows, columns = patch.shape
    left, top = block[0, START] - pad[0] * step_u, block[1, START] - pad[1] * step_v
    is_inside = left >= 0 and left + columns * step_u <= width
    is_inside = is_inside and top >= 0 and top + rows * step_v <= height

    # Take large means that cross an edge from the summed-area table.
    if totals.shape[0] > 0 and (step_u > 1 or step_v > 1) and not is_inside:
        _fetch_means(totals, block, pad, edge, patch, first)
        return
    share = np.float32(1.0 / (float(step_u) * float(step_v)))
    flat = source.reshape(source.shape[0], source.shape[1] * channels)

    # Inside, sum whole rows first, then columns: long loops without edge rules.
    if is_inside:
        line = np.empty(columns * step_u * channels, np.float32)
        top, left, step = top - extract.top, left - extract.left, step_v // extract.joined
        for row in range(rows):
            above = top // extract.joined + row * step
            _join_rows(flat, (above, above + step), left * channels, line)
            _join_columns(line, step_u, channels, first, share, patch, row)
        return

    # At an edge, map each texel by the edge rule.
    for row in range(rows):
        for column in range(columns):
            for c in range(patch.shape[0]):
                total = np.float32(0)
                for r in range(top + row * step_v, top + (row + 1) * step_v):
                    at = mapped(r, height, edge) - extract.top
                    for q in range(left + column * step_u, left + (column + 1) * step_u):
                        total += source[at, mapped(q, width, edge) - extract.left, first + c]
                patch[c, row, column] = share * total


@inner_kernel
def phase(part: int, cut: int) -> int:
    """Column of an interpolation's taps for one of the cells of a texel; see `EXACT`."""
    if cut <= EXACT:
        return cut * (cut - 1) // 2 + part
    return EXACT * (EXACT + 1) // 2 + int((part + 0.5) / cut * DENSE)


@inner_kernel
def filter_rows(patch: Floats, row: int, part: int, cut: int, taps: Floats, line: Floats) -> None:
    """Interpolate along v: a line (channels, columns) at one part of a texel row."""
    # Uncut texels are their own values.
    if cut == 1:
        for c in range(line.shape[0]):
            for column in range(line.shape[1]):
                line[c, column] = patch[c, row, column]
        return
    at = phase(part, cut)

    # Unroll the usual five taps.
    if taps.shape[0] == 5:
        a, b, c, d, e = taps[0, at], taps[1, at], taps[2, at], taps[3, at], taps[4, at]
        for channel in range(line.shape[0]):
            for n in range(line.shape[1]):
                line[channel, n] = (
                    a * patch[channel, row, n]
                    + b * patch[channel, row + 1, n]
                    + c * patch[channel, row + 2, n]
                    + d * patch[channel, row + 3, n]
                    + e * patch[channel, row + 4, n]
                )
        return

    # Sum any other number of taps, skipping those without weight.
    line[:] = np.float32(0)
    for k in range(taps.shape[0]):
        weight = taps[k, at]
        if weight != np.float32(0):
            for c in range(line.shape[0]):
                for column in range(line.shape[1]):
                    line[c, column] += weight * patch[c, row + k, column]


@inner_kernel
def filter_row(
    line: Floats, block: Integers, parts: tuple[int, int], taps: Floats, values: Floats
) -> None:
    """Interpolate along u: values (channels, cells), ordered as `cell_offsets`."""
    cut, texels, count = block[0, CUT], texels_along(block, 0), parts[1] - parts[0]
    if cut == 1:
        # Uncut texels are their own values.
        for c in range(line.shape[0]):
            for n in range(texels):
                values[c, n] = line[c, n]
    elif count <= texels:
        # Loop over the longer of texels and parts inside, as `cell_offsets` orders them.
        for part in range(count):
            _filter_part(line, phase(parts[0] + part, cut), taps, values, part * texels, texels)
    else:
        values[:] = np.float32(0)
        for texel in range(texels):
            first = texel * count
            for channel in range(line.shape[0]):
                # Add each tap's texel to all parts.
                for k in range(taps.shape[0]):
                    value, at = line[channel, texel + k], phase(parts[0], cut)
                    # Phases of a texel's parts are adjacent columns of the table, or cut finely.
                    if cut <= EXACT:
                        for n in range(count):
                            m = np.uint64(first) + np.uint64(n)
                            values[channel, m] += value * taps[k, np.uint64(at) + np.uint64(n)]
                    else:
                        for n in range(count):
                            weight = taps[k, phase(parts[0] + n, cut)]
                            values[channel, first + n] += value * weight


@inner_kernel
def _filter_part(
    line: Floats, at: int, taps: Floats, values: Floats, first: int, count: int
) -> None:
    """Interpolate the same part of each of `count` texels."""
    # Unroll the usual five taps; unsigned indices let LLVM vectorize.
    if taps.shape[0] == 5:
        a, b, c, d, e = taps[0, at], taps[1, at], taps[2, at], taps[3, at], taps[4, at]
        for channel in range(line.shape[0]):
            for n in range(count):
                m = np.uint64(n)
                values[channel, np.uint64(first) + m] = (
                    a * line[channel, m]
                    + b * line[channel, m + np.uint64(1)]
                    + c * line[channel, m + np.uint64(2)]
                    + d * line[channel, m + np.uint64(3)]
                    + e * line[channel, m + np.uint64(4)]
                )
        return
    # Sum any other number of taps.
    for channel in range(line.shape[0]):
        for n in range(count):
            total = np.float32(0)
            for k in range(taps.shape[0]):
                total += taps[k, at] * line[channel, n + k]
            values[channel, first + n] = total


@kernel
def cell_offsets(block: Integers) -> Floats:
    """Centers of the cells of a row (N,), in texels from the block's start."""
    _, joined = extents(block, 0)
    first, last = parts_along(block, 0)
    texels, parts = texels_along(block, 0), last - first
    offset = np.empty(texels * parts, np.float32)
    for texel in range(texels):
        for part in range(parts):  # the more of texels and parts are adjacent, for long inner loops
            n = part * texels + texel if parts <= texels else texel * parts + part
            offset[n] = joined * (texel + (first + part + 0.5) / block[0, CUT])
    return offset


@inner_kernel
def extents(block: Integers, axis: int) -> tuple[float, float]:
    """Length of a cell and of a texel (or of joined texels), in texels."""
    joined = 2.0 ** block[axis, LEVEL]
    return joined / block[axis, CUT], joined


@inner_kernel
def texels_along(block: Integers, axis: int) -> int:
    """Texels, or groups of joined texels, of a block along an axis."""
    return int(block[axis, LENGTH] >> block[axis, LEVEL])


@inner_kernel
def parts_along(block: Integers, axis: int) -> tuple[int, int]:
    """First and last + 1 of the cells that each texel of a block is cut into."""
    # Only a block within one texel has fewer cells than its whole cut.
    if block[axis, LENGTH] > 1:
        return 0, block[axis, CUT]
    return block[axis, FIRST], block[axis, LAST]


@inner_kernel
def line_count(block: Integers) -> int:
    """Count the rows of cells of a block."""
    first, last = parts_along(block, 1)
    return texels_along(block, 1) * (last - first)


@inner_kernel
def line_at(block: Integers, line: int) -> tuple[int, int, float]:
    """Row of texels of a row of cells, which part of it, and its coordinate v."""
    first, last = parts_along(block, 1)
    _, joined = extents(block, 1)
    row, part = line // (last - first), first + line % (last - first)
    return row, part, block[1, START] + (row + (part + 0.5) / block[1, CUT]) * joined
