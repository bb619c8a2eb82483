"""Segments of a sheet's rows on the screen, measured with SIMD.

A segment's cells are stored in two flat arrays, `numbers` and `places`, in rows of `SEGMENT`
elements, a row for each quantity. The rows' offsets are constants, so that the compiler knows that
they do not overlap and vectorizes for sixteen cells at once; indices are unsigned, or each would be
tested for being negative. Numbers are float32 throughout, so that nothing is converted.

Colors inside samples' pixels are parabolas that keep the mean. Fragments are contributions of a
run's cells to one pixel each: each cell of a run has as many slots for pixels as the largest cell
needs. One slot of all cells is filled at a time, which vectorizes; a fragment with pixel −1 is
empty. What has to be done one by one, as cells share pixels, is left to `layers`.
"""

from typing import Any, NamedTuple

import numpy as np

from resample.engine.cells.bands import Pixel, beyond, length, pixel_of, placed, within
from resample.engine.jit import inner_kernel, plays
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.screen import SEGMENT, Indices, SheetScreen
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, TURNS, UP, Links

Five = tuple[Single, Single, Single, Single, Single]
Four = tuple[bool, bool, bool, bool]

MEAN_SQUARE: Single = np.float32(1 / 12)  # of a uniform distribution over −1/2..1/2
SIXTH: Single = np.float32(1 / 6)
STEP: Single = np.float32(2 / 3)  # weight of the inner two of five samples in a slope
FAR_STEP: Single = np.float32(1 / 12)  # weight of the outer two
BEND: Single = np.float32(1.5)  # the same in a bend
BEND_HERE: Single = np.float32(2.5)
SLIGHT: Single = np.float32(1e-5)  # px; keeps divisions finite
NONE = np.int32(-1)  # pixel


def _rows(first: int, count: int) -> Any:
    """Offsets of `count` rows from the first on."""
    return [np.uint64(SEGMENT * n) for n in range(first, first + count)]


ZERO: Single = np.float32(0)
QUARTER: Single = np.float32(0.25)
HALF: Single = np.float32(0.5)
ONE: Single = np.float32(1)
STEEP: Single = np.float32(0.05)  # of the nearness: limit of a surface's change per px
LARGEST: Single = np.float32(4096)  # px: a longer cell crosses the camera's plane and is dropped
SMALLEST: Single = np.float32(1e-9)  # px²: a cell seen edge-on covers nothing
SHEAR: Single = np.float32(0.3)  # of a cell's length: limit of the lean of upright sides
LEAN: Single = np.float32(0.4)  # px: limit of the lean, too
VOID: Single = np.float32(0.1)  # px²: limit of the gap that boxes leave where four of them meet
SMALL: Single = np.float32(0.9)  # px, at quality 1: shorter upright cells have one color
SHEARED: Single = np.float32(0.25)  # of their sides' lengths: area of much sheared cells, squared
NOWHERE: Single = np.float32(-1)  # nearness
SHARED = -1  # in a sheet's index: a cell with the lattice's corners
WASTE = 4  # slots of a run's cells per pixel that they may meet, at most

# How a cell is painted: not, in one color, as a box, cut into parts, or into finer ones.
HIDDEN, WHOLE, UPRIGHT, PARTS, FINE = range(5)

# Rows of numbers. Corners top left, top right, bottom left, bottom right: x, y and nearness.
P_X, P_Y, P_NEAR, Q_X, Q_Y, Q_NEAR = _rows(0, 6)
R_X, R_Y, R_NEAR, S_X, S_Y, S_NEAR = _rows(6, 6)
# Middle, sides a and b, and twist t: a point is at middle + u a + v b + u v t, u, v in −1/2..1/2.
X, Y, A_X, A_Y, B_X, B_Y, T_X, T_Y = _rows(12, 8)
# Nearness as a plane over the screen: in the middle, slopes, limits, and its possible error.
NEAR, SLOPE_X, SLOPE_Y, LEAST, MOST, SLACK = _rows(20, 6)
(AREA,) = _rows(26, 1)  # px², negative where the corners run the other way round
# Color of the first of three channels: mean, slopes and bends along both axes, twist, and limits.
MEAN, SLOPE_U, SLOPE_V, BEND_U, BEND_V, TWIST, LOW, HIGH = _rows(27, 8)
(CHANNEL,) = _rows(8, 1)  # from one channel to the next
# An upright box: its sides, how u and v change along the screen's axes, and mass per px².
WEST, NORTH, EAST, SOUTH, U_X, U_Y, V_X, V_Y, DENSITY = _rows(51, 9)
# A part of a cell: its mass, and the shares of it beyond the first pixel it overlaps.
PART, SHARE_X, SHARE_Y = _rows(60, 3)
# A fragment, what a cell gives to one pixel: nearness there, mass, and color.
DEPTH, MASS, RED, GREEN, BLUE = _rows(63, 5)
NUMBERS = SEGMENT * 68

# Rows of places. Pixels of a band that a cell may meet, the last ones excluded; how to paint it.
FROM_COLUMN, FROM_ROW, TO_COLUMN, TO_ROW, WAY = _rows(0, 5)
# First pixel of a box or part; how many parts; a fragment's pixel, −1 for none.
COLUMN, ROW, PARTS_U, PARTS_V, PIXEL = _rows(5, 5)
# Runs of cells that are painted alike: first, last (excluded), and most rows and columns of them.
BEGIN, END, ROWS, COLUMNS = _rows(10, 4)
(OPEN,) = _rows(14, 1)  # bits of a cell's sides, as in links, at which its surface ends
PLACES = SEGMENT * 15


class BandFrame(NamedTuple):
    """A band of a target's frame, and painting options as numbers."""

    first: int  # row of the target
    last: int  # row of the target, excluded
    width: int  # px
    orientation: Single  # 1, or −1 where the target is a mirror image
    quality: Single  # parts that a cell is cut into per px of the target
    is_label: bool  # colors are labels, which must not be mixed


class SheetStrip(NamedTuple):
    """A sheet, painted in bands; members are segments, row by row."""

    screen: SheetScreen
    frame: BandFrame


class SegmentCells(NamedTuple):
    """A segment's cells, in rows of quantities."""

    numbers: Floats  # (NUMBERS,)
    places: Indices  # (PLACES,)


@inner_kernel
def _load_corners(
    screen: Floats, torn: Floats, index: Indices, row: int, start: int, count: int, numbers: Floats
) -> int:
    """Copy the corners of a segment's cells, and count cells that do not share them."""
    # Copy left and right corners in two loops, each of contiguous memory.
    above, below = np.uint64(row), np.uint64(row) + np.uint64(1)
    for n in range(count):
        m, left = np.uint64(n), np.uint64(start + n)
        numbers[P_X + m], numbers[R_X + m] = screen[0, above, left], screen[0, below, left]
        numbers[P_Y + m], numbers[R_Y + m] = screen[1, above, left], screen[1, below, left]
        numbers[P_NEAR + m], numbers[R_NEAR + m] = screen[2, above, left], screen[2, below, left]
    for n in range(count):
        m, right = np.uint64(n), np.uint64(start + n + 1)
        numbers[Q_X + m], numbers[S_X + m] = screen[0, above, right], screen[0, below, right]
        numbers[Q_Y + m], numbers[S_Y + m] = screen[1, above, right], screen[1, below, right]
        numbers[Q_NEAR + m], numbers[S_NEAR + m] = screen[2, above, right], screen[2, below, right]
    # Overwrite torn cells' bounds; cells without depth become invisible.
    alone = 0
    for n in range(count):
        m, own = np.uint64(n), index[row, start + n]
        alone += int(own != SHARED)
        if own >= 0:
            numbers[P_X + m], numbers[P_Y + m] = torn[own, 0, 0], torn[own, 0, 1]
            numbers[Q_X + m], numbers[Q_Y + m] = torn[own, 1, 0], torn[own, 1, 1]
            numbers[R_X + m], numbers[R_Y + m] = torn[own, 2, 0], torn[own, 2, 1]
            numbers[S_X + m], numbers[S_Y + m] = torn[own, 3, 0], torn[own, 3, 1]
            numbers[P_NEAR + m], numbers[Q_NEAR + m] = torn[own, 0, 2], torn[own, 1, 2]
            numbers[R_NEAR + m], numbers[S_NEAR + m] = torn[own, 2, 2], torn[own, 3, 2]
        elif own != SHARED:
            numbers[P_NEAR + m] = NOWHERE
    return alone


@inner_kernel
def _measure_shapes(count: int, numbers: Floats) -> None:
    """Measure cells from their corners: sides, twist, nearness plane and area."""
    for n in range(count):
        m = np.uint64(n)
        px, py, pn = numbers[P_X + m], numbers[P_Y + m], numbers[P_NEAR + m]
        qx, qy, qn = numbers[Q_X + m], numbers[Q_Y + m], numbers[Q_NEAR + m]
        rx, ry, rn = numbers[R_X + m], numbers[R_Y + m], numbers[R_NEAR + m]
        sx, sy, sn = numbers[S_X + m], numbers[S_Y + m], numbers[S_NEAR + m]
        # Take mean sides; what they leave over is the twist.
        ax, ay = HALF * (qx - px + sx - rx), HALF * (qy - py + sy - ry)
        bx, by = HALF * (rx - px + sx - qx), HALF * (ry - py + sy - qy)
        an, bn = HALF * (qn - pn + sn - rn), HALF * (rn - pn + sn - qn)
        numbers[X + m], numbers[Y + m] = (
            QUARTER * (px + qx + rx + sx),
            QUARTER * (py + qy + ry + sy),
        )
        numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m] = ax, ay, bx, by
        numbers[T_X + m], numbers[T_Y + m] = px - qx - rx + sx, py - qy - ry + sy
        # Fit a plane of nearness to the corners.
        near, inverse = QUARTER * (pn + qn + rn + sn), ONE / (ax * by - ay * bx)
        slope_x, slope_y = (an * by - bn * ay) * inverse, (bn * ax - an * bx) * inverse
        # Limit its slopes, which explode for cells seen edge-on.
        steepest = STEEP * near
        numbers[NEAR + m] = near
        numbers[SLOPE_X + m] = min(max(slope_x, -steepest), steepest)
        numbers[SLOPE_Y + m] = min(max(slope_y, -steepest), steepest)
        numbers[LEAST + m], numbers[MOST + m] = min(pn, qn, rn, sn), max(pn, qn, rn, sn)
        numbers[SLACK + m] = min(HALF * (abs(slope_x) + abs(slope_y)), steepest)
        # Take the signed area by the cross product of the diagonals.
        numbers[AREA + m] = HALF * ((sx - px) * (ry - qy) - (sy - py) * (rx - qx))


@inner_kernel
def _measure_extents(count: int, frame: BandFrame, numbers: Floats, places: Indices) -> None:
    """Bound the pixels of cells, within the band."""
    for n in range(count):
        m = np.uint64(n)
        px, qx, rx, sx = numbers[P_X + m], numbers[Q_X + m], numbers[R_X + m], numbers[S_X + m]
        py, qy, ry, sy = numbers[P_Y + m], numbers[Q_Y + m], numbers[R_Y + m], numbers[S_Y + m]
        places[FROM_COLUMN + m] = max(0, pixel_of(min(px, qx, rx, sx)))
        places[FROM_ROW + m] = max(frame.first, pixel_of(min(py, qy, ry, sy)))
        places[TO_COLUMN + m] = min(frame.width, pixel_of(max(px, qx, rx, sx)) + 1)
        places[TO_ROW + m] = min(frame.last, pixel_of(max(py, qy, ry, sy)) + 1)


@inner_kernel
def _choose_ways(count: int, frame: BandFrame, numbers: Floats, places: Indices) -> None:
    """Choose how cells are painted; back faces and empty cells are culled."""
    # Squared lengths up to which cells have one color: upright ones, and those that lean.
    whole = ONE / (frame.quality * frame.quality)
    small = SMALL * SMALL * whole
    shear = ZERO if frame.is_label else SHEAR / max(frame.quality, ONE)
    least_shear = ONE if frame.is_label else ZERO
    for n in range(count):
        m = np.uint64(n)
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        # Cull cells without depth, across the camera's plane, outside the band, and back faces.
        diagonal = max(
            abs(numbers[S_X + m] - numbers[P_X + m]), abs(numbers[S_Y + m] - numbers[P_Y + m]),
            abs(numbers[R_X + m] - numbers[Q_X + m]), abs(numbers[R_Y + m] - numbers[Q_Y + m]),
        )  # fmt: skip
        is_seen = (numbers[LEAST + m] > ZERO) & (diagonal <= LARGEST)
        is_seen &= frame.orientation * numbers[AREA + m] > SMALLEST
        is_seen &= places[FROM_COLUMN + m] < places[TO_COLUMN + m]
        is_seen &= places[FROM_ROW + m] < places[TO_ROW + m]
        # Paint nearly axis-aligned cells as boxes, short ones in one color, others in parts.
        is_upright = (abs(ay) <= shear * abs(ax)) & (abs(bx) <= shear * abs(by))
        # Boxes with sides that lean in both directions leave a gap where four of them meet.
        is_upright &= (max(abs(ay), abs(bx)) <= LEAN) & (abs(ay * bx) <= VOID)
        is_upright &= least_shear == ZERO
        longest = max(ax * ax + ay * ay, bx * bx + by * by)
        is_whole = longest <= (small if is_upright else whole)
        way = WHOLE if is_whole else UPRIGHT if is_upright else PARTS
        places[WAY + m] = np.int32(way if is_seen else HIDDEN)


@inner_kernel
def _find_runs(count: int, places: Indices) -> int:
    """Divide a segment's visible cells into runs; return how many.

    The cells of a run are painted in one way, and all have as many slots for pixels as the largest
    one needs; a run ends where most of them would be empty.
    """
    runs, n = 0, 0
    while n < count:
        begin, way = n, places[WAY + np.uint64(n)]
        rows, columns, met = 0, 0, 0
        # Extend the run while cells are painted alike and waste few slots.
        while n < count and places[WAY + np.uint64(n)] == way:
            m = np.uint64(n)
            height = int(places[TO_ROW + m] - places[FROM_ROW + m])
            width = int(places[TO_COLUMN + m] - places[FROM_COLUMN + m])
            most_rows, most_columns = max(rows, height), max(columns, width)
            slots = most_rows * most_columns * (n + 1 - begin)
            if way != HIDDEN and slots > WASTE * (met + height * width):
                break
            rows, columns, met = most_rows, most_columns, met + height * width
            n += 1
        # Store the run, unless its cells are culled.
        if way != HIDDEN:
            k = np.uint64(runs)
            places[BEGIN + k], places[END + k] = begin, n
            places[ROWS + k], places[COLUMNS + k] = rows, columns
            runs += 1
    return runs


@inner_kernel
def measure(
    screen: Floats, torn: Floats, index: Indices, row: int, segment: int, frame: BandFrame,
    numbers: Floats, places: Indices,
) -> int:  # fmt: skip
    """Measure the cells of a segment; return how many visible runs they form."""
    start = segment * SEGMENT
    count = min(index.shape[1] - start, SEGMENT)
    alone = _load_corners(screen, torn, index, row, start, count, numbers)
    # Measure the cells, and group them into runs.
    _measure_shapes(count, numbers)
    _measure_extents(count, frame, numbers, places)
    _choose_ways(count, frame, numbers, places)
    # Boxes are far from the parts of sheared cells: at a surface's end that would show.
    for n in range(count if alone else 0):
        m = np.uint64(n)
        a = numbers[A_X + m] * numbers[A_X + m] + numbers[A_Y + m] * numbers[A_Y + m]
        b = numbers[B_X + m] * numbers[B_X + m] + numbers[B_Y + m] * numbers[B_Y + m]
        is_sheared = numbers[AREA + m] * numbers[AREA + m] < SHEARED * a * b
        is_fine = is_sheared & (index[row, start + n] != SHARED) & (places[WAY + m] == PARTS)
        places[WAY + m] = np.int32(FINE if is_fine else places[WAY + m])
    return _find_runs(count, places)


@plays(placed, SheetStrip)
def _placed(strip: SheetStrip, member: int, cells: SegmentCells) -> int:
    """Measure a member of a strip: one segment."""
    vertex, torn, index, bounds = strip.screen
    row, segment = divmod(member, bounds.shape[1])
    return measure(vertex, torn, index, row, segment, strip.frame, cells.numbers, cells.places)


@inner_kernel
def _bent(values: Five, is_linked: Four) -> tuple[Single, Single]:
    """Slope and bend of the middle of five samples, by those that are on its surface.

    `is_linked` tells that of the nearest on both sides, then of the far ones.
    The parabola passes through the values at the pixel's sides, (7 (a + b) − (z + c)) / 12 of
    the four samples around a side (Colella and Woodward 1984, the piecewise parabolic method).
    """
    far_back, back, here, ahead, far_ahead = values
    is_back, is_ahead, is_far_back, is_far_ahead = is_linked
    # Extrapolate linearly where a far sample is on another surface.
    behind = far_back if is_far_back else back + back - here
    before = far_ahead if is_far_ahead else ahead + ahead - here
    is_between = is_back & is_ahead
    # Fit the parabola, or a line if one of the nearest samples is missing.
    slope = STEP * (ahead - back) - FAR_STEP * (before - behind)
    bend = BEND * (back + ahead) - QUARTER * (behind + before) - BEND_HERE * here
    one_sided = (ahead - here if is_ahead else ZERO) + (here - back if is_back else ZERO)
    return slope if is_between else HALF * one_sided, bend if is_between else ZERO


@inner_kernel
def _turned(
    mean: Single, slope: Single, bend: Single, is_ahead: bool, is_back: bool
) -> tuple[Single, Single, Single]:
    """Mean, slope and bend of a cell at whose side the surface may curve away.

    The cell's outer half shows the last quarter of the sample: what lies at u in −1/2..1/2 of the
    cell is at u + 1/4 − u² of the sample, if it curves away ahead. The slope is one-sided there.
    """
    side = (ONE if is_ahead else ZERO) - (ONE if is_back else ZERO)
    steeper = slope + slope * abs(side)
    return mean + SIXTH * side * steeper, steeper, bend - side * steeper


@inner_kernel
def write_colors(
    color: Floats, links: Links, group: int, row: int, start: int, begin: int, end: int,
    numbers: Floats,
) -> None:  # fmt: skip
    """Write the colors of a run of a segment's samples: coefficients of `color_at`.

    Branch-free for SIMD: values of neighbours on other surfaces are read but not used. A parabola
    that exceeds a sample's neighbours on the surface would ripple, which real surfaces do not:
    hence the limits.
    """
    g, one, two = np.uint64(group), np.uint64(1), np.uint64(2)
    r = np.uint64(row + MARGIN)
    for c in range(3):
        k, at = np.uint64(c), np.uint64(c) * CHANNEL
        # Fit along u.
        for n in range(begin, end):
            m, x = at + np.uint64(n), np.uint64(start + n + MARGIN)
            bits = links[r, x]
            here = color[g, k, r, x]
            left, right = color[g, k, r, x - one], color[g, k, r, x + one]
            above, below = color[g, k, r - one, x], color[g, k, r + one, x]
            numbers[SLOPE_U + m], numbers[BEND_U + m] = _bent(
                (color[g, k, r, x - two], left, here, right, color[g, k, r, x + two]),
                (
                    bits & LEFT != 0, bits & RIGHT != 0,
                    links[r, x - one] & LEFT != 0, links[r, x + one] & RIGHT != 0,
                ),
            )  # fmt: skip
            # Compress the parabola where the surface curves away on the left or right.
            numbers[MEAN + m], numbers[SLOPE_U + m], numbers[BEND_U + m] = _turned(
                here, numbers[SLOPE_U + m], numbers[BEND_U + m],
                bits & (TURNS * RIGHT) != 0, bits & (TURNS * LEFT) != 0,
            )  # fmt: skip
            # Limit colors to those of the four neighbours on the surface.
            a = right if bits & RIGHT != 0 else here
            b = left if bits & LEFT != 0 else here
            d = below if bits & DOWN != 0 else here
            e = above if bits & UP != 0 else here
            numbers[LOW + m], numbers[HIGH + m] = min(here, a, b, d, e), max(here, a, b, d, e)
        # Fit along v.
        for n in range(begin, end):
            m, x = at + np.uint64(n), np.uint64(start + n + MARGIN)
            bits, bits_above, bits_below = links[r, x], links[r - one, x], links[r + one, x]
            numbers[SLOPE_V + m], numbers[BEND_V + m] = _bent(
                (
                    color[g, k, r - two, x], color[g, k, r - one, x], color[g, k, r, x],
                    color[g, k, r + one, x], color[g, k, r + two, x],
                ),
                (bits & UP != 0, bits & DOWN != 0, bits_above & UP != 0, bits_below & DOWN != 0),
            )  # fmt: skip
            # Compress the parabola where the surface curves away above or below.
            numbers[MEAN + m], numbers[SLOPE_V + m], numbers[BEND_V + m] = _turned(
                numbers[MEAN + m], numbers[SLOPE_V + m], numbers[BEND_V + m],
                bits & (TURNS * DOWN) != 0, bits & (TURNS * UP) != 0,
            )  # fmt: skip
            # Take the twist from the four diagonal neighbours, if all are on the surface.
            before = color[g, k, r - one, x + one] - color[g, k, r - one, x - one]
            after = color[g, k, r + one, x + one] - color[g, k, r + one, x - one]
            sideways = bits & bits_above & bits_below
            is_whole = (sideways & LEFT != 0) & (sideways & RIGHT != 0)
            is_whole &= (bits & UP != 0) & (bits & DOWN != 0)
            numbers[TWIST + m] = QUARTER * (after - before) if is_whole else ZERO


@inner_kernel
def write_means(
    color: Floats, group: int, row: int, start: int, begin: int, end: int, numbers: Floats
) -> None:
    """Write only the mean colors of a run of a segment's samples."""
    for c in range(3):
        at = MEAN + np.uint64(c) * CHANNEL
        for n in range(begin, end):
            numbers[at + np.uint64(n)] = color[group, c, row + MARGIN, start + n + MARGIN]


@inner_kernel
def color_at(numbers: Floats, m: np.uint64, u: Single, v: Single, uu: Single, vv: Single) -> Single:
    """Evaluate a channel at u, v in −1/2..1/2 of a pixel, or its mean around there.

    `uu` and `vv` are the squares of u and v, or their means, minus 1/12.
    """
    value = numbers[MEAN + m] + numbers[SLOPE_U + m] * u + numbers[SLOPE_V + m] * v
    value += numbers[BEND_U + m] * uu + numbers[BEND_V + m] * vv + numbers[TWIST + m] * (u * v)
    return min(max(value, numbers[LOW + m]), numbers[HIGH + m])


@inner_kernel
def nearness_at(numbers: Floats, m: np.uint64, column: Pixel, row: Pixel) -> Single:
    """Nearness of a cell's plane at a pixel's center, clamped to its own limits."""
    x = np.float32(column) + HALF - numbers[X + m]
    y = np.float32(row) + HALF - numbers[Y + m]
    near = numbers[NEAR + m] + numbers[SLOPE_X + m] * x + numbers[SLOPE_Y + m] * y
    return min(max(near, numbers[LEAST + m]), numbers[MOST + m])


@inner_kernel
def fill_depths(
    begin: int, end: int, i: int, j: int, frame: BandFrame, numbers: Floats, places: Indices
) -> int:
    """Fill the slot in column i, row j of cells' pixels with their nearness.

    As all functions that fill slots, it returns how many are not empty.
    """
    found = 0
    # Rasterize the bounds of each cell; pixels beyond its own are empty.
    for n in range(begin, end):
        m = np.uint64(n)
        column, row = np.int32(places[FROM_COLUMN + m] + i), np.int32(places[FROM_ROW + m] + j)
        is_met = (column < places[TO_COLUMN + m]) & (row < places[TO_ROW + m])
        pixel = np.int32((row - frame.first) * frame.width + column)
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found


@inner_kernel
def set_boxes(
    begin: int, end: int, frame: BandFrame, numbers: Floats, places: Indices
) -> tuple[int, int]:
    """Turn upright cells into boxes; return the most rows and columns that one meets."""
    rows, columns = np.int32(0), np.int32(0)
    for n in range(begin, end):
        m = np.uint64(n)
        # Take the box around the cell's middle.
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        determinant = ax * by - ay * bx
        inverse = ONE / determinant
        across, down = abs(ax), abs(by)
        west, north = numbers[X + m] - HALF * across, numbers[Y + m] - HALF * down
        numbers[WEST + m], numbers[NORTH + m] = west, north
        numbers[EAST + m], numbers[SOUTH + m] = west + across, north + down
        # Invert the cell's sides: how u and v change along the screen's axes.
        numbers[U_X + m], numbers[U_Y + m] = by * inverse, -bx * inverse
        numbers[V_X + m], numbers[V_Y + m] = -ay * inverse, ax * inverse
        # Keep the cell's mass, although its box is a little larger.
        numbers[DENSITY + m] = abs(determinant) / (across * down)
        # Find the box's pixels within the band.
        column = np.int32(max(pixel_of(west), 0))
        row = np.int32(max(pixel_of(north), frame.first))
        east, south = pixel_of(numbers[EAST + m]), pixel_of(numbers[SOUTH + m])
        columns = max(columns, np.int32(min(east + 1, frame.width) - column))
        rows = max(rows, np.int32(min(south + 1, frame.last) - row))
        places[COLUMN + m], places[ROW + m] = column, row
    return int(rows), int(columns)


@inner_kernel
def fill_from_boxes(
    begin: int, end: int, i: int, j: int, frame: BandFrame, numbers: Floats, places: Indices
) -> int:
    """Fill a slot with boxes' mean colors over the part of a pixel they cover."""
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        # Clip the box to the pixel.
        column, row = np.int32(places[COLUMN + m] + i), np.int32(places[ROW + m] + j)
        west, east = within(numbers[WEST + m], numbers[EAST + m], np.float32(column))
        north, south = within(numbers[NORTH + m], numbers[SOUTH + m], np.float32(row))
        width, height = east - west, south - north
        # Find the middle of the overlap in the cell.
        x, y = HALF * (west + east) - numbers[X + m], HALF * (north + south) - numbers[Y + m]
        u = x * numbers[U_X + m] + y * numbers[U_Y + m]
        v = x * numbers[V_X + m] + y * numbers[V_Y + m]
        # Take the means of u² and v² over the overlap, so that parabolas are integrated exactly.
        share_u, share_v = width * numbers[U_X + m], height * numbers[V_Y + m]
        uu = u * u + (share_u * share_u - ONE) * MEAN_SQUARE
        vv = v * v + (share_v * share_v - ONE) * MEAN_SQUARE
        # Weigh the color by the mass.
        mass = width * height * numbers[DENSITY + m]
        numbers[MASS + m] = mass
        numbers[RED + m] = mass * color_at(numbers, m, u, v, uu, vv)
        numbers[GREEN + m] = mass * color_at(numbers, CHANNEL + m, u, v, uu, vv)
        numbers[BLUE + m] = mass * color_at(numbers, CHANNEL + CHANNEL + m, u, v, uu, vv)
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row) + numbers[SLACK + m]
        # Mark slots that the box misses as empty.
        is_met = (width > ZERO) & (height > ZERO) & (column < frame.width) & (row < frame.last)
        pixel = np.int32((row - frame.first) * frame.width + column)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found


@inner_kernel
def count_parts(
    begin: int, end: int, quality: Single, numbers: Floats, places: Indices
) -> tuple[int, int]:
    """Count the parts of cells along both sides; return the largest counts."""
    most_u, most_v = np.int32(1), np.int32(1)
    for n in range(begin, end):
        m = np.uint64(n)
        # Cut by the sides' lengths; the margin keeps cells of exactly one part whole.
        side_u = length(numbers[A_X + m], numbers[A_Y + m])
        side_v = length(numbers[B_X + m], numbers[B_Y + m])
        count_u = np.int32(pixel_of(side_u * quality - np.float32(0.01)) + 1)
        count_v = np.int32(pixel_of(side_v * quality - np.float32(0.01)) + 1)
        most_u, most_v = max(most_u, count_u), max(most_v, count_v)
        places[PARTS_U + m], places[PARTS_V + m] = count_u, count_v
    return int(most_u), int(most_v)


@inner_kernel
def set_parts(
    begin: int, end: int, i: int, j: int, is_whole: bool, frame: BandFrame,
    numbers: Floats, places: Indices,
) -> int:  # fmt: skip
    """Cut part (i, j) out of every cell; count those that may lie in the band.

    A part is an upright box of one color, at most 1 px wide.
    """
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        # Find the middle of the part in the cell.
        count_u = ONE if is_whole else np.float32(places[PARTS_U + m])
        count_v = ONE if is_whole else np.float32(places[PARTS_V + m])
        step_u, step_v = ONE / count_u, ONE / count_v
        u = (np.float32(i) + HALF) * step_u - HALF
        v = (np.float32(j) + HALF) * step_v - HALF
        # Map it to the screen, and take the bilinear map's derivatives as its sides.
        ax, ay, bx, by = numbers[A_X + m], numbers[A_Y + m], numbers[B_X + m], numbers[B_Y + m]
        tx, ty = numbers[T_X + m], numbers[T_Y + m]
        x = numbers[X + m] + ax * u + bx * v + tx * u * v
        y = numbers[Y + m] + ay * u + by * v + ty * u * v
        side_x, side_y = (ax + tx * v) * step_u, (ay + ty * v) * step_u
        other_x, other_y = (bx + tx * u) * step_v, (by + ty * u) * step_v
        # Take the signed area as mass, and the box around the sides.
        mass = frame.orientation * (side_x * other_y - side_y * other_x)
        across = min(length(side_x, other_x), ONE) + SLIGHT
        down = min(length(side_y, other_y), ONE) + SLIGHT
        west, north = x - HALF * across, y - HALF * down
        # Find the first of the 2 × 2 pixels that the box meets.
        column, row = pixel_of(west), pixel_of(north)
        # Drop parts that the cell does not have, seen from behind, or outside the band.
        is_there = (np.float32(i) < count_u) & (np.float32(j) < count_v) & (mass > ZERO)
        is_there &= (row < frame.last) & (row + 2 > frame.first)
        found += int(is_there)
        numbers[PART + m] = mass if is_there else ZERO
        # Split the box between the pixels.
        numbers[SHARE_X + m] = beyond(west, across, np.float32(column))
        numbers[SHARE_Y + m] = beyond(north, down, np.float32(row))
        places[COLUMN + m], places[ROW + m] = column, row
        # Store where the color is evaluated, unless the cell has one color.
        if not is_whole:
            uu, vv = u * u - MEAN_SQUARE, v * v - MEAN_SQUARE
            numbers[U_X + m], numbers[U_Y + m], numbers[V_X + m], numbers[V_Y + m] = u, v, uu, vv
    return found


@inner_kernel
def fill_from_parts(
    begin: int, end: int, i: int, j: int, is_flat: bool, frame: BandFrame,
    numbers: Floats, places: Indices,
) -> int:  # fmt: skip
    """Fill one slot of 2 × 2 with parts' contributions; labels are not weighted."""
    found = 0
    for n in range(begin, end):
        m = np.uint64(n)
        column, row = np.int32(places[COLUMN + m] + i), np.int32(places[ROW + m] + j)
        # Take the share of the part's mass that falls into this pixel.
        share_x, share_y = numbers[SHARE_X + m], numbers[SHARE_Y + m]
        mass = numbers[PART + m] * (share_y if j else ONE - share_y)
        mass *= share_x if i else ONE - share_x
        # Evaluate the color, and weigh it by the mass.
        weight = ONE if frame.is_label else mass
        red, green = numbers[MEAN + m], numbers[MEAN + CHANNEL + m]
        blue = numbers[MEAN + CHANNEL + CHANNEL + m]
        if not is_flat:
            u, v, uu, vv = numbers[U_X + m], numbers[U_Y + m], numbers[V_X + m], numbers[V_Y + m]
            red = color_at(numbers, m, u, v, uu, vv)
            green = color_at(numbers, CHANNEL + m, u, v, uu, vv)
            blue = color_at(numbers, CHANNEL + CHANNEL + m, u, v, uu, vv)
        numbers[MASS + m] = mass
        numbers[RED + m], numbers[GREEN + m], numbers[BLUE + m] = (
            weight * red,
            weight * green,
            weight * blue,
        )
        # Mark slots without mass or outside the band as empty.
        numbers[DEPTH + m] = nearness_at(numbers, m, column, row) + numbers[SLACK + m]
        is_met = (mass > ZERO) & (column >= 0) & (column < frame.width)
        is_met &= (row >= frame.first) & (row < frame.last)
        pixel = np.int32((row - frame.first) * frame.width + column)
        places[PIXEL + m] = pixel if is_met else NONE
        found += int(is_met)
    return found
