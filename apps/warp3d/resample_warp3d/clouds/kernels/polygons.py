"""Convex polygons in a plane, cut along lines.

Polygons are (4, WIDTH): x and y of the corners 1, 2, ... and then of the first again, and room for
as many more. Open sides, which are of no line, are bits of a number: of corner k, the side from
there to the next.
"""

import math

from resample.engine.jit import inner_kernel
from resample.engine.vectors import Vector
from resample.types import Doubles

SIDES = 8  # of the polygon that a cell is cut out of
MOST_CORNERS = 62  # as many as an integer has bits for
LANES = 8  # corners that are looked at together
WIDTH = MOST_CORNERS + LANES + 2  # of arrays for corners, of which the first is left out
X, Y = 0, 1
CORNERS = tuple(
    (math.cos(2.0 * math.pi * k / SIDES), math.sin(2.0 * math.pi * k / SIDES)) for k in range(SIDES)
)

# How many corners are so far that the line might meet them, how many sides cross it, and the sum of
# those corners that are the last before it, and the last beyond it.
Crossed = tuple[int, int, int, int]


@inner_kernel
def open_polygon(polygon: Doubles, half: float) -> None:
    """Start with a regular polygon of half a width."""
    outer = half / math.cos(math.pi / SIDES)
    for k in range(SIDES):
        polygon[X, k + 1], polygon[Y, k + 1] = outer * CORNERS[k][0], outer * CORNERS[k][1]
    _close(polygon, SIDES)


@inner_kernel
def _close(polygon: Doubles, corners: int) -> None:
    """Let the first corner come after the last."""
    polygon[X, corners + 1], polygon[Y, corners + 1] = polygon[X, 1], polygon[Y, 1]


@inner_kernel
def crossed(polygon: Doubles, corners: int, side: Vector) -> Crossed:
    """How a polygon lies to a line, beyond which side · (x, y) is above side[2].

    That number is half the square of a neighbour's distance. Lanes after the last corner are no
    corners, but do the same.
    """
    far, turns, begin, end = 0, 0, 0, 0
    for k in range(1, (corners + LANES - 1) // LANES * LANES + 1):
        x, y = polygon[X, k], polygon[Y, k]
        is_here = side[0] * x + side[1] * y - side[2] > 0.0
        is_next = side[0] * polygon[X, k + 1] + side[1] * polygon[Y, k + 1] - side[2] > 0.0
        is_side = k <= corners
        far += int(is_side & (x * x + y * y > 0.5 * side[2]))
        turns += int(is_side & (is_here != is_next))
        begin += k * int(is_side & (not is_here) & is_next)
        end += k * int(is_side & is_here & (not is_next))
    return far, turns, begin, end


@inner_kernel
def _beyond(polygon: Doubles, k: int, side: Vector) -> float:
    """How far a corner is beyond a line."""
    return float(side[0] * polygon[X, k] + side[1] * polygon[Y, k] - side[2])


@inner_kernel
def _met(polygon: Doubles, k: int, side: Vector) -> tuple[float, float]:
    """Where a line meets the side of a polygon after a corner."""
    before, after = _beyond(polygon, k, side), _beyond(polygon, k + 1, side)
    share = before / (before - after)
    x, y = polygon[X, k], polygon[Y, k]
    return x + share * (polygon[X, k + 1] - x), y + share * (polygon[Y, k + 1] - y)


@inner_kernel
def _shift(polygon: Doubles, begin: int, end: int, by: int) -> None:
    """Move some corners on by one, or back."""
    if by > 0:
        for k in range(end, begin - 1, -1):
            polygon[X, k + 1], polygon[Y, k + 1] = polygon[X, k], polygon[Y, k]
    elif by < 0:
        for k in range(begin, end + 1):
            polygon[X, k + by], polygon[Y, k + by] = polygon[X, k], polygon[Y, k]


@inner_kernel
def _cut_once(
    polygon: Doubles, corners: int, sides: int, side: Vector, begin: int, end: int
) -> tuple[int, int]:
    """Cut away the corners after `begin` up to `end`."""
    ax, ay = _met(polygon, begin, side)
    bx, by = _met(polygon, end, side)
    last = (sides >> end) & 1
    begin, end = 0 if begin == corners else begin, 0 if end == corners else end
    if begin < end:
        count, into, out = corners - end + begin + 2, begin + 1, begin + 2
        _shift(polygon, end + 1, corners, out - end)
        sides = sides & ((1 << into) - 1) | last << out | sides >> (end + 1) << (out + 1)
    else:
        count, into, out = begin - end + 2, begin - end + 2, 1
        _shift(polygon, end + 1, begin, 1 - end)
        sides = last << 1 | (sides & ((2 << begin) - 1)) >> (end + 1) << 2
    polygon[X, into], polygon[Y, into] = ax, ay
    polygon[X, out], polygon[Y, out] = bx, by
    _close(polygon, count)
    return count, sides


@inner_kernel
def _cut_often(polygon: Doubles, corners: int, sides: int, side: Vector) -> tuple[int, int]:
    """Cut where rounding lets a line leave a polygon more than once."""
    count, left, last = 0, 0, corners
    before = _beyond(polygon, last, side)
    for k in range(1, corners + 1):
        here = _beyond(polygon, k, side)
        if (before > 0.0) != (here > 0.0) and count < MOST_CORNERS:
            count += 1
            polygon[X + 2, count], polygon[Y + 2, count] = _met(polygon, last, side)
            left |= ((sides >> last) & int(here <= 0.0)) << count
        if here <= 0.0 and count < MOST_CORNERS:
            count += 1
            polygon[X + 2, count], polygon[Y + 2, count] = polygon[X, k], polygon[Y, k]
            left |= ((sides >> k) & 1) << count
        before, last = here, k
    for k in range(1, count + 1):
        polygon[X, k], polygon[Y, k] = polygon[X + 2, k], polygon[Y + 2, k]
    _close(polygon, count)
    return count, left


@inner_kernel
def cut(polygon: Doubles, corners: int, sides: int, side: Vector, how: Crossed) -> tuple[int, int]:
    """Cut away what is beyond a line that crosses a polygon.

    Gives how many corners are left, and the open sides.
    """
    _, turns, begin, end = how
    if turns == 2 and corners < MOST_CORNERS:
        return _cut_once(polygon, corners, sides, side, begin, end)
    return _cut_often(polygon, corners, sides, side)
