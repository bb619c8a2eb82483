"""Segments of a sheet's rows on the screen, measured with SIMD.

A segment's cells are stored in two flat arrays, `numbers` and `places`, in rows of `SEGMENT`
elements, a row for each quantity. The rows' offsets are constants, so that the compiler knows that
they do not overlap and vectorizes for sixteen cells at once; indices are unsigned, or each would be
tested for being negative. Numbers are float32 throughout, so that nothing is converted.
"""

from typing import Any, NamedTuple

import numpy as np

from resample.engine.cells.bands import pixel_of, placed
from resample.engine.jit import inner_kernel
from resample.engine.roles import plays
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.screen import SEGMENT, Indices, SheetScreen


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
