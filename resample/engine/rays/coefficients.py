"""Coefficients of the cubic spline that interpolates samples, and bounds of its values.

Unser, Splines: A Perfect Fit for Signal and Image Processing, 1999: along each axis a causal and an
anticausal recursive filter. The influence of a sample falls by 0.268 from one coefficient to the
next, so a slab of samples needs only `HALO` more on both sides, and slabs run in parallel.

Bounds: within a cell a spline lies between the least and the greatest of its Bernstein
coefficients. A cell has 4³ of them and shares all but 3³ with its neighbours.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import (
    Counter,
    inner_step,
    kernel,
    lane_kernel,
    parallel_kernel,
    tasks,
    when_compiling,
)
from resample.engine.rays.weights import SLOPES, WEIGHTS
from resample.engine.vectors import Vector
from resample.types import Bounds, Coefficients, Flags, Floats, Indices, Single, SplineField

PAD = 2  # samples by which an array of coefficients is extended on each side

Four = tuple[Single, Single, Single, Single]


class StoredCoefficients(NamedTuple):
    """Coefficients of one of two types; the other array is empty."""

    short: NDArray[np.uint16]  # (N,) or (0,)
    long: Floats  # (0,) or (N,)


def bundled(flat: NDArray[Any]) -> StoredCoefficients:
    """Put coefficients of either type into one bundle for one kernel."""
    if flat.dtype == np.uint16:
        return StoredCoefficients(flat, np.empty(0, np.float32))
    return StoredCoefficients(np.empty(0, np.uint16), flat)


def sums_at(
    coefficient: StoredCoefficients,
    strides: tuple[np.uint64, np.uint64],
    cell: tuple[np.uint64, np.uint64, np.uint64],
    fraction: tuple[Single, Single, Single],
) -> Four:
    """Weighted sum of the 4 × 4 × 4 coefficients of a cell, and its derivatives along x, y and z.

    `strides`: from one row to the next, and from one plane to the next. Kernels compute it by
    operations on vectors (`spline_vectors`).
    """
    row, plane = (int(stride) for stride in strides)
    first = int(cell[2]) * plane + int(cell[1]) * row + int(cell[0])
    four, flat = np.arange(4), coefficient.short if coefficient.short.size else coefficient.long
    taps = flat[first + plane * four[:, None, None] + row * four[:, None] + four]
    powers = [np.power(float(part), four) for part in fraction]
    x, y, z = (np.float32(power @ np.array(WEIGHTS)) for power in powers)
    across, down, deep = (np.float32(power[:3] @ np.array(SLOPES)) for power in powers)
    pairs = ((x, y, z), (across, y, z), (x, down, z), (x, y, deep))
    one, two, three, four_ = (np.einsum("kji,i,j,k", np.float32(taps), *each) for each in pairs)
    return one, two, three, four_


def ends_at(
    coefficient: StoredCoefficients,
    strides: tuple[np.uint64, np.uint64],
    cell: tuple[np.uint64, np.uint64, np.uint64],
    fraction: tuple[Single, Single, Single],  # noqa: ARG001  as in `sums_at`
) -> Four:
    """Least of the eight samples around a cell, and the least of them negated, twice each."""
    corners = np.argwhere(np.ones((2, 2, 2))).astype(np.float32)
    samples = [sums_at(coefficient, strides, cell, (x, y, z))[0] for x, y, z in corners]
    least, most = min(samples), -max(samples)
    return least, most, least, most


@when_compiling
def _compile_as_vectors() -> None:
    from resample.engine.rays import spline_vectors

    spline_vectors.define(sums_at, ends_at)


@inner_step
def _sums_at(flat: SplineField, place: Vector) -> Four:
    """Sums of coefficients at a position within a field."""
    i, j, k = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    fraction = (np.float32(place[0] - i), np.float32(place[1] - j), np.float32(place[2] - k))
    strides = (np.uint64(flat.row), np.uint64(flat.plane))
    coefficient: Any = flat.coefficient  # in kernels as `bundled` makes it
    return sums_at(coefficient, strides, (i, j, k), fraction)


@inner_step
def value_at(flat: SplineField, place: Vector) -> float:
    """Value of a field at a position within it, data units."""
    return flat.zero + flat.scale * float(_sums_at(flat, place)[0])


@inner_step
def value_and_slope_at(flat: SplineField, place: Vector) -> tuple[float, Vector]:
    """Value of a field at a position within it, and its gradient, data units per sample."""
    value, x, y, z = _sums_at(flat, place)
    scale = flat.scale
    slope = scale * float(x), scale * float(y), scale * float(z)
    return flat.zero + scale * float(value), slope


@inner_step
def samples_around(flat: SplineField, place: Vector) -> tuple[float, float]:
    """Least and greatest of the eight samples around a position, data units."""
    cell = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    strides, no = (np.uint64(flat.row), np.uint64(flat.plane)), np.float32(0)
    coefficient: Any = flat.coefficient
    least, most, _, _ = ends_at(coefficient, strides, cell, (no, no, no))
    return flat.zero + flat.scale * float(least), flat.zero - flat.scale * float(most)


SLAB = 48  # samples of the slowest axis that are filtered together
HALO = 14  # samples on both sides of a slab; 0.268¹⁴ is 1e-8
BRICK = 4  # cells per side of a brick, a power of 2
# Pole and gain of the cubic B-spline's inverse filter.
POLE = math.sqrt(3.0) - 2.0
_POLE, _GAIN = np.float32(POLE), np.float32(6.0)
_END = np.float32(POLE / (POLE - 1.0))  # start of the way back, for samples mirrored at the end
MOST = np.float32(65535.0)  # of 16 bits


class LatticeSamples(NamedTuple):
    """Samples (Z, Y, X) of one of these types, and (0, 0, 0) of all others; read only."""

    uint8: NDArray[np.uint8]
    int8: NDArray[np.int8]
    uint16: NDArray[np.uint16]
    int16: NDArray[np.int16]
    float32: Floats


def values_of(given: NDArray[Any]) -> LatticeSamples:
    """Put samples of any type into one bundle for one kernel."""
    arrays = {name: np.empty((0, 0, 0), name) for name in LatticeSamples._fields}
    for array in arrays.values():
        array.setflags(write=False)
    return LatticeSamples(**arrays | {given.dtype.name: given})


class Form(NamedTuple):
    """How coefficients are stored: (c − zero) × per_scale, c being above the least value."""

    low: float  # data units, the least value
    zero: Single
    per_scale: Single
    sharpness: Single  # 1: the spline passes through the samples, 0: these are the coefficients
    is_whole: bool  # stored as integers of 16 bits


@kernel
def _mirrored(n: int, count: int) -> int:
    """Index of the sample that sample n mirrors."""
    period = 2 * count
    n %= period
    return n if n < count else period - 1 - n


@kernel
def _first_of(line: Floats, stride: int, count: int, at: int) -> float:
    """Start of the causal filter: mirrored samples, weighed by powers of the pole."""
    total, power = float(line[at]), POLE
    # The mirror image of sample n lies at -1 - n.
    for n in range(2 * HALO):
        total += power * float(line[at + _mirrored(n, count) * stride])
        power *= POLE
    return total


@lane_kernel
def _filter_rows(part: Floats, count: int, stride: int, width: int) -> None:
    """Filter `count` rows of `width` numbers, `stride` apart, across the rows; in place."""
    # Start the causal filter in every column.
    for i in range(width):
        part[np.uint64(i)] = np.float32(_first_of(part, stride, count, i))
    # Causal pass: each row adds the one before it, times the pole.
    for n in range(1, count):
        at, before = np.uint64(n * stride), np.uint64((n - 1) * stride)
        for i in range(width):
            k = np.uint64(i)
            part[at + k] += _POLE * part[before + k]
    # Start the anticausal filter at the last row.
    last = np.uint64((count - 1) * stride)
    for i in range(width):
        part[last + np.uint64(i)] *= _GAIN * _END
    # Anticausal pass: each row takes the one after it, times the pole, and the gain.
    for n in range(count - 2, -1, -1):
        at, after = np.uint64(n * stride), np.uint64((n + 1) * stride)
        for i in range(width):
            k = np.uint64(i)
            part[at + k] = _POLE * (part[after + k] - _GAIN * part[at + k])


@kernel
def _filter_line(part: Floats, at: int, count: int) -> None:
    """Filter contiguous numbers in place; as `_filter_rows`, for one line."""
    # Causal pass.
    part[at] = np.float32(_first_of(part, 1, count, at))
    for n in range(at + 1, at + count):
        part[n] += _POLE * part[n - 1]
    # Anticausal pass.
    part[at + count - 1] *= _GAIN * _END
    for n in range(at + count - 2, at - 1, -1):
        part[n] = _POLE * (part[n + 1] - _GAIN * part[n])


@kernel
def _taken(values: LatticeSamples, low: float, first: int, last: int, part: Floats) -> None:
    """Copy planes first..last of the samples, minus the least value, into `part`."""
    # Compile one loop per type; exactly one of the arrays holds samples.
    if values.uint8.size > 0:
        _raised(values.uint8, low, first, last, part)
    elif values.int8.size > 0:
        _raised(values.int8, low, first, last, part)
    elif values.uint16.size > 0:
        _raised(values.uint16, low, first, last, part)
    elif values.int16.size > 0:
        _raised(values.int16, low, first, last, part)
    else:
        _raised(values.float32, low, first, last, part)


@kernel
def _raised(values: NDArray[Any], low: float, first: int, last: int, part: Floats) -> None:
    """As `_taken`, for one type."""
    _, height, width = values.shape
    n = 0
    for k in range(first, last):
        for j in range(height):
            for i in range(width):
                part[n] = np.float32(float(values[k, j, i]) - low)
                n += 1


@kernel
def _filter_plane(plane: Floats, height: int, width: int) -> None:
    """Filter a plane along both its axes."""
    _filter_rows(plane, height, width, width)
    for j in range(height):
        _filter_line(plane, j * width, width)


@kernel
def _store_plane(
    plane: Floats, samples: Floats, to: Form, size: tuple[int, int], k: int, flat: Coefficients
) -> int:
    """Store a plane as the k-th one, padded by mirroring; return how many values were clipped."""
    height, width = size
    across = width + 2 * PAD
    start, cut = k * (height + 2 * PAD) * across, 0
    # Walk over the padded plane; each element reads its mirror source.
    for j in range(-PAD, height + PAD):
        source = _mirrored(j, height) * width
        at = start + (j + PAD) * across
        for i in range(-PAD, width + PAD):
            n = source + _mirrored(i, width)
            # Mix coefficients and samples by sharpness, and scale to stored integers.
            mixed = to.sharpness * plane[n] + (np.float32(1.0) - to.sharpness) * samples[n]
            raw = (mixed - to.zero) * to.per_scale
            # Clip to 16 bits, and round.
            if to.is_whole:
                held = min(MOST, max(np.float32(0.0), raw))
                cut += int(held != raw)
                raw = held + np.float32(0.5)
            flat[at + PAD + i] = flat.dtype.type(raw)
    return cut


@kernel
def _filter_slab(
    slab: int, values: LatticeSamples, shape: tuple[int, int, int], to: Form, flat: Coefficients
) -> int:
    """Find and store the coefficients of a slab of planes; return how many were clipped."""
    depth, height, width = shape
    # Load the slab and its halo.
    begin, end = slab * SLAB, min(depth, (slab + 1) * SLAB)
    first, last = max(0, begin - HALO), min(depth, end + HALO)
    area, cut = height * width, 0
    part = np.empty((last - first) * area, np.float32)
    samples = np.empty(area, np.float32)
    _taken(values, to.low, first, last, part)
    # Filter across planes, then within each plane of the slab proper.
    _filter_rows(part, last - first, area, area)
    for k in range(begin, end):
        plane = part[(k - first) * area : (k - first + 1) * area]
        _filter_plane(plane, height, width)
        # Reload the samples, which the filter has overwritten, and store the plane with its
        # mirrored copies.
        _taken(values, to.low, k, k + 1, samples)
        for copy in range(-PAD, depth + PAD):
            is_near = k - PAD <= copy <= k + PAD or k < PAD or k >= depth - PAD
            if is_near and _mirrored(copy, depth) == k:
                cut += _store_plane(plane, samples, to, (height, width), copy + PAD, flat)
    return cut


@parallel_kernel
def find_coefficients(
    counter: Counter,
    values: LatticeSamples,
    shape: tuple[int, int, int],
    to: Form,
    flat: Coefficients,
    cut: Indices,
) -> None:
    """Find the coefficients of the cubic spline that interpolates all samples.

    `values`: all finite. `shape`: Z, Y and X. `to`: how coefficients are stored. `flat`: ((Z + 2
    PAD) (Y + 2 PAD) (X + 2 PAD),) filled. `cut`: (slabs,) filled: how many coefficients were
    clipped to the stored range.
    """
    for slab in tasks(counter, cut.size):
        cut[slab] = _filter_slab(slab, values, shape, to, flat)


@lane_kernel
def _bernstein_plane(
    flat: Coefficients, at: int, stride: int, kind: int, count: int, line: Floats
) -> None:
    """Bernstein coefficients of one `kind`, of three per cell, along the axis of a stride."""
    # Pick the weights of the three B-spline coefficients around the cell.
    one, two, step = np.uint64(at), np.uint64(at + stride), np.uint64(2 * stride)
    a, b, c = np.float32(1 / 6), np.float32(2 / 3), np.float32(1 / 6)
    if kind == 1:
        a, b, c = np.float32(0.0), np.float32(2 / 3), np.float32(1 / 3)
    elif kind == 2:
        a, b, c = np.float32(0.0), np.float32(1 / 3), np.float32(2 / 3)
    # Weigh lines of coefficients; contiguous, so that they become lanes.
    for i in range(count):
        k = np.uint64(i)
        line[k] = a * flat[one + k] + b * flat[two + k] + c * flat[one + step + k]


@lane_kernel
def _spread(line: Floats, count: int, least: Floats, greatest: Floats) -> None:
    """Bounds of a row of cells by the four Bernstein coefficients of each along x."""
    third, two_thirds = np.float32(1 / 3), np.float32(2 / 3)
    sixth, most = np.float32(1 / 6), np.float32(2 / 3)
    # Convert four B-spline coefficients to the cell's four Bernstein coefficients.
    for i in range(count):
        k = np.uint64(i)
        c0, c1 = line[k], line[k + np.uint64(1)]
        c2, c3 = line[k + np.uint64(2)], line[k + np.uint64(3)]
        b0, b3 = sixth * (c0 + c2) + most * c1, sixth * (c1 + c3) + most * c2
        b1, b2 = two_thirds * c1 + third * c2, third * c1 + two_thirds * c2
        # Take least and greatest of the four.
        below, above = b0 if b0 < b1 else b1, b1 if b0 < b1 else b0
        under, over = b2 if b2 < b3 else b3, b3 if b2 < b3 else b2
        least[k] = below if below < under else under
        greatest[k] = above if above > over else over


@lane_kernel
def _widen(least: Floats, greatest: Floats, by_least: Floats, by_greatest: Floats) -> None:
    """Widen bounds of a row of cells by others."""
    for i in range(by_least.size):
        k = np.uint64(i)
        least[k] = by_least[k] if by_least[k] < least[k] else least[k]
        greatest[k] = by_greatest[k] if by_greatest[k] > greatest[k] else greatest[k]


class BrickRow(NamedTuple):
    """Bricks beside each other along x, and scratch."""

    k: int  # bricks before them along z
    j: int  # bricks before them along y
    first: int  # bricks before them along x
    cells: int  # of a row of them; the last brick may have fewer
    planes: int  # of cells
    rows: int  # of cells
    mixed: Floats  # (BRICK + 3, X + 2 PAD)
    line: Floats  # (3, X + 2 PAD)
    least: Floats  # (BRICK², X + 2 PAD) of cells
    greatest: Floats


@kernel
def _brick_row(
    k: int, j: int, first: int, end: int, shape: tuple[int, int, int], room: Floats
) -> BrickRow:
    """Lay out a row of bricks in scratch of (2 BRICK² + BRICK + 6, X + 2 PAD)."""
    depth, height, width = shape
    square, begin = BRICK * BRICK, BRICK + 6
    return BrickRow(
        k, j, first,
        min(width + 1, end * BRICK) - first * BRICK,
        min(BRICK, depth + 1 - k * BRICK), min(BRICK, height + 1 - j * BRICK),
        room[: BRICK + 3], room[BRICK + 3 : begin],
        room[begin : begin + square], room[begin + square :],
    )  # fmt: skip


@kernel
def _bound_cells(bricks: BrickRow, flat: StoredCoefficients, shape: tuple[int, int, int]) -> None:
    """Bound the spline in each cell of a row of bricks."""
    # Count coefficients along x, cells, and coefficients of a plane.
    across = shape[2] + 2 * PAD
    count, plane = bricks.cells + 3, (shape[1] + 2 * PAD) * across
    bricks.least[:] = np.inf
    bricks.greatest[:] = -np.inf
    line, one, two = bricks.line[0], bricks.line[1, : bricks.cells], bricks.line[2, : bricks.cells]
    # Convert to Bernstein form along z, for each row that the bricks need.
    start = bricks.k * BRICK * plane + bricks.j * BRICK * across + bricks.first * BRICK
    for along in range(3 * bricks.planes + 1):
        for row in range(bricks.rows + 3):
            begin, kind = start + along // 3 * plane + row * across, along % 3
            if flat.short.size > 0:
                _bernstein_plane(flat.short, begin, plane, kind, count, bricks.mixed[row])
            else:
                _bernstein_plane(flat.long, begin, plane, kind, count, bricks.mixed[row])
        # Convert along y, then along x, and widen the bounds of all cells that share the line.
        level = bricks.mixed.reshape(-1)
        for down in range(3 * bricks.rows + 1):
            _bernstein_plane(level, (down // 3) * across, across, down % 3, count, line)
            _spread(line, bricks.cells, one, two)
            for n in range(max(0, (along - 1) // 3), min(along // 3 + 1, bricks.planes)):
                for m in range(max(0, (down - 1) // 3), min(down // 3 + 1, bricks.rows)):
                    cells = n * BRICK + m
                    _widen(bricks.least[cells], bricks.greatest[cells], one, two)


@parallel_kernel
def find_bounds(
    counter: Counter, flat: StoredCoefficients, shape: tuple[int, int, int], bounds: Bounds
) -> None:
    """Find the least and greatest value of a spline in each brick, in units of its coefficients.

    `flat`: as in `find_coefficients`, by `bundled`. `shape`: samples along z, y and x. `bounds`:
    (⌈(Z + 1) / BRICK⌉, ...) filled.
    """
    planes, rows, across = bounds.least.shape
    room = np.empty((2 * BRICK * BRICK + BRICK + 6, shape[2] + 2 * PAD), np.float32)
    for task in tasks(counter, planes * rows):
        k, j = task // rows, task % rows
        bricks = _brick_row(k, j, 0, across, shape, room)
        _bound_cells(bricks, flat, shape)
        for i in range(across):
            part = slice(i * BRICK, min(bricks.cells, (i + 1) * BRICK))
            bounds.least[k, j, i] = bricks.least[:, part].min()
            bounds.greatest[k, j, i] = bricks.greatest[:, part].max()


class VisibleValues(NamedTuple):
    """Visible values of a spline, in units of its coefficients."""

    zero: float  # column of the coefficient 0
    scale: float  # columns
    visible: Indices  # (K + 1,) prefix count of columns that are visible


@kernel
def _bits_of(bricks: BrickRow, i: int, values: VisibleValues) -> np.uint64:
    """Bits of the cells of a brick: whether any value within their bounds is visible."""
    bits, last = np.uint64(0), values.visible.size - 2
    for k in range(bricks.planes):
        for j in range(bricks.rows):
            for n in range(i * BRICK, min(bricks.cells, (i + 1) * BRICK)):
                least = values.zero + values.scale * bricks.least[k * BRICK + j, n]
                greatest = values.zero + values.scale * bricks.greatest[k * BRICK + j, n]
                first = int(min(max(0.0, least), float(last)))
                end = math.ceil(min(max(0.0, greatest), float(last)))
                if values.visible[end + 1] > values.visible[first]:
                    bits |= np.uint64(1) << np.uint64((k * BRICK + j) * BRICK + n - i * BRICK)
    return bits


@parallel_kernel
def find_visible_cells(
    counter: Counter,
    flat: StoredCoefficients,
    shape: tuple[int, int, int],
    values: VisibleValues,
    seen: Flags,
    cells: NDArray[np.uint64],
) -> None:
    """Find the cells in which a spline may be visible, as bits: x fastest, BRICK³ per brick.

    `flat`, `shape`: as in `find_bounds`. `seen`: (z, y, x) bricks that may be visible. `cells`:
    (z, y, x) zeros, filled.
    """
    planes, rows, across = seen.shape
    room = np.empty((2 * BRICK * BRICK + BRICK + 6, shape[2] + 2 * PAD), np.float32)
    for task in tasks(counter, planes * rows):
        k, j = task // rows, task % rows
        first, end = 0, across
        while first < end and not seen[k, j, first]:
            first += 1
        while first < end and not seen[k, j, end - 1]:
            end -= 1
        if first < end:
            bricks = _brick_row(k, j, first, end, shape, room)
            _bound_cells(bricks, flat, shape)
            for i in range(first, end):
                if seen[k, j, i]:
                    cells[k, j, i] = _bits_of(bricks, i - first, values)


BEFORE = ((-1, -1), (-1, 0), (-1, 1), (0, -1))  # steps (z, y) to the rows that come before a row


@kernel
def find_next_bricks(away: NDArray[np.uint8]) -> None:
    """Replace 255 by the distance to the nearest 0 along any axis, at most 255.

    `away`: (z, y, x) 0 or 255. Distances pass on to neighbours, in the order of bricks and back.
    """
    deep, down, across = away.shape
    near = np.empty(across + 2, np.uint8)  # least of the rows before, with one brick on each side
    for sign in (1, -1):
        for row in range(deep * down):
            k, j = divmod(row if sign > 0 else deep * down - 1 - row, down)
            near[:] = 255
            for step in BEFORE:
                z, y = k + sign * step[0], j + sign * step[1]
                if 0 <= z < deep and 0 <= y < down:
                    for i in range(across):
                        near[i + 1] = min(near[i + 1], away[z, y, i])
            last = np.int64(254)
            for n in range(across):
                i = n if sign > 0 else across - 1 - n
                around = min(np.int64(near[i]), np.int64(near[i + 1]), np.int64(near[i + 2]))
                last = min(np.int64(away[k, j, i]), min(around, last) + 1)
                away[k, j, i] = last


@kernel
def number_parts(part: NDArray[np.int64]) -> int:
    """Label connected cells (Z, Y, X), also by corners, from 1; return the number of parts.

    `part`: -1 where cells are filled, 0 where they are empty; gets the numbers.
    """
    waiting, count = [(0, 0, 0)], 0
    for first in np.ndindex(part.shape):
        if part[first] < 0:
            count += 1
            part[first] = count
            waiting.append(first)
            while len(waiting) > 1:
                k, j, i = waiting.pop()
                for z in range(max(k - 1, 0), min(k + 2, part.shape[0])):
                    for y in range(max(j - 1, 0), min(j + 2, part.shape[1])):
                        for x in range(max(i - 1, 0), min(i + 2, part.shape[2])):
                            if part[z, y, x] < 0:
                                part[z, y, x] = count
                                waiting.append((z, y, x))
    return count
