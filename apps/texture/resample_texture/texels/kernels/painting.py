"""Blocks of cells painted side by side, then summed to the picture.

Every block adds its points to pixels of its own, so blocks may run on any thread; then each band of
rows of the picture adds the blocks' pixels in the order of the blocks. Hence the same bits for any
number of threads.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_texture.texels.kernels.adding import add
from resample_texture.texels.kernels.blocks import BOTTOM, CUT, LEFT, RIGHT, START, TOP, Integers
from resample_texture.texels.kernels.placing import Spread, place_on_map, place_on_plane
from resample_texture.texels.kernels.texels import (
    cell_offsets,
    extents,
    fetch,
    filter_row,
    filter_rows,
    kind_of,
    parts_along,
    texels_along,
)

BAND = 16  # rows of the picture that one thread sums at a time


@kernel
def _chosen(
    block: Integers, plain: Floats, along_u: Floats, along_v: Floats, both: Floats
) -> Floats:
    """Texels to interpolate between: prefiltered along the axes that are cut."""
    kind = kind_of(block)
    if kind > 1:
        return both if kind == 3 else along_v
    return along_u if kind == 1 else plain


@kernel
def _as_densities(values: Floats, mass: Floats, texels: float) -> None:
    """Turn totals per texel into values per px²."""
    for n in range(mass.size):
        density = np.float32(texels) / mass[n] if mass[n] > np.float32(0) else np.float32(0)
        for c in range(values.shape[0]):
            values[c, n] *= density


@parallel_kernel
def paint_blocks(
    counter: Counter,
    plain: Floats,
    along_u: Floats,
    along_v: Floats,
    both: Floats,
    totals: Doubles,
    edge: int,
    channels: tuple[int, int],
    matrix: Doubles,
    map_x: Doubles,
    map_y: Doubles,
    axes: Integers,
    bounds: Integers,
    taps: Floats,
    profile: Floats,
    spread: Spread,
    start: Integers,
    sums: Floats,
) -> None:
    """Paint every block to pixels of its own.

    Parameters
    ----------
    plain, along_u, along_v, both
        (H, W, C) texels: as they are, and prefiltered for interpolation along the axes named.
    totals
        (K, H + 1, W + 1, C) sums of texels, see `fetch`.
    channels
        First of them and how many: 1 or 3.
    matrix
        (3, 3) source to target; taken where the map is empty.
    map_x, map_y
        (H + 2, W + 2) places of the texels' centers, with a margin of one.
    axes, bounds
        (B, 2, 6) and (B, 4) blocks.
    taps
        (K, R) of the interpolation; see `texels`.
    profile
        (PHASES, T) weights of the pixel filter by phase.
    start
        (B + 1,) where the sums of each block begin.
    sums
        Space for all blocks' pixels, interleaved channels and weight.
    """
    first, count = channels
    for n in tasks(counter, axes.shape[0]):
        block, box, begin = axes[n], bounds[n], start[n]
        width = box[RIGHT] - box[LEFT]
        for k in range(begin, begin + width * (box[BOTTOM] - box[TOP]) * (count + 1)):
            sums[k] = np.float32(0)
        reach = taps.shape[0] // 2
        pad = reach * (block[0, CUT] > 1), reach * (block[1, CUT] > 1)
        texels_u, texels_v = texels_along(block, 0), texels_along(block, 1)
        patch = np.empty((count, texels_v + 2 * pad[1], texels_u + 2 * pad[0]), np.float32)
        fetch(_chosen(block, plain, along_u, along_v, both), totals, block, pad, edge, patch, first)
        (size_u, _), (size_v, joined_v) = extents(block, 0), extents(block, 1)
        parts_u, (first_v, last_v) = parts_along(block, 0), parts_along(block, 1)
        offset = cell_offsets(block)
        cells = offset.size
        line = np.empty((count, patch.shape[2]), np.float32)
        values, pixel = np.empty((count, cells), np.float32), np.empty(cells, np.int32)
        along_x, along_y = np.empty(cells, np.float32), np.empty(cells, np.float32)
        mass = np.empty(cells, np.float32)
        for row in range(texels_v):
            for part in range(first_v, last_v):
                filter_rows(patch, row, part, block[1, CUT], taps, line)
                filter_row(line, block, parts_u, taps, values)
                v = block[1, START] + (row + (part + 0.5) / block[1, CUT]) * joined_v
                if map_x.size > 0:
                    place_on_map(
                        map_x, map_y, block, box, v, offset, spread, pixel, along_x, along_y, mass
                    )
                else:
                    place_on_plane(
                        matrix, block, box, v, offset, spread, pixel, along_x, along_y, mass
                    )
                if spread.is_sum:
                    _as_densities(values, mass, size_u * size_v)
                add(sums, begin, width, values, pixel, along_x, along_y, mass, profile, spread.taps)


@kernel
def _collect_band(
    bounds: Integers, start: Integers, sums: Floats, picture: Floats, first: int, last: int
) -> None:
    """Add what blocks have for some rows of the picture."""
    lanes = picture.shape[2]
    for n in range(bounds.shape[0]):
        left, top = bounds[n, LEFT], bounds[n, TOP]
        width = bounds[n, RIGHT] - left
        from_column, to_column = max(left, 0), min(bounds[n, RIGHT], picture.shape[1])
        for row in range(max(top, first), min(bounds[n, BOTTOM], last)):
            at = start[n] + ((row - top) * width - left) * lanes
            for column in range(from_column, to_column):
                for lane in range(lanes):
                    picture[row, column, lane] += sums[at + column * lanes + lane]


@parallel_kernel
def collect(
    counter: Counter, bounds: Integers, start: Integers, sums: Floats, picture: Floats
) -> None:
    """Add all blocks' pixels to the picture's (height, width, lanes)."""
    for band in tasks(counter, (picture.shape[0] + BAND - 1) // BAND):
        _collect_band(
            bounds, start, sums, picture, band * BAND, min((band + 1) * BAND, picture.shape[0])
        )


@kernel
def _inner_columns(lines: Doubles, y: float, reach: float, width: int) -> tuple[int, int]:
    """First and last + 1 of a row's pixels around which, `reach` px wide, all lines are kept."""
    first, last = 0.0, float(width)
    for line in range(lines.shape[0]):
        a = lines[line, 0]
        rest = lines[line, 1] * y + lines[line, 2] - reach * (abs(a) + abs(lines[line, 1]))
        if a > 0.0:
            first = max(first, math.floor(min(max(-rest / a - 0.5, -1.0), last)) + 1.0)
        elif a < 0.0:
            last = min(last, math.ceil(min(max(-rest / a - 0.5, 0.0), last)))
        elif rest <= 0.0:
            return 0, 0
    return int(min(first, width)), int(max(last, 0.0))


@kernel
def _finish_band(
    picture: Floats,
    lines: Doubles,
    reach: float,
    full: float,
    is_sum: bool,
    image: Floats,
    coverage: Floats,
    rows: tuple[int, int],
    first: int,
) -> None:
    """Divide some rows by their weight, where nothing beyond the source's edges is seen."""
    weight_at = picture.shape[2] - 1
    zero, one = np.float32(0), np.float32(1)
    for row in range(rows[0], rows[1]):
        inner = _inner_columns(lines, row + 0.5, reach, picture.shape[1])
        for column in range(picture.shape[1]):
            weight = picture[row, column, weight_at]
            is_full = weight > zero and (weight >= full or inner[0] <= column < inner[1])
            coverage[row, column] = one if is_full else min(max(weight, zero), one)
            is_mean = (is_full or weight > one) and not is_sum
            share = one / weight if is_mean else one
            for lane in range(weight_at):
                image[row, column, first + lane] = picture[row, column, lane] * share


@parallel_kernel
def finish(
    counter: Counter,
    picture: Floats,
    lines: Doubles,
    reach: float,
    full: float,
    is_sum: bool,
    image: Floats,
    coverage: Floats,
    first: int,
) -> None:
    """Means from sums: pixels that see the source alone are divided by their weight.

    Parameters
    ----------
    picture
        (height, width, lanes) sums of some channels and, last, of weights.
    lines
        (N, 3) edges of the source on screen; the product with (x, y, 1) is positive inside.
    reach
        Radius of the pixel filter, px.
    full
        Weight from which on a pixel counts as filled wherever it lies.
    is_sum
        Sums are what is wanted.
    image
        (height, width, C), of which the channels from `first` on are filled.
    coverage
        (height, width), filled.
    """
    for band in tasks(counter, (picture.shape[0] + BAND - 1) // BAND):
        rows = band * BAND, min((band + 1) * BAND, picture.shape[0])
        _finish_band(picture, lines, reach, full, is_sum, image, coverage, rows, first)


@kernel
def offsets(bounds: Integers, lanes: int) -> Integers:
    """Where the sums of each block begin (B + 1,)."""
    start = np.zeros(bounds.shape[0] + 1, np.int64)
    for n in range(bounds.shape[0]):
        height = bounds[n, BOTTOM] - bounds[n, TOP]
        width = bounds[n, RIGHT] - bounds[n, LEFT]
        start[n + 1] = start[n] + height * width * lanes
    return start
