"""Pixels with sides along a grid's axes: weighted sums down, then across.

A mean over such a pixel is separable, so each axis is summed once: first down the columns of the
grid that a tile of pixels reads, then, transposed, across them. Loops run along numbers that lie
side by side, whatever the number of channels and of weights.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import bands
from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, packed_kernel, tasks
from resample.engine.windows.boxes import Place
from resample.engine.windows.limits import (
    Corners,
    Limits,
    Part,
    both,
    cell_of,
    fill_corners,
    mark_of,
    tolerance_of,
    towards,
    varies_between,
)
from resample.types import Floats, Single

Integers = NDArray[np.int64]

BAND = 32  # rows that a thread filters at a time
BLOCK = 960  # numbers of a row that are summed at a time: whole samples of up to four, and lanes
LANES = 64  # numbers that loops over lanes divide evenly


@inner_kernel
def _add_pairs(
    line: Floats, source: Floats, start: int, steps: tuple[int, int], count: int, weights: Floats
) -> None:
    """Add whole `LANES` of the stretches on both sides of one, times four weights.

    A rest would be summed in another way, and its bits would depend on where a stretch ends.

    `steps`: from the middle to the nearest two stretches, and from one to the next; numbers.
    """
    s, t, u, v = weights[0], weights[1], weights[2], weights[3]
    step = np.uint64(steps[1])
    a, b = np.uint64(start - steps[0]), np.uint64(start + steps[0])
    for n in range(count // LANES * LANES):
        k = np.uint64(n)
        # One after the other, as `_add_pair` would.
        c, d, total = a + k, b + k, line[k]
        total += s * (source[c] + source[d])
        total += t * (source[c - step] + source[d + step])
        c, d = c - (step << np.uint64(1)), d + (step << np.uint64(1))
        total += u * (source[c] + source[d])
        total += v * (source[c - step] + source[d + step])
        line[k] = total


@inner_kernel
def _add_pair(line: Floats, source: Floats, at: tuple[int, int], count: int, weight: float) -> None:
    """Add two stretches of a source to a line, times one weight."""
    a, b, w = np.uint64(at[0]), np.uint64(at[1]), np.float32(weight)
    for n in range(count):
        k = np.uint64(n)
        line[k] += w * (source[a + k] + source[b + k])


@inner_kernel
def _filter_stretch(
    line: Floats, source: Floats, start: int, step: int, count: int, taps: Floats
) -> None:
    """Filter a stretch of numbers; the neighbours of taps are `step` numbers apart."""
    # The middle tap initializes the line.
    middle = taps.size // 2
    at, w = np.uint64(start), taps[middle]
    for n in range(count):
        k = np.uint64(n)
        line[k] = w * source[at + k]
    # Symmetric taps share a weight, and so a product.
    for tap in range(1, middle - 2, 4):
        weights = taps[middle + tap : middle + tap + 4]
        _add_pairs(line, source, start, (tap * step, step), count, weights)
    four, rest = middle // 4 * 4, count // LANES * LANES
    for tap in range(1, middle + 1):
        first = rest if tap <= four else 0
        places = start + first - tap * step, start + first + tap * step
        _add_pair(line[first:], source, places, count - first, taps[middle + tap])


class Filters(NamedTuple):
    """Symmetric taps (K,), K odd, along both axes of a plate."""

    across: Floats
    down: Floats


@kernel
def _filter_rows(
    flat: Floats,
    shape: tuple[int, int, int],
    filters: Filters,
    rows: tuple[int, int],
    lanes: int,
    result: Floats,
) -> None:
    """Filter some rows of a plate, down and then across, where all taps lie on the plate."""
    _, columns, channels = shape
    width, margin = columns * channels, filters.across.size // 2
    inner, count = width - 2 * margin * channels, rows[1] - rows[0]
    tall, line = np.empty((count, width), np.float32), np.empty(BLOCK, np.float32)
    # Filter down, block by block, so that the rows of a block stay in the cache.
    for first in range(0, width, BLOCK):
        size = min(BLOCK, width - first)
        for row in range(count):
            start = (rows[0] + row + filters.down.size // 2) * width + first
            _filter_stretch(tall[row, first:], flat, start, width, size, filters.down)
    # Filter across, where all taps lie on the plate.
    for row in range(count):
        to = (rows[0] + row) * (columns - 2 * margin) * lanes
        for first in range(0, inner, BLOCK):
            start, size = margin * channels + first, min(BLOCK, inner - first)
            if lanes == channels:
                _filter_stretch(result[to + first :], tall[row], start, channels, size,
                                filters.across)  # fmt: skip
            else:
                _filter_stretch(line, tall[row], start, channels, size, filters.across)
                _spread(line, 0, size // channels, channels, result, to)
                to += size // channels * lanes


@inner_kernel
def _spread(flat: Floats, at: int, count: int, channels: int, result: Floats, first: int) -> None:
    """Copy samples of two or three numbers to places four numbers apart, filled up with zeros."""
    k, to, step = np.uint64(at), np.uint64(first), np.uint64(channels)
    one, zero = np.uint64(1), np.float32(0)
    for _ in range(count):
        result[to], result[to + one] = flat[k], flat[k + one]
        result[to + one + one] = flat[k + one + one] if channels > 2 else zero
        result[to + one + one + one] = zero
        k += step
        to += np.uint64(4)


@packed_kernel
def filter_plate(
    counter: Counter,
    flat: Floats,
    shape: tuple[int, int, int],
    filters: Filters,
    lanes: int,
    result: Floats,
) -> None:
    """Filter a plate along both axes.

    `flat`: rows × columns × channels, given by `shape`. `filters`: K taps across and L down.
    `lanes`: numbers of a sample in the result: its channels, or four with zeros at the end.
    `result`: as `flat`, filled, with L // 2 rows and K // 2 columns less on each side; it may be
    longer.
    """
    height = shape[0] - 2 * (filters.down.size // 2)
    for rows in bands(counter, height, BAND):
        _filter_rows(flat, shape, filters, rows, lanes, result)


TOGETHER = 16  # numbers of a row that are written at a time
SECTION = 64  # weights of a pixel that are summed on their own
ROWS = 32  # of a tile; numbers side by side once it is transposed


class AxisTaps(NamedTuple):
    """Weights of the samples that pixels along one axis read."""

    first: Integers  # (N,) first sample of each
    weight: Floats  # N × taps
    taps: int  # samples that a pixel reads
    share: Floats  # (N,) share of the pixel that lies on the source


class TileSizes(NamedTuple):
    """Sizes of tiles, and of the scratch for them."""

    wide: int  # px
    line: int  # numbers of a grid's row that a tile reads, at most
    beside: int  # numbers of a row of corners that limit a tile; 0: there are none
    corners: int  # numbers of all these corners


class SeparableGrid(NamedTuple):
    """A grid, and the part that pixels read along both axes."""

    flat: Floats  # rows × columns × channels
    columns: int
    channels: int
    down: AxisTaps
    across: AxisTaps
    limits: Limits  # of an interpolation that rings; excess below 0: none
    limits_down: AxisTaps  # weights of the corners between samples; see `limits`
    limits_across: AxisTaps
    beside_down: AxisTaps  # weights of the two samples beside pixels; no taps: limits alone hold
    beside_across: AxisTaps


class TileScratch(NamedTuple):
    """Scratch for one tile."""

    lines: Floats  # rows of the grid, weighted down
    turned: Floats  # the same, transposed
    total: Floats  # columns × channels × ROWS
    low: Floats  # limits of the totals
    high: Floats
    corners: Corners


@inner_kernel
def _add_two(
    line: Floats,
    source: Floats,
    places: tuple[int, int, int],
    count: int,
    weights: tuple[Single, Single],
    is_first: bool,
) -> None:
    """Add two stretches, each times a weight, to a line, or set it to their sum."""
    to, a, b = np.uint64(places[0]), np.uint64(places[1]), np.uint64(places[2])
    s, t = weights
    if is_first:
        for n in range(count):
            k = np.uint64(n)
            line[to + k] = s * source[a + k] + t * source[b + k]
    else:
        for n in range(count):
            k = np.uint64(n)
            line[to + k] += s * source[a + k] + t * source[b + k]


@inner_kernel
def _sum(
    line: Floats,
    to: int,
    source: Floats,
    places: tuple[int, int, int],
    taps: AxisTaps,
    weights: tuple[int, int],
) -> None:
    """Set a stretch of a line to a weighted sum of stretches of a source.

    `places`: first number of the source's first stretch, numbers from one stretch to the next, and
    numbers in a stretch. `weights`: first weight, and last + 1.
    """
    weight, (at, step, count), (first, last) = taps.weight, places, weights
    # Take pairs; the first sets the line. Of an odd number the last is its own pair.
    for k in range(first, last, 2):
        other = weight[k + 1] if k + 1 < last else np.float32(0)
        here = at + (k - first) * step
        there = here + step if k + 1 < last else here
        _add_two(line, source, (to, here, there), count, (weight[k], other), k == first)


@inner_kernel
def _sum_sections(
    total: Floats, to: int, source: Floats, places: tuple[int, int], taps: AxisTaps, pixel: int
) -> None:
    """Sum the columns that a pixel reads, in sections, to limit rounding errors."""
    at, step = places
    first = pixel * taps.taps
    last, middle = first + taps.taps, min(first + SECTION, first + taps.taps)
    # The first section sets the column.
    _sum(total, to, source, (at, step, ROWS), taps, (first, middle))
    # Others are summed on their own, in numbers to spare, and added.
    spare = total.size - ROWS
    while middle < last:
        after = min(middle + SECTION, last)
        here = at + (middle - first) * step
        _sum(total, spare, source, (here, step, ROWS), taps, (middle, after))
        for n in range(ROWS):
            total[to + n] += total[spare + n]
        middle = after


@inner_kernel
def _read_by(taps: AxisTaps, first: int, last: int) -> tuple[int, int]:
    """First sample that some pixels read, and last + 1."""
    low = high = taps.first[first]
    for n in range(first, last):
        low, high = min(low, taps.first[n]), max(high, taps.first[n])
    return low, high + taps.taps


@inner_kernel
def _transpose(lines: Floats, width: int, height: int, turned: Floats) -> None:
    """Transpose rows of a width into columns of ROWS numbers; `height` of them are set."""
    step, to = np.uint64(width), np.uint64(0)
    for k in range(width):
        at = np.uint64(k)
        for row in range(height):
            turned[to + np.uint64(row)] = lines[at]
            at += step
        to += np.uint64(ROWS)


@inner_kernel
def _weigh(
    flat: Floats,
    form: tuple[int, int, int, int],
    taps: tuple[AxisTaps, AxisTaps],
    tile: tuple[int, int, int, int],
    scratch: TileScratch,
    total: Floats,
) -> None:
    """Sum a grid for a tile of pixels, into `total`, columns × channels × ROWS.

    `form`: columns and channels of the grid in memory, and its first column and row. `tile`: left,
    top, right and bottom, px.
    """
    columns, channels, before, above = form
    down, across = taps
    left, top, right, bottom = tile
    # Find the columns of the grid that the tile reads.
    low, high = _read_by(across, left, right)
    width, height = (high - low) * channels, bottom - top
    # Sum down, row by row.
    for row in range(height):
        at = ((down.first[top + row] - above) * columns + low - before) * channels
        first = (top + row) * down.taps
        places = at, columns * channels, width
        _sum(scratch.lines, row * width, flat, places, down, (first, first + down.taps))
    # Transpose, so that rows lie side by side.
    _transpose(scratch.lines, width, height, scratch.turned)
    # Sum across, channel by channel.
    for x in range(left, right):
        for c in range(channels):
            at = ((across.first[x] - low) * channels + c) * ROWS
            to = ((x - left) * channels + c) * ROWS
            _sum_sections(total, to, scratch.turned, (at, channels * ROWS), across, x)


@inner_step
def _weighed(flat: Floats, form: tuple[int, int, int], down: AxisTaps, across: AxisTaps,
             pixel: tuple[int, int]) -> Single:  # fmt: skip
    """Weighted sum of a grid for one channel of one pixel (row, column).

    `form`: columns and channels of the grid, and the channel.
    """
    (columns, channels, channel), (row, x) = form, pixel
    step, total = np.uint64(channels), np.float32(0)
    at = np.uint64((down.first[row] * columns + across.first[x]) * channels + channel)
    first = np.uint64(x * across.taps)
    for k in range(down.taps):
        line, here = np.float32(0), at
        for n in range(across.taps):
            line += across.weight[first + np.uint64(n)] * flat[here]
            here += step
        total += down.weight[row * down.taps + k] * line
        at += np.uint64(columns) * step
    return total


@inner_step
def _straighten_pixel(grid: SeparableGrid, pixel: tuple[int, int], to: int, marks: int,
                      scratch: TileScratch) -> None:  # fmt: skip
    """Keep a pixel (row, column) near the means across straight edges."""
    row, x = pixel
    across, down, plain, channels = (
        grid.limits_across, grid.limits_down, grid.limits.plain, grid.channels
    )  # fmt: skip
    # Place among the four corners around.
    at = (down.first[row] * plain.stride + across.first[x]) * channels - plain.before
    steps = np.uint64(channels), np.uint64(plain.stride * channels)
    part_x, part_y = across.weight[2 * x + 1], down.weight[2 * row + 1]
    faint = np.float32(grid.limits.faint)
    for c in range(channels):
        k, first, form = to + c * ROWS, np.uint64(at + c), (grid.columns, channels, c)
        low, high, total = scratch.low[k], scratch.high[k], scratch.total[k]
        one = other = np.float32(0)
        if marks & mark_of(c, True):
            varies = varies_between(plain.flat, first, steps, True, part_x, part_y)
            tolerance = tolerance_of(varies, low, high, faint)
            if tolerance < high - low:
                straight = _weighed(grid.flat, form, grid.down, grid.beside_across, pixel)
                one = towards(total, straight, tolerance)
        if marks & mark_of(c, False):
            varies = varies_between(plain.flat, first, steps, False, part_x, part_y)
            tolerance = tolerance_of(varies, low, high, faint)
            if tolerance < high - low:
                straight = _weighed(grid.flat, form, grid.beside_down, grid.across, pixel)
                other = towards(total, straight, tolerance)
        scratch.total[k] = total + both(one, other)


@inner_kernel
def _straighten_tile(
    grid: SeparableGrid, part: Part, tile: tuple[int, int, int, int], scratch: TileScratch
) -> None:
    """Straighten the pixels of a tile that are beside straight edges."""
    left, top, right, bottom = tile
    marks, first = scratch.corners.marks, grid.limits_across.first
    for row in range(top, bottom):
        # Skip rows of cells without marks.
        start = cell_of(part.wide, 0, grid.limits_down.first[row] - part.top)
        if marks[start - 1] == 0:
            continue
        start -= part.left
        for x in range(left, right):
            mark = marks[np.uint64(start + first[np.uint64(x)])]
            if mark:
                to = (x - left) * grid.channels * ROWS + row - top
                _straighten_pixel(grid, (row, x), to, mark, scratch)


@inner_kernel
def _clamp(grid: SeparableGrid, tile: tuple[int, int, int, int], scratch: TileScratch) -> None:
    """Clamp the sums of a tile to the limits of the samples around."""
    down, across = grid.limits_down, grid.limits_across
    left, top, right, bottom = tile
    # Compute the limits at the corners that the tile's pixels lie between.
    first, last = _read_by(across, left, right)
    above, below = _read_by(down, top, bottom)
    part = Part(first, above, last - first, below - above)
    has_edges = fill_corners(grid.limits, part, scratch.corners)
    # Interpolate them as the samples are, and clamp.
    form = part.wide, grid.channels, first, above
    taps = down, across
    _weigh(scratch.corners.low, form, taps, tile, scratch, scratch.low)
    _weigh(scratch.corners.high, form, taps, tile, scratch, scratch.high)
    if has_edges and grid.beside_down.taps > 0:
        _straighten_tile(grid, part, tile, scratch)
    total, low, high = scratch.total, scratch.low, scratch.high
    for n in range((right - left) * grid.channels * ROWS):
        total[n] = min(max(total[n], low[n]), high[n])


@inner_step
def _is_below_zero(numbers: Floats, first: Place, count: int) -> bool:
    """Whether any number of a stretch is below zero."""
    found = np.uint32(0)
    for n in range(count):
        found |= np.uint32(numbers[first + np.uint64(n)] < np.float32(0))
    return bool(found > 0)


@inner_kernel
def _keep_positive(
    grid: SeparableGrid, tile: tuple[int, int, int, int], scratch: TileScratch
) -> None:
    """Keep sums at or above zero where none of the samples that pixels read is below."""
    left, top, right, bottom = tile
    channels, total, count = grid.channels, scratch.total, (right - left) * grid.channels * ROWS
    if not _is_below_zero(total, np.uint64(0), count):
        return
    # Mostly no sample that the tile reads is.
    low, high = _read_by(grid.across, left, right)
    has_below = False
    for line in range(*_read_by(grid.down, top, bottom)):
        at = np.uint64((line * grid.columns + low) * channels)
        has_below |= _is_below_zero(grid.flat, at, (high - low) * channels)
    if not has_below:
        for n in range(count):
            total[n] = max(total[n], np.float32(0))
        return
    start: Place = np.uint64(0)
    for x in range(left, right):
        for channel in range(channels):
            for row in range(top, bottom):
                k: Place = start + np.uint64(row - top)
                if total[k] < np.float32(0):
                    total[k] = max(total[k], _least(grid, (row, x, channel), total[k]))
            start += np.uint64(ROWS)


@inner_step
def _least(grid: SeparableGrid, pixel: tuple[int, int, int], enough: Single) -> Single:
    """Least of zero and the samples that a pixel (row, column, channel) reads.

    Any of them that is not above `enough` will do.
    """
    row, x, channel = pixel
    least: Single = np.float32(0)
    step = np.uint64(grid.channels)
    first = (grid.down.first[row] * grid.columns + grid.across.first[x]) * grid.channels + channel
    for line in range(grid.down.taps):
        at: Place = np.uint64(first + line * grid.columns * grid.channels)
        for _ in range(grid.across.taps):
            least = min(least, grid.flat[at])
            if least <= enough:
                return least
            at += step
    return least


@inner_kernel
def _put(
    grid: SeparableGrid,
    tile: tuple[int, int, int, int],
    total: Floats,
    image: Floats,
    covered: Floats,
) -> None:
    """Put the sums of a tile into the picture, premultiplied by coverage."""
    left, top, right, bottom = tile
    down, across, channels = grid.down.share, grid.across.share, grid.channels
    width, count = across.size, (right - left) * channels
    first = (top * width + left) * channels
    # Copy columns of ROWS numbers to rows, a few at a time, which fill a line of the cache.
    step, block, rows = np.uint64(width * channels), count // TOGETHER * TOGETHER, bottom - top
    for start in range(0, block, TOGETHER):
        to, source = np.uint64(first + start), np.uint64(start * ROWS)
        for _ in range(rows):
            at = source
            for n in range(TOGETHER):
                image[to + np.uint64(n)] = total[at + np.uint64(n * ROWS)]
            to += step
            source += np.uint64(1)
    for k in range(block, count):
        to, source = np.uint64(first + k), np.uint64(k * ROWS)
        for _ in range(rows):
            image[to] = total[source]
            to += step
            source += np.uint64(1)
    for row in range(top, bottom):
        pixel = np.uint64(row * width + left)
        for x in range(left, right):
            share = down[row] * across[x]
            covered[pixel] = share
            if share != np.float32(1):
                at = pixel * np.uint64(channels)
                for c in range(channels):
                    image[at + np.uint64(c)] *= share
            pixel += np.uint64(1)


@packed_kernel
def weigh_grid(
    counter: Counter, grid: SeparableGrid, sizes: TileSizes, image: Floats, covered: Floats
) -> None:
    """Fill a picture, height × width × C, and its coverage with sums of a grid."""
    height, width, channels = grid.down.first.size, grid.across.first.size, grid.channels
    # Allocate the scratch of this thread.
    wide, line, beside, most = sizes
    pixels = wide * channels * ROWS
    limited = pixels + ROWS if beside > 0 else 0
    scratch = TileScratch(
        np.empty(line * ROWS, np.float32),
        np.zeros(line * ROWS, np.float32),
        np.empty(pixels + ROWS, np.float32),
        np.empty(limited, np.float32),
        np.empty(limited, np.float32),
        Corners(
            np.empty(most, np.float32),
            np.empty(most, np.float32),
            np.empty(2 * (beside + channels), np.float32),
            np.empty(2 * (beside + channels), np.float32),
            np.empty(most, np.float32),
            np.empty((beside // channels + 1) * (most // max(beside, 1) + 1), np.uint8),
        ),
    )
    tiles_across = -(-width // wide)
    for n in tasks(counter, tiles_across * -(-height // ROWS)):
        down, across = divmod(n, tiles_across)
        left, top = across * wide, down * ROWS
        tile = left, top, min(left + wide, width), min(top + ROWS, height)
        form = grid.columns, channels, 0, 0
        _weigh(grid.flat, form, (grid.down, grid.across), tile, scratch, scratch.total)
        if beside > 0:
            _clamp(grid, tile, scratch)
        elif grid.limits.excess >= 0.0:
            _keep_positive(grid, tile, scratch)
        _put(grid, tile, scratch.total, image, covered)
