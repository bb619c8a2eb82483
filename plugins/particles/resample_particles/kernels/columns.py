"""Share out columns of particles among pixels; a tile of the picture has one owner.

Where a kernel reaches less than `SMALL` pixels, or is a point, pixels get its exact integral from a
table of the integral over a quadrant. Where it is larger, pixels get its value at their center,
plus s² / 24 times its Laplacian, which makes it the mean over a square of side s up to s⁴.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_step, parallel_kernel, tasks
from resample.types import Doubles

TILE = 32  # px
SMALL = 8.0  # px, reach of kernels with integrals from the table
FINEST = 96.0  # samples along a side of a pixel
ROUNDING = 1e-13  # of a particle: a smaller share is that of a pixel which it does not reach
TINY = 0.5  # px, reach below which it does not matter that a kernel is slanted or cut
# Fields of a record.
X, Y = 0, 1  # px
XX, XY, YY = 2, 3, 4  # of (distance / H)² = place + xx dx² + 2 xy dx dy + yy dy²
PLACE = 5  # (distance of the plane / H)²; 0 for columns
REACH_X, REACH_Y = 6, 7  # px
WHOLE, PEAK = 8, 9  # integral over the picture, and factor on the profile
VALUE = 10  # of the quantity
# In perspective, the divisor of the square: 1 + lean · d + bend · d².
LEAN_X, LEAN_Y, BEND_X, BEND_Y = 11, 12, 13, 14
FIELDS = 15


@inner_step
def _inside(quadrant: Doubles, x: float, y: float) -> float:
    """Integral of a column over the rectangle from its center to x, y (radii), with their sign."""
    count = quadrant.shape[0] - 1
    across, down = min(abs(x), 1.0) * count, min(abs(y), 1.0) * count
    column, row = min(int(across), count - 1), min(int(down), count - 1)
    right, below = across - column, down - row
    above = quadrant[row, column] * (1.0 - right) + quadrant[row, column + 1] * right
    under = quadrant[row + 1, column] * (1.0 - right) + quadrant[row + 1, column + 1] * right
    whole = float(above * (1.0 - below) + under * below)
    return whole if (x < 0.0) == (y < 0.0) else -whole


@inner_step
def _share_out(
    record: Doubles, quadrant: Doubles, box: NDArray[np.int64], edge: Doubles, picture: Doubles
) -> None:
    """Add exact shares of a small column to the pixels of a box."""
    per_x, per_y = 1.0 / record[REACH_X], 1.0 / record[REACH_Y]
    top = (box[0] - record[Y]) * per_y
    for n in range(box[3] - box[2] + 1):
        edge[n] = _inside(quadrant, (box[2] + n - record[X]) * per_x, top)
    for row in range(box[0], box[1]):
        bottom = (row + 1 - record[Y]) * per_y
        left, before = edge[0], _inside(quadrant, (box[2] - record[X]) * per_x, bottom)
        edge[0] = before
        for column in range(box[2], box[3]):
            n = column - box[2] + 1
            now = _inside(quadrant, (column + 1 - record[X]) * per_x, bottom)
            share = (now - before) - (edge[n] - left)
            left, before = edge[n], now
            edge[n] = now
            if share < ROUNDING:
                continue
            mass = record[WHOLE] * share
            picture[row, column, 0] += mass
            if picture.shape[2] > 1:
                picture[row, column, 1] += mass * record[VALUE]


@inner_step
def _profile_at(profile: Doubles, square: float, bend: float) -> float:
    """Mean of a profile over a small square around a place."""
    steps = profile.shape[0] - 1
    if not square < 1.0:
        return 0.0
    at = square * steps
    n = int(at)
    rest = at - n
    value = profile[n, 0] + rest * (profile[n + 1, 0] - profile[n, 0])
    return float(value + bend * (profile[n, 1] + rest * (profile[n + 1, 1] - profile[n, 1])))


@inner_step
def _sample(
    record: Doubles, profile: Doubles, box: NDArray[np.int64], fine: int, picture: Doubles
) -> None:
    """Add means of a large column, or of a slice, to the pixels of a box; `fine`² samples each."""
    xx, xy, yy, step = record[XX], record[XY], record[YY], 1.0 / fine
    bend = (xx + yy) * step * step / 48.0
    peak = record[PEAK] * step * step
    is_bent = record[BEND_X] > 0.0
    for row in range(box[0], box[1]):
        for column in range(box[2], box[3]):
            mean = 0.0
            for down in range(fine):
                dy = row + (down + 0.5) * step - record[Y]
                for along in range(fine):
                    dx = column + (along + 0.5) * step - record[X]
                    square = record[PLACE] + (xx * dx + 2.0 * xy * dy) * dx + yy * dy * dy
                    if is_bent:
                        along_x = (record[LEAN_X] + record[BEND_X] * dx) * dx
                        square /= 1.0 + along_x + (record[LEAN_Y] + record[BEND_Y] * dy) * dy
                    mean += _profile_at(profile, square, bend)
            mass = max(mean, 0.0) * peak
            picture[row, column, 0] += mass
            if picture.shape[2] > 1:
                picture[row, column, 1] += mass * record[VALUE]


@inner_step
def _evaluate(record: Doubles, profile: Doubles, box: NDArray[np.int64], picture: Doubles) -> None:
    """Add means of a large column to the pixels of a box; as `_sample` with one sample."""
    x, xx, xy, peak, value = record[X], record[XX], record[XY], record[PEAK], record[VALUE]
    lean_x, bend_x, is_bent = record[LEAN_X], record[BEND_X], record[BEND_X] > 0.0
    bend, steps = (xx + record[YY]) / 48.0, float(profile.shape[0] - 1)
    has_value = picture.shape[2] > 1
    for row in range(box[0], box[1]):
        dy = row + 0.5 - record[Y]
        half, rest = xy * dy, record[PLACE] + record[YY] * dy * dy
        first, last = box[2], box[3]
        per_row = 1.0 + (record[LEAN_Y] + record[BEND_Y] * dy) * dy
        if not is_bent:  # only where the square is below 1
            width = half * half - xx * (rest - 1.0)
            if width <= 0.0:
                continue
            width = math.sqrt(width)
            first = max(first, math.ceil(x - (half + width) / xx - 0.5))
            last = min(last, math.floor(x + (width - half) / xx - 0.5) + 1)
        for column in range(first, last):
            dx = column + 0.5 - x
            square = max(rest + (xx * dx + 2.0 * half) * dx, 0.0)
            if is_bent:
                square /= per_row + (lean_x + bend_x * dx) * dx
                if square >= 1.0:
                    continue
            at = min(square * steps, steps - 1e-9)
            n = int(at)
            share = at - n
            low = profile[n, 0] + bend * profile[n, 1]
            high = profile[n + 1, 0] + bend * profile[n + 1, 1]
            mass = peak * max(low + share * (high - low), 0.0)
            picture[row, column, 0] += mass
            if has_value:
                picture[row, column, 1] += mass * value


@parallel_kernel
def paint_columns(
    counter: Counter,
    records: Doubles,
    profile: Doubles,
    quadrant: Doubles,
    start: NDArray[np.int64],
    member: NDArray[np.int64],
    fineness: float,
    picture: Doubles,
) -> None:
    """Add particles to a picture (H, W, 1 or 2): masses, and masses times the quantity.

    `records`: (N, FIELDS). `profile`, `quadrant`: as in `ColumnTables`. `start`, `member`: which
    particles reach which tile, in the order in which they are added. `fineness`: samples along the
    reach of a kernel that are enough.
    """
    height, width = picture.shape[0], picture.shape[1]
    across = (width + TILE - 1) // TILE
    for task in tasks(counter, start.shape[0] - 1):
        tile = np.int64(task)
        top, left = tile // across * TILE, tile % across * TILE
        bottom, right = min(top + TILE, height), min(left + TILE, width)
        edge, box = np.empty(TILE + 1), np.empty(4, np.int64)
        for n in range(start[tile], start[tile + 1]):
            record = records[member[n]]
            reach = max(record[REACH_X], record[REACH_Y])
            box[0] = int(max(float(top), math.floor(record[Y] - record[REACH_Y])))
            box[1] = int(min(float(bottom), math.floor(record[Y] + record[REACH_Y]) + 1.0))
            box[2] = int(max(float(left), math.floor(record[X] - record[REACH_X])))
            box[3] = int(min(float(right), math.floor(record[X] + record[REACH_X]) + 1.0))
            if box[0] >= box[1] or box[2] >= box[3]:
                continue
            is_plain = record[XY] == 0.0 and record[BEND_X] == 0.0 and fineness <= SMALL
            if reach < TINY or (is_plain and reach < SMALL):
                _share_out(record, quadrant, box, edge, picture)
            else:
                smaller = min(record[REACH_X], record[REACH_Y])
                fine = math.ceil(min(fineness / smaller, FINEST))
                if fine == 1:
                    _evaluate(record, profile, box, picture)
                else:
                    _sample(record, profile, box, fine, picture)
