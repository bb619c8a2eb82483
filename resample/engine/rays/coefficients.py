"""From samples to the coefficients of a spline that passes through them, and bounds of the spline.

Unser, Splines: A Perfect Fit for Signal and Image Processing, 1999: along each axis a recursive
filter forth and one back. A sample's part in a coefficient falls by 0.268 from one to the next, so
a slab of samples needs no more than `HALO` around it, and slabs go in parallel.

Bounds: within a cell a spline lies between the least and the greatest of its Bernstein
coefficients, of which a cell has 4³ and shares all but 3³ with its neighbours.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, lane_kernel, parallel_kernel, tasks
from resample.engine.rays.splines import PAD
from resample.types import Bounds, Coefficients, Floats, Indices, Single

SLAB = 48  # samples of the slowest axis that are filtered together
HALO = 14  # samples around them; 0.268¹⁴ is 1e-8
BRICK = 4  # cells per side of a brick, a power of 2
POLE = math.sqrt(3.0) - 2.0
_POLE, _GAIN = np.float32(POLE), np.float32(6.0)
_END = np.float32(POLE / (POLE - 1.0))  # what is mirrored about half a sample beyond the end
MOST = np.float32(65535.0)  # of 16 bits


class Values(NamedTuple):
    """Samples (Z, Y, X) of one of these types, and (0, 0, 0) of all others; read only."""

    uint8: NDArray[np.uint8]
    int8: NDArray[np.int8]
    uint16: NDArray[np.uint16]
    int16: NDArray[np.int16]
    float32: Floats


def values_of(given: NDArray[Any]) -> Values:
    """Samples, read only, of any of the types, as one kernel takes them all."""
    arrays = {name: np.empty((0, 0, 0), name) for name in Values._fields}
    for array in arrays.values():
        array.setflags(write=False)
    return Values(**arrays | {given.dtype.name: given})


class Form(NamedTuple):
    """How coefficients are stored: (c − zero) × per_scale, c being above the least value."""

    low: float  # data units, the least value
    zero: Single
    per_scale: Single
    sharpness: Single  # 1: the spline passes through the samples, 0: these are the coefficients
    is_whole: bool  # in 16 bits


@kernel
def _mirrored(n: int, count: int) -> int:
    """Number of a sample that stands for one beyond the ends."""
    period = 2 * count
    n %= period
    return n if n < count else period - 1 - n


@kernel
def _first_of(line: Floats, stride: int, count: int, at: int) -> float:
    """Sum of a line that is mirrored before its first number, weighed by powers of the pole."""
    total, power = float(line[at]), POLE
    # The mirror image of sample n lies at -1 - n.
    for n in range(2 * HALO):
        total += power * float(line[at + _mirrored(n, count) * stride])
        power *= POLE
    return total


@lane_kernel
def _filter_rows(part: Floats, count: int, stride: int, width: int) -> None:
    """Filter (count) rows of `width` numbers, `stride` apart, along the rows' order."""
    for i in range(width):
        part[np.uint64(i)] = np.float32(_first_of(part, stride, count, i))
    for n in range(1, count):
        at, before = np.uint64(n * stride), np.uint64((n - 1) * stride)
        for i in range(width):
            k = np.uint64(i)
            part[at + k] += _POLE * part[before + k]
    last = np.uint64((count - 1) * stride)
    for i in range(width):
        part[last + np.uint64(i)] *= _GAIN * _END
    for n in range(count - 2, -1, -1):
        at, after = np.uint64(n * stride), np.uint64((n + 1) * stride)
        for i in range(width):
            k = np.uint64(i)
            part[at + k] = _POLE * (part[after + k] - _GAIN * part[at + k])


@kernel
def _filter_line(part: Floats, at: int, count: int) -> None:
    """Filter numbers that stand side by side."""
    part[at] = np.float32(_first_of(part, 1, count, at))
    for n in range(at + 1, at + count):
        part[n] += _POLE * part[n - 1]
    part[at + count - 1] *= _GAIN * _END
    for n in range(at + count - 2, at - 1, -1):
        part[n] = _POLE * (part[n + 1] - _GAIN * part[n])


@kernel
def _taken(values: Values, low: float, first: int, last: int, part: Floats) -> None:
    """Samples of some planes as how far they are above the least one."""
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
    """As `_taken`, of one type."""
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
def _kept(
    plane: Floats, samples: Floats, to: Form, size: tuple[int, int], k: int, flat: Coefficients
) -> int:
    """Store a plane as the k-th one, with its mirror images around; gives how many were cut off."""
    height, width = size
    across = width + 2 * PAD
    start, cut = k * (height + 2 * PAD) * across, 0
    for j in range(-PAD, height + PAD):
        source = _mirrored(j, height) * width
        at = start + (j + PAD) * across
        for i in range(-PAD, width + PAD):
            n = source + _mirrored(i, width)
            mixed = to.sharpness * plane[n] + (np.float32(1.0) - to.sharpness) * samples[n]
            raw = (mixed - to.zero) * to.per_scale
            if to.is_whole:
                held = min(MOST, max(np.float32(0.0), raw))
                cut += int(held != raw)
                raw = held + np.float32(0.5)
            flat[at + PAD + i] = flat.dtype.type(raw)
    return cut


@kernel
def _filter_slab(
    slab: int, values: Values, shape: tuple[int, int, int], to: Form, flat: Coefficients
) -> int:
    """Coefficients of a slab of planes; gives how many were cut off."""
    depth, height, width = shape
    begin, end = slab * SLAB, min(depth, (slab + 1) * SLAB)
    first, last = max(0, begin - HALO), min(depth, end + HALO)
    area, cut = height * width, 0
    part = np.empty((last - first) * area, np.float32)
    samples = np.empty(area, np.float32)
    _taken(values, to.low, first, last, part)
    _filter_rows(part, last - first, area, area)
    for k in range(begin, end):
        plane = part[(k - first) * area : (k - first + 1) * area]
        _filter_plane(plane, height, width)
        _taken(values, to.low, k, k + 1, samples)
        for copy in range(-PAD, depth + PAD):
            is_near = k - PAD <= copy <= k + PAD or k < PAD or k >= depth - PAD
            if is_near and _mirrored(copy, depth) == k:
                cut += _kept(plane, samples, to, (height, width), copy + PAD, flat)
    return cut


@parallel_kernel
def find_coefficients(
    counter: Counter,
    values: Values,
    shape: tuple[int, int, int],
    to: Form,
    flat: Coefficients,
    cut: Indices,
) -> None:
    """Coefficients of a spline that passes through all samples.

    Parameters
    ----------
    values
        All finite.
    shape
        Z, Y and X.
    to
        How coefficients are stored.
    flat
        ((Z + 2 PAD) (Y + 2 PAD) (X + 2 PAD),) filled.
    cut
        (slabs,) filled: how many coefficients lay beyond what can be stored.
    """
    for slab in tasks(counter, cut.size):
        cut[slab] = _filter_slab(slab, values, shape, to, flat)


@lane_kernel
def _bernstein_plane(
    flat: Coefficients, at: int, stride: int, kind: int, count: int, line: Floats
) -> None:
    """Numbers `kind` of the three Bernstein coefficients of cells along an axis of that stride."""
    one, two, step = np.uint64(at), np.uint64(at + stride), np.uint64(2 * stride)
    a, b, c = np.float32(1 / 6), np.float32(2 / 3), np.float32(1 / 6)
    if kind == 1:
        a, b, c = np.float32(0.0), np.float32(2 / 3), np.float32(1 / 3)
    elif kind == 2:
        a, b, c = np.float32(0.0), np.float32(1 / 3), np.float32(2 / 3)
    for i in range(count):
        k = np.uint64(i)
        line[k] = a * flat[one + k] + b * flat[two + k] + c * flat[one + step + k]


@lane_kernel
def _spread(line: Floats, count: int, least: Floats, greatest: Floats) -> None:
    """Take the four Bernstein coefficients of cells in a row into account."""
    third, two_thirds = np.float32(1 / 3), np.float32(2 / 3)
    sixth, most = np.float32(1 / 6), np.float32(2 / 3)
    for i in range(count):
        k = np.uint64(i)
        c0, c1 = line[k], line[k + np.uint64(1)]
        c2, c3 = line[k + np.uint64(2)], line[k + np.uint64(3)]
        b0, b3 = sixth * (c0 + c2) + most * c1, sixth * (c1 + c3) + most * c2
        b1, b2 = two_thirds * c1 + third * c2, third * c1 + two_thirds * c2
        below, above = b0 if b0 < b1 else b1, b1 if b0 < b1 else b0
        under, over = b2 if b2 < b3 else b3, b3 if b2 < b3 else b2
        below, above = below if below < under else under, above if above > over else over
        least[k] = below if below < least[k] else least[k]
        greatest[k] = above if above > greatest[k] else greatest[k]


class Held(NamedTuple):
    """Coefficients of one of two types; there are none of the other."""

    short: NDArray[np.uint16]  # (N,) or (0,)
    long: Floats  # (0,) or (N,)


def held_as(flat: NDArray[Any]) -> Held:
    """Coefficients of either type, as one kernel takes both."""
    if flat.dtype == np.uint16:
        return Held(flat, np.empty(0, np.float32))
    return Held(np.empty(0, np.uint16), flat)


@kernel
def _bound_bricks(
    k: int, j: int, flat: Held, shape: tuple[int, int, int], room: Floats, bounds: Bounds
) -> None:
    """Bounds of a row of bricks."""
    depth, height, width = shape
    across, cells = width + 2 * PAD, width + 1
    plane = (height + 2 * PAD) * across
    rows = min(BRICK, height + 1 - j * BRICK)
    planes = min(BRICK, depth + 1 - k * BRICK)
    line, least, greatest = room[0], room[1], room[2]
    least[:] = np.inf
    greatest[:] = -np.inf
    mixed = room[3:]
    for along in range(3 * planes + 1):
        at = (k * BRICK + along // 3) * plane + j * BRICK * across
        for row in range(rows + 3):
            begin, kind = at + row * across, along % 3
            if flat.short.size > 0:
                _bernstein_plane(flat.short, begin, plane, kind, across, mixed[row])
            else:
                _bernstein_plane(flat.long, begin, plane, kind, across, mixed[row])
        level = mixed.reshape(-1)
        for down in range(3 * rows + 1):
            start = (down // 3) * mixed.shape[1]
            _bernstein_plane(level, start, mixed.shape[1], down % 3, across, line)
            _spread(line, cells, least, greatest)
    for i in range(bounds.least.shape[2]):
        part = slice(i * BRICK, min(cells, (i + 1) * BRICK))
        bounds.least[k, j, i] = least[part].min()
        bounds.greatest[k, j, i] = greatest[part].max()


@parallel_kernel
def find_bounds(counter: Counter, flat: Held, shape: tuple[int, int, int], bounds: Bounds) -> None:
    """Least and greatest value of a spline in each brick of cells, in units of its coefficients.

    Parameters
    ----------
    flat
        As of `find_coefficients`, by `held_as`.
    shape
        Samples along z, y and x.
    bounds
        (⌈(Z + 1) / BRICK⌉, ...) filled.
    """
    planes, rows, _ = bounds.least.shape
    room = np.empty((BRICK + 6, shape[2] + 2 * PAD), np.float32)
    for task in tasks(counter, planes * rows):
        _bound_bricks(task // rows, task % rows, flat, shape, room, bounds)
