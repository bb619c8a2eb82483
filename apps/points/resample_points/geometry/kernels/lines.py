"""Convex cells around the origin of a plane: intersections of half-planes.

A line contributes to the cell the part that all others leave of it. That compares all pairs of
lines, but vectorized and without dependencies, as clipping by one line after the other would have.
Lines that are parallel up to rounding count as one, the nearest, so that two lines clip each other
at the same corner.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, kernel
from resample.engine.vectors import Vector
from resample.types import Doubles

SIDES = 8  # of a polygon that closes a cell
CORNERS = tuple(
    (math.cos(2.0 * math.pi * k / SIDES), math.sin(2.0 * math.pi * k / SIDES)) for k in range(SIDES)
)
MOST_LINES = 64  # lines
LANES = 4  # lines that are processed together
PARALLEL = 1e-9  # sine of an angle below which lines count as one
X, Y, AWAY, BEGIN, END = 0, 1, 2, 3, 4


class DiscLines(NamedTuple):
    """Lines, and the corners of the cell that they bound.

    Along a line, places are counted from the one nearest to the origin, counterclockwise.
    """

    line: Doubles  # (5, ROOM) x and y of a unit normal, distance, begin and end of a cell's side
    corner: Doubles  # (2, 2 ROOM) x and y; zeros after the last


@kernel
def no_lines() -> DiscLines:
    """Allocate lines."""
    return DiscLines(np.zeros((5, MOST_LINES)), np.zeros((2, 2 * MOST_LINES)))


@inner_kernel
def put(line: Doubles, count: int, x: float, y: float, away: float) -> None:
    """Write a line at index `count`."""
    line[X, count], line[Y, count], line[AWAY, count] = x, y, away


@inner_kernel
def put_around(line: Doubles, count: int, half: float) -> int:
    """Append a regular polygon of half a width at index `count`; return the new count."""
    for k in range(SIDES):
        put(line, count + k, CORNERS[k][0], CORNERS[k][1], half)
    return count + SIDES


@inner_kernel
def _left(line: Doubles, n: int, m: int, other: Vector, far: float) -> tuple[float, float]:
    """Begin and end of what another line leaves of line n."""
    # Intersect both lines; the sine's sign tells which side is cut off.
    x, y, away = other
    sine = line[X, n] * y - line[Y, n] * x
    cosine = line[X, n] * x + line[Y, n] * y
    own = line[AWAY, n]
    place = (away - own * cosine) / sine
    # Of parallel lines, the nearer hides the other, or the first of two that coincide.
    before = (away < own) | ((away == own) & (m < n))
    hides = (abs(sine) <= PARALLEL) & (cosine > 0.0) & before
    begin, end = place if sine < -PARALLEL else -far, place if sine > PARALLEL else far
    return begin, -far if hides else end


@inner_kernel
def _leave(line: Doubles, count: int, far: float) -> None:
    """Clip each line by all others.

    By two others at a time: a minimum that is stored where it was read becomes a masked store,
    which on some processors costs more than all else here.
    """
    # Start with whole lines, in full lanes.
    lanes = (count + LANES - 1) // LANES * LANES
    for n in range(lanes):
        line[BEGIN, n], line[END, n] = -far, far
    # Pad to an even count, with a line that clips none: its direction is 0.
    put(line, count, 0.0, 0.0, 1.0)
    # Clip all lines by the two.
    for m in range(0, count, 2):
        one = line[X, m], line[Y, m], line[AWAY, m]
        two = line[X, m + 1], line[Y, m + 1], line[AWAY, m + 1]
        for n in range(lanes):
            begin, end = _left(line, n, m, one, far)
            start, stop = _left(line, n, m + 1, two, far)
            line[BEGIN, n] = max(line[BEGIN, n], begin, start)
            line[END, n] = min(line[END, n], end, stop)


@inner_kernel
def meet(lines: DiscLines, count: int, far: float) -> tuple[int, int, float]:
    """Clip the lines, and keep those that bound the cell.

    Returns their number, the number of the cell's corners, and the squared distance of the
    farthest; where lines do not close a cell, corners are about `far` away.
    """
    line, corner = lines.line, lines.corner
    _leave(line, count, far)
    kept, corners, reach = 0, 0, 0.0
    for n in range(count):
        # Drop lines of which nothing is left.
        begin, end = line[BEGIN, n], line[END, n]
        if not begin < end:
            continue
        # Keep the line, and add the corner at its begin.
        x, y, away = line[X, n], line[Y, n], line[AWAY, n]
        line[X, kept], line[Y, kept], line[AWAY, kept] = x, y, away
        line[BEGIN, kept], line[END, kept] = begin, end
        kept += 1
        corner[X, corners], corner[Y, corners] = away * x - begin * y, away * y + begin * x
        reach = max(reach, away * away + begin * begin)
        corners += 1
        # An open side has a corner at its end, too.
        if end == far:
            corner[X, corners], corner[Y, corners] = away * x - end * y, away * y + end * x
            reach = max(reach, away * away + end * end)
            corners += 1

    # Fill the last lane with zeros, which no line cuts off.
    for n in range(corners, (corners + LANES - 1) // LANES * LANES):
        corner[X, n], corner[Y, n] = 0.0, 0.0
    return kept, corners, reach


@inner_kernel
def cuts(corner: Doubles, corners: int, x: float, y: float, away: float) -> bool:
    """Whether a line cuts off a corner; branch-free for SIMD."""
    beyond = 0
    for n in range((corners + LANES - 1) // LANES * LANES):
        beyond += int(x * corner[X, n] + y * corner[Y, n] > away)
    return beyond > 0
