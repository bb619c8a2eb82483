"""Planes through neighbours, their direction of least spread, and convex cells in them.

A line contributes to the cell the part that all others leave of it. That compares all pairs of
lines, but vectorized and without dependencies, as clipping by one line after the other would have.
Lines that are parallel up to rounding count as one, the nearest, so that two lines clip each other
at the same corner.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, kernel
from resample.engine.vectors import Matrix, Vector, dot
from resample.types import Doubles

SIDES = 8  # of a polygon that closes a cell
CORNERS = tuple(
    (math.cos(2.0 * math.pi * k / SIDES), math.sin(2.0 * math.pi * k / SIDES)) for k in range(SIDES)
)
MOST_LINES = 64  # lines
LANES = 4  # lines that are processed together
PARALLEL = 1e-9  # sine of an angle below which lines count as one
X, Y, AWAY, BEGIN, END = 0, 1, 2, 3, 4
STEPS = 8  # of Newton's method at most
NEAR = 2.0**-26  # of the trace: after a step this small, the next would make no difference
APART = 2.0**-8  # of the trace's square: least distance of an eigenvalue from the others
SWEEPS = 6  # of Jacobi's method: 3 × 3 matrices have then converged
STILL = 2.0**-52  # tangents of rotations that are skipped: 2⁻²⁸ of float32's resolution


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


@kernel
def _turned(m: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
    """Rotate by Jacobi's method: make the entry 0, 1 of a symmetric matrix 0.

    Rotations too small for float32 are skipped. `v` accumulates the rotations.
    """
    if abs(m[0][1]) <= STILL * abs(m[1][1] - m[0][0]):
        return m, v
    # Find the smaller of the two angles that make the entry 0.
    half = 0.5 * (m[1][1] - m[0][0]) / m[0][1]
    t = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    # Rotate columns, then rows, and the vectors found so far.
    top, low, last = _mixed(m[0], c, s), _mixed(m[1], c, s), _mixed(m[2], c, s)
    return (
        (
            (c * top[0] - s * low[0], c * top[1] - s * low[1], c * top[2] - s * low[2]),
            (s * top[0] + c * low[0], s * top[1] + c * low[1], s * top[2] + c * low[2]),
            last,
        ),
        (_mixed(v[0], c, s), _mixed(v[1], c, s), _mixed(v[2], c, s)),
    )


@kernel
def _mixed(row: Vector, c: float, s: float) -> Vector:
    """Rotate the first two columns of one row of a matrix."""
    return c * row[0] - s * row[1], s * row[0] + c * row[1], row[2]


@kernel
def _swapped(m: Matrix) -> Matrix:
    """Exchange rows and columns 1 and 2 of a matrix."""
    return (
        (m[0][0], m[0][2], m[0][1]),
        (m[2][0], m[2][2], m[2][1]),
        (m[1][0], m[1][2], m[1][1]),
    )


@kernel
def _rolled(m: Matrix) -> Matrix:
    """Permute rows and columns of a matrix to 1, 2, 0."""
    return (
        (m[1][1], m[1][2], m[1][0]),
        (m[2][1], m[2][2], m[2][0]),
        (m[0][1], m[0][2], m[0][0]),
    )


@kernel
def _turned_flattest(m: Matrix) -> Vector:
    """Return `flattest` by Jacobi's method, for eigenvalues however close."""
    v: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for _ in range(SWEEPS):
        # Rotate each of the three pairs of axes once, by permuting it to the front.
        before = v
        m, v = _turned(m, v)
        m, v = _turned(_swapped(m), _swapped(v))
        m, v = _turned(_rolled(_swapped(m)), _rolled(_swapped(v)))
        m, v = _rolled(_rolled(m)), _rolled(_rolled(v))
        # Stop when no rotation was needed.
        if v == before:
            break
    # Pick the vector of the least eigenvalue.
    least = v[0][0], v[1][0], v[2][0]
    if m[1][1] < m[0][0] and m[1][1] <= m[2][2]:
        least = v[0][1], v[1][1], v[2][1]
    elif m[2][2] < m[0][0]:
        least = v[0][2], v[1][2], v[2][2]
    return least


@kernel
def _least(m: Matrix, trace: float) -> float:
    """Least eigenvalue of a positive semidefinite matrix; NaN if another is as near.

    Newton's method does not overshoot the first zero of the characteristic polynomial.
    """
    # Compute the coefficients of the characteristic polynomial.
    minors = (
        m[0][0] * m[1][1]
        - m[0][1] * m[0][1]
        + (m[0][0] * m[2][2] - m[0][2] * m[0][2])
        + (m[1][1] * m[2][2] - m[1][2] * m[1][2])
    )
    # Without a gap to the other eigenvalues the method would not converge.
    if not minors > APART * trace * trace:
        return math.nan
    determinant = (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[1][2])
        - m[0][1] * (m[0][1] * m[2][2] - m[1][2] * m[0][2])
        + m[0][2] * (m[0][1] * m[1][2] - m[1][1] * m[0][2])
    )
    # Approach the zero from below.
    value = 0.0
    for _ in range(STEPS):
        rest = ((value - trace) * value + minors) * value - determinant
        step = rest / ((3.0 * value - 2.0 * trace) * value + minors)
        value -= step
        if abs(step) <= NEAR * trace:
            return value
    return math.nan


@kernel
def flattest(m: Matrix) -> Vector:
    """Unit vector along which a positive semidefinite symmetric 3 × 3 matrix is least.

    Columns of the adjugate of the matrix minus the eigenvalue lie along the eigenvector.
    """
    trace = m[0][0] + m[1][1] + m[2][2]
    value = _least(m, trace)
    # Compute the adjugate's diagonal; Jacobi's method takes what is close to degenerate, or NaN.
    x, y, z = m[0][0] - value, m[1][1] - value, m[2][2] - value
    xx, yy, zz = y * z - m[1][2] * m[1][2], x * z - m[0][2] * m[0][2], x * y - m[0][1] * m[0][1]
    if not xx + yy + zz > APART * trace * trace:
        return _turned_flattest(m)
    # Take the longest column of the adjugate.
    xy, xz = m[0][2] * m[1][2] - m[0][1] * z, m[0][1] * m[1][2] - m[0][2] * y
    yz = m[0][1] * m[0][2] - x * m[1][2]
    if xx >= yy and xx >= zz:
        along = xx, xy, xz
    elif yy >= zz:
        along = xy, yy, yz
    else:
        along = xz, yz, zz
    length = math.sqrt(dot(along, along))
    return along[0] / length, along[1] / length, along[2] / length
