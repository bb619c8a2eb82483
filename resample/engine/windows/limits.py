"""Limits of an interpolated grid, so that it rings less at hard edges.

Kernels with negative lobes overshoot beside edges and ring beyond. At a corner of samples the
limits are the least and the greatest of the four around. A sample that stands out from both its
neighbours along an axis widens them by as much, as the detail that it averages stands out farther;
not, however, where it stands out from flat ground, as hard-edged drawings do. Between corners
limits are bilinear, so clamping leaves no seams.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, kernel
from resample.engine.windows.boxes import Place, Plate, Whole
from resample.types import Doubles, Floats, Single

TOLERANCE = 2.0  # of the samples' variation along an edge: allowed excess of pixels
STRAIGHT = 1.0 / 128.0  # share of the limits' width that they may vary by before that fades
FADE = 256.0  # how fast
CHANNELS = 4  # with their own marks; others share these
ALONG_Y = CHANNELS  # bits from the mark of an edge along x to the mark along y

Marks = NDArray[np.uint8]  # of cells: a bit for each axis and channel
Corner = Any  # (column, row) among corners


@inner_step
def slack(varies: Single, low: Single, high: Single, faint: Single) -> Single:
    """Limits minus tolerance at a corner; 0 or below: not on a straight edge.

    Linear but for faint edges, so that between corners without slack there is none.
    """
    height = high - low
    fainter = max(faint + faint - height, np.float32(0))
    wanted = np.float32(1.0 + FADE * STRAIGHT) * (height - fainter)
    return wanted - np.float32(TOLERANCE + FADE) * varies


@inner_step
def tolerance_of(varies: Single, low: Single, high: Single, faint: Single) -> Single:
    """Tolerance around the mean across an edge, by the samples' variation along it.

    Edges up to the height `faint` are not limited, edges of twice that are.
    """
    height, zero = high - low, np.float32(0)
    beyond = max(varies - np.float32(STRAIGHT) * height, zero)
    fainter = max(faint + faint - height, zero)
    return np.float32(TOLERANCE) * varies + np.float32(FADE) * beyond + fainter


@inner_step
def towards(value: Single, straight: Single, tolerance: Single) -> Single:
    """Change that brings a value to within a tolerance around another."""
    return min(max(value, straight - tolerance), straight + tolerance) - value


@inner_step
def both(one: Single, other: Single) -> Single:
    """Combination of two changes; of two in one direction, the larger."""
    zero = np.float32(0)
    return max(one, other, zero) + min(one, other, zero)


@inner_step
def _step(flat: Floats, at: Place, along: Place, across: Place) -> Single:
    """Larger of the steps along an axis on both sides of a corner."""
    other = at - across
    return max(abs(flat[at] - flat[at - along]), abs(flat[other] - flat[other - along]))


@inner_step
def _varies(flat: Floats, at: Place, along: Place, across: Place) -> Single:
    """Variation of samples around a corner along an axis, on the side where it is smaller.

    Samples on one side suffice, as edges end.
    """
    before, after = _step(flat, at - along, along, across), _step(flat, at + along, along, across)
    return max(_step(flat, at, along, across), min(before, after))


@inner_step
def varies_between(flat: Floats, at: Place, steps: tuple[Place, Place], is_along_x: bool,
                   x: Single, y: Single) -> Single:  # fmt: skip
    """Variation of samples along an axis, between four corners; `at` is the first."""
    along, across = (steps[0], steps[1]) if is_along_x else (steps[1], steps[0])
    below = at + steps[1]
    left, right = (_varies(flat, at, along, across), _varies(flat, at + steps[0], along, across))
    upper = left + x * (right - left)
    left, right = (
        _varies(flat, below, along, across),
        _varies(flat, below + steps[0], along, across),
    )
    return upper + y * (left + x * (right - left) - upper)


@inner_step
def mark_of(channel: int, is_along_x: bool) -> int:
    """Mark of a channel's edge along an axis."""
    return 1 << ((channel & (CHANNELS - 1)) + (0 if is_along_x else ALONG_Y))


@inner_step
def cell_of(wide: int, column: int, row: int) -> int:
    """Index of the cell after a corner; the one before each row tells whether any is marked."""
    return (row + 1) * (wide + 1) + column + 1


@inner_kernel
def mark_row(
    plain: Plate,
    corner: Corner,
    wide: int,
    limits: tuple[Floats, Floats, Floats],
    row: int,
    faint: Single,
    marks: Marks,
) -> bool:
    """Mark the cells around corners of a row that are on straight edges.

    `corner`: column and row of the first corner in the plain grid. `limits`: least and greatest of
    all corners, and a bound of each one's `slack`. `row`: the row among the corners. `faint`:
    height of edges that are let be. Returns whether any is marked.
    """
    channels, low, high, bound = plain.channels, *limits
    across, down = np.uint64(channels), np.uint64(plain.stride * channels)
    first = np.uint64((corner[1] * plain.stride + corner[0]) * channels - plain.before)
    start, found = np.uint64(row * wide * channels), False
    for n in range(wide * channels):
        # Most corners are ruled out by the samples next to them.
        k = start + np.uint64(n)
        if bound[k] > np.float32(0):
            at, mark = first + np.uint64(n), 0
            column, channel = divmod(n, channels)
            if slack(_varies(plain.flat, at, across, down), low[k], high[k], faint) > np.float32(0):
                mark |= mark_of(channel, True)
            if slack(_varies(plain.flat, at, down, across), low[k], high[k], faint) > np.float32(0):
                mark |= mark_of(channel, False)
            if mark:
                _mark_around(marks, wide, column, row, mark)
                found = True
    return found


@inner_step
def _mark_around(marks: Marks, wide: int, column: int, row: int, mark: int) -> None:
    """Mark the four cells around a corner, and both rows of cells."""
    for at in (cell_of(wide, column - 1, row - 1), cell_of(wide, column - 1, row)):
        marks[at] |= mark
        marks[at + 1] |= mark
        marks[at - column] = 1


MOST = 96 * 96 * 12  # numbers of a tile's corners, at most
MOST_BESIDE = MOST // 24  # numbers in a row of samples, at most
SLOPE = 2.0  # multiple of the smaller step beyond its neighbours that a sample may stand out by
MARGIN = 3  # samples around a corner that its limits depend on


class Limits(NamedTuple):
    """The limiting grid, and how far values may exceed it."""

    plain: Plate  # samples themselves, not coefficients
    excess: float  # share of a sample's excess over its neighbours to add; below 0: no limits
    own: float = 0.0  # extent along an axis that a sample is the mean of; 0: a point
    faint: float = 0.0  # height of edges along which rings are not visible


class Part(NamedTuple):
    """The corners between samples of a plain grid for which limits are computed."""

    left: int
    top: int
    wide: int  # corners; 0: none
    high: int


class Corners(NamedTuple):
    """Scratch for the limits at the corners of a part of a grid."""

    low: Floats  # rows × columns × channels
    high: Floats
    above: Floats  # by how much samples stand out upward, in two rows
    below: Floats  # and downward
    bound: Floats  # of the `slack` beside straight edges; rows × columns × channels
    marks: Marks  # of the cells between corners, and of their rows; see `straight`


@inner_step
def _above(flat: Floats, at: Place, step: Place, sign: Single) -> Single:
    """Excess of a sample over both neighbours along an axis; below them if the sign is −1."""
    # The ground is as rough as the smaller of the steps beyond the neighbours.
    middle, before, after = flat[at], flat[at - step], flat[at + step]
    ground = min(abs(before - flat[at - step - step]), abs(after - flat[at + step + step]))
    return min(sign * (middle - before), sign * (middle - after), np.float32(SLOPE) * ground)


@inner_step
def _stand_out(flat: Floats, at: Place, steps: tuple[Place, Place], count: int, first: int,
               corners: Corners) -> None:  # fmt: skip
    """Excess of a row's samples over their neighbours along either axis."""
    zero, up, down = np.float32(0), np.float32(1), np.float32(-1)
    for n in range(count):
        k, m = at + np.uint64(n), np.uint64(first) + np.uint64(n)
        # Take the larger of the two axes, in both directions.
        over = _above(flat, k, steps[0], up), _above(flat, k, steps[1], up)
        under = _above(flat, k, steps[0], down), _above(flat, k, steps[1], down)
        corners.above[m] = max(over[0], over[1], zero)
        corners.below[m] = max(under[0], under[1], zero)


@inner_step
def _bound(flat: Floats, at: Place, steps: tuple[Place, Place], count: int, share: Single,
           faint: Single, first: int, corners: Corners) -> bool:  # fmt: skip
    """Limits at a row of corners; each corner is at the upper left of its sample.

    Returns whether any corner may be on a straight edge.
    """
    low, high, above, below, bound, _ = corners
    found = np.uint32(0)
    across, down, start = steps[0], steps[1], np.uint64(first)
    other = np.uint64(above.size >> 1)
    for n in range(count):
        # Load the four samples around the corner.
        k, m = at + np.uint64(n), np.uint64(n) + across
        a, b = flat[k - down - across], flat[k - down]
        c, d = flat[k - across], flat[k]
        # Widen their range by the mean excess of the four.
        least, most = min(a, b, c, d), max(a, b, c, d)
        if share > np.float32(0):
            over = above[m - across] + above[m] + above[other + m - across] + above[other + m]
            under = below[m - across] + below[m] + below[other + m - across] + below[other + m]
            least, most = least - share * under, most + share * over
        low[start + np.uint64(n)], high[start + np.uint64(n)] = least, most
        # They vary along an axis by no less than these four do.
        along_x, along_y = max(abs(b - a), abs(d - c)), max(abs(c - a), abs(d - b))
        beside = slack(min(along_x, along_y), least, most, faint)
        bound[start + np.uint64(n)] = beside
        found |= np.uint32(beside > np.float32(0))
    return bool(found > 0)


@inner_step
def _clear(marks: Marks, count: int) -> None:
    """Clear all marks."""
    for n in range(count):
        marks[n] = 0


@inner_kernel
def fill_corners(limits: Limits, part: Part, corners: Corners) -> bool:
    """Compute the limits at corners that have `MARGIN` samples around them.

    Returns whether any of them is on a straight edge; cells around those are marked.
    """
    # Unpack the grid; its steps are in numbers.
    flat, _, _, _, _, channels, columns, before = limits.plain
    left, top, wide, high = part
    steps = np.uint64(channels), np.uint64(columns * channels)
    count, half = wide * channels, corners.above.size >> 1
    share, faint = np.float32(0.25 * limits.excess), np.float32(limits.faint)
    has_edges = False
    is_cleared = False
    bounds = corners.low, corners.high, corners.bound
    # Keep two rows of the samples' excess, and bound the corners between them.
    for row in range(high + 1):
        at = np.uint64(((top - 1 + row) * columns + left) * channels - before)
        first = (row & 1) * half
        if share > np.float32(0):
            _stand_out(flat, at - steps[0], steps, count + channels, first, corners)
        if row > 0:
            may_be = _bound(flat, at, steps, count, share, faint, (row - 1) * count, corners)
            if may_be and not is_cleared:
                _clear(corners.marks, (wide + 1) * (high + 1))
                is_cleared = True
            if may_be:
                corner = left, top + row - 1
                has_edges |= mark_row(
                    limits.plain, corner, wide, bounds, row - 1, faint, corners.marks
                )
    return has_edges


@inner_kernel
def part_of(limits: Limits, bounds: Doubles) -> Part:
    """Corners around a tile's footprint; empty if too many.

    `bounds`: left, top, right and bottom in source coordinates.
    """
    # Clip to corners that have enough samples around.
    plain = limits.plain
    left, top = (
        max(bounds[0] - plain.left, float(MARGIN)),
        max(bounds[1] - plain.top, float(MARGIN)),
    )
    right = min(bounds[2] - plain.left + 1.0, float(plain.columns - MARGIN))
    bottom = min(bounds[3] - plain.top + 1.0, float(plain.rows - MARGIN))
    wide, high = right - math.floor(left) + 1.0, bottom - math.floor(top) + 1.0
    is_small = wide * high * plain.channels <= MOST and (wide + 1.0) * plain.channels <= MOST_BESIDE
    # Too large or too small; NaN counts as both.
    if not (wide >= 2.0 and high >= 2.0 and is_small):
        return Part(0, 0, 0, 0)
    return Part(int(left), int(top), int(wide), int(high))


@inner_kernel
def part_around(limits: Limits, u: float, v: float) -> Part:
    """The four corners around a position, in coordinates of the plain grid."""
    left, top = limits.plain.columns - MARGIN - 1, limits.plain.rows - MARGIN - 1
    return Part(min(max(int(u), MARGIN), left), min(max(int(v), MARGIN), top), 2, 2)


@inner_step
def _between(values: Floats, at: Place, steps: tuple[Place, Place], x: Single, y: Single) -> Single:
    """Interpolate bilinearly between four corners."""
    below = at + steps[1]
    upper = values[at] + x * (values[at + steps[0]] - values[at])
    lower = values[below] + x * (values[below + steps[0]] - values[below])
    return upper + y * (lower - upper)


@inner_step
def _four_between(
    values: Floats, at: Place, steps: tuple[Place, Place], x: Single, y: Single
) -> tuple[Single, Single, Single, Single]:
    """Interpolate four numbers bilinearly between corners; further ones are undefined."""
    one = np.uint64(1)
    return (
        _between(values, at, steps, x, y),
        _between(values, at + one, steps, x, y),
        _between(values, at + one + one, steps, x, y),
        _between(values, at + one + one + one, steps, x, y),
    )


@inner_step
def keep_within(
    corners: Corners, part: Part, place: tuple[float, float], channels: int, total: Floats
) -> None:
    """Clamp a pixel's channels to the limits at a position, in coordinates of the plain grid.

    `total` may have more numbers than there are channels.
    """
    at, x, y = _place_in(part, place[0], place[1], channels)
    steps = np.uint64(channels), np.uint64(part.wide * channels)
    # Interpolate both limits of each channel, and clamp; four channels at once.
    if total.size == 4:
        low = _four_between(corners.low, at, steps, x, y)
        high = _four_between(corners.high, at, steps, x, y)
        a, b = min(max(total[0], low[0]), high[0]), min(max(total[1], low[1]), high[1])
        c, d = min(max(total[2], low[2]), high[2]), min(max(total[3], low[3]), high[3])
        total[0], total[1], total[2], total[3] = a, b, c, d
        return
    for c in range(channels):
        k = at + np.uint64(c)
        low = _between(corners.low, k, steps, x, y)
        total[c] = min(max(total[c], low), _between(corners.high, k, steps, x, y))


@inner_step
def marks_at(corners: Corners, part: Part, u: float, v: float) -> int:
    """Marks of the cell at a position, in coordinates of the plain grid; 0: no edge is near."""
    column = min(max(int(u) - part.left, 0), part.wide - 2)
    row = min(max(int(v) - part.top, 0), part.high - 2)
    return int(corners.marks[cell_of(part.wide, column, row)])


@inner_step
def tolerances(
    limits: Limits,
    corners: Corners,
    part: Part,
    at: tuple[float, float],
    is_along_x: bool,
    found: Floats,
) -> bool:
    """Tolerances of a pixel's channels around the mean across an edge.

    `at`: position (u, v) in coordinates of the plain grid. `is_along_x`: whether the edge is along
    x. `found`: tolerances of the channels, filled; infinite where limits leave less. Returns
    whether any channel has a tolerance.
    """
    flat, _, _, _, _, channels, columns, before = limits.plain
    any_found = False
    first, x, y = _place_in(part, at[0], at[1], channels)
    steps = np.uint64(channels), np.uint64(part.wide * channels)
    # The same corner among the samples.
    corner = first // steps[0]
    row, column = corner // np.uint64(part.wide), corner % np.uint64(part.wide)
    start = np.uint64((part.top * columns + part.left) * channels - before)
    start += (row * np.uint64(columns) + column) * steps[0]
    for c in range(channels):
        k = np.uint64(c)
        low = _between(corners.low, first + k, steps, x, y)
        high = _between(corners.high, first + k, steps, x, y)
        around = steps[0], np.uint64(columns * channels)
        varies = varies_between(flat, start + k, around, is_along_x, x, y)
        tolerance = tolerance_of(varies, low, high, np.float32(limits.faint))
        is_less = tolerance < high - low
        found[c] = tolerance if is_less else np.float32(math.inf)
        any_found |= is_less
    return any_found


@inner_step
def keep_within_mean(
    corners: Corners,
    part: Part,
    middle: tuple[float, float],
    side: tuple[float, float],
    channels: int,
    total: Floats,
) -> None:
    """As `keep_within`, by the mean of the limits along a side (u, v) around a position.

    What stays within limits everywhere has a mean within their mean.
    """
    # Sample the side about once per grid sample.
    count = math.ceil(max(abs(side[0]), abs(side[1]), 1.0))
    share = np.float32(1.0 / count)
    steps = np.uint64(channels), np.uint64(part.wide * channels)
    for c in range(channels):
        low = high = np.float32(0)
        for n in range(count):
            t = (n + 0.5) / count - 0.5
            at, x, y = _place_in(part, middle[0] + t * side[0], middle[1] + t * side[1], channels)
            low += share * _between(corners.low, at + np.uint64(c), steps, x, y)
            high += share * _between(corners.high, at + np.uint64(c), steps, x, y)
        total[c] = min(max(total[c], low), high)


@inner_step
def _place_in(part: Part, u: float, v: float, channels: int) -> tuple[Place, Single, Single]:
    """Index of the corner before a position, and the fractions beyond it."""
    # Clamp to the outermost corners.
    x, y = np.float32(u - part.left), np.float32(v - part.top)
    zero, wide, high = np.float32(0), np.float32(part.wide - 1), np.float32(part.high - 1)
    x, y = min(max(x, zero), wide), min(max(y, zero), high)
    column: Whole = np.int32(min(x, wide - np.float32(1)))
    row: Whole = np.int32(min(y, high - np.float32(1)))
    at = np.uint64((row * part.wide + column) * channels)
    return at, x - np.float32(column), y - np.float32(row)


@kernel
def corner_scratch(channels: int) -> Corners:
    """Allocate scratch for the corners of a tile."""
    most, beside = max(MOST, 4 * channels), max(MOST_BESIDE, 3 * channels)
    low, high = np.empty(most + 4, np.float32), np.empty(most + 4, np.float32)
    above, below = np.empty(2 * beside, np.float32), np.empty(2 * beside, np.float32)
    bound, marks = np.empty(most, np.float32), np.empty(2 * most, np.uint8)
    return Corners(low, high, above, below, bound, marks)
