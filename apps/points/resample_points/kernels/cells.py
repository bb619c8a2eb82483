"""Normal and Voronoi cell of a cloud's point among its neighbours, in the tangent plane.

The normal is the direction of the neighbours' least spread. The cell is the part of the tangent
plane that is nearer to the point than to any neighbour. Discs that contain the cells of their
points leave no gap on a surface, however irregular the sampling.

A line contributes to the cell the part that all others leave of it. That compares all pairs of
lines, but vectorized and without dependencies, as clipping by one line after the other would have.
Lines that are parallel up to rounding count as one, the nearest, so that two lines clip each other
at the same corner.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.engine.vectors import Matrix, Vector, cross, dot
from resample.types import Doubles, Floats, Indices

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
    """Begin and end of line n's part on the inner side of another line."""
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
        # Drop lines that were clipped entirely.
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
    return ((m[0][0], m[0][2], m[0][1]), (m[2][0], m[2][2], m[2][1]), (m[1][0], m[1][2], m[1][1]))


@kernel
def _rolled(m: Matrix) -> Matrix:
    """Permute rows and columns of a matrix to 1, 2, 0."""
    return ((m[1][1], m[1][2], m[1][0]), (m[2][1], m[2][2], m[2][0]), (m[0][1], m[0][2], m[0][0]))


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
    """Least eigenvalue of a positive semidefinite matrix; NaN if it is not unique.

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
    # Compute the adjugate's diagonal; Jacobi's method handles near-degenerate cases and NaN.
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


Nearest = NDArray[np.int32]

CHUNK = 1024  # points that a thread takes at a time
WIDEST = 0.73  # corners of a cell lie within this times the distance to the last neighbour
FARAWAY = 1e3  # times that: where sides of open cells end
BATCH_SIZE = 12  # neighbours that are visited together
AROUND = 5  # nearest neighbours; their mean distance is the spacing at a rim
OUTLINE_SHARE = 0.65  # of the spacing: extent of a cell where there is no neighbour
FARTHEST = 5.0  # times that: extent of a cell among neighbours
CLUMPED = 1.3  # times the distance to the twelfth neighbour: the same, at least
LONGEST = 8.0  # ratio of a disc's length to its width, at most
SIMILAR_SPACING = 0.5  # of a point's spacing: neighbours with at least that are as isolated
FEW = 1  # stray points have at most so many of such neighbours
SLACK = 1.02  # factor by which discs overlap


@inner_kernel
def _spread(position: Floats, neighbour: Indices, n: int) -> Matrix:
    """Covariance of a point's neighbours, itself included, times their number."""
    # Sum offsets from the point itself, which keeps precision far from the origin.
    count = neighbour.shape[1]
    here = neighbour[n, 0]
    sx, sy, sz = 0.0, 0.0, 0.0
    xx, xy, xz, yy, yz, zz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(count):
        there = neighbour[n, j]
        x = float(position[there, 0]) - position[here, 0]
        y = float(position[there, 1]) - position[here, 1]
        z = float(position[there, 2]) - position[here, 2]
        sx, sy, sz = sx + x, sy + y, sz + z
        xx, xy, xz = xx + x * x, xy + x * y, xz + x * z
        yy, yz, zz = yy + y * y, yz + y * z, zz + z * z
    # Subtract the mean.
    xx, xy, xz = xx - sx * sx / count, xy - sx * sy / count, xz - sx * sz / count
    yy, yz, zz = yy - sy * sy / count, yz - sy * sz / count, zz - sz * sz / count
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


@kernel
def across(normal: Vector) -> Vector:
    """A unit vector perpendicular to another."""
    # Turn away from the axis that the vector is least along.
    x, y, z = abs(normal[0]), abs(normal[1]), abs(normal[2])
    if x <= y and x <= z:
        side = (0.0, -normal[2], normal[1])
    elif y <= z:
        side = (normal[2], 0.0, -normal[0])
    else:
        side = (-normal[1], normal[0], 0.0)
    length = math.sqrt(dot(side, side))
    return side[0] / length, side[1] / length, side[2] / length


@inner_kernel
def _cell(
    position: Floats,
    neighbour: Indices,
    n: int,
    frame: tuple[Vector, Vector],
    far: float,
    lines: DiscLines,
) -> tuple[int, int, float]:
    """Cell of a point in the plane of two unit vectors; returns as `meet`."""
    here, count, corners, reach = neighbour[n, 0], 0, 0, np.inf
    line, last = lines.line, neighbour.shape[1]
    # Visit neighbours in batches, by distance.
    for first in range(1, last, BATCH_SIZE):
        known, square = count, 0.0
        for j in range(first, min(first + BATCH_SIZE, last)):
            there = neighbour[n, j]
            step = (
                float(position[there, 0]) - position[here, 0],
                float(position[there, 1]) - position[here, 1],
                float(position[there, 2]) - position[here, 2],
            )
            # The bisecting plane meets the tangent plane in a line.
            x, y, square = dot(step, frame[0]), dot(step, frame[1]), dot(step, step)
            scale = 1.0 / math.sqrt(x * x + y * y)
            # Skip neighbours straight above; their bisector is parallel.
            if not scale < np.inf:
                continue
            # Keep lines that cut the cell.
            x, y, away = scale * x, scale * y, scale * 0.5 * square
            if first == 1 or cuts(lines.corner, corners, x, y, away):
                put(line, count, x, y, away)
                count += 1
        # Clip the cell, and stop when all further bisectors lie beyond its farthest corner.
        if count > known:
            count, corners, reach = meet(lines, count, far)
        if reach <= 0.25 * square:
            break
    return count, corners, reach


@inner_kernel
def _distance(position: Floats, neighbour: Indices, n: int, j: int) -> float:
    """Distance to a point's j-th neighbour, or to the last one if there are fewer."""
    here, there = neighbour[n, 0], neighbour[n, min(j, neighbour.shape[1] - 1)]
    x = float(position[there, 0]) - position[here, 0]
    y = float(position[there, 1]) - position[here, 1]
    z = float(position[there, 2]) - position[here, 2]
    return math.sqrt(x * x + y * y + z * z)


@inner_kernel
def _ellipse(lines: DiscLines, count: int, corners: int) -> tuple[float, float, float, float]:
    """Half axes (x₁, y₁), (x₂, y₂) of a centered ellipse that contains a cell.

    Its shape follows from the cell's second moments.
    """
    # Add up the second moments of triangles between the origin and each side.
    line, corner = lines.line, lines.corner
    xx, xy, yy = 0.0, 0.0, 0.0
    for k in range(count):
        x, y, away, begin, end = line[X, k], line[Y, k], line[AWAY, k], line[BEGIN, k], line[END, k]
        # Along the triangle's normal all moments are away², along its side these.
        area = away * (end - begin)
        along, aside = begin * begin + begin * end + end * end, 1.5 * away * (begin + end)
        own = 3.0 * away * away
        xx += area * (own * x * x - 2.0 * aside * x * y + along * y * y)
        xy += area * ((own - along) * x * y + aside * (x * x - y * y))
        yy += area * (own * y * y + 2.0 * aside * x * y + along * x * x)

    # Diagonalize the moments; the ellipse is never too thin.
    mean, odd = 0.5 * (xx + yy), math.sqrt(0.25 * (xx - yy) * (xx - yy) + xy * xy)
    if mean <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    # Take cosine and sine of half the angle; take the larger of both by the square root.
    c, s = 1.0, 0.0
    if odd != 0.0:
        x = 0.5 * (xx - yy)
        one = math.sqrt(0.5 * (odd + abs(x)) / odd)
        other = 0.5 * abs(xy) / (odd * one)
        c, s = (one, other) if x >= 0.0 else (other, one)
        s = math.copysign(s, xy)
    long = math.sqrt(mean + odd)
    short = max(math.sqrt(max(0.0, mean - odd)), long / LONGEST)

    # Scale the ellipse until it contains all corners.
    scale = 0.0
    for k in range(corners):
        x, y = corner[X, k], corner[Y, k]
        along = (c * x + s * y) / long
        aside = (c * y - s * x) / short
        scale = max(scale, along * along + aside * aside)
    scale = SLACK * math.sqrt(scale)
    return scale * long * c, scale * long * s, -scale * short * s, scale * short * c


@inner_kernel
def measure(
    position: Floats,
    neighbour: Indices,
    n: int,
    is_last: bool,
    lines: DiscLines,
    normal: Floats,
    axes: Floats,
    spacing: Floats,
) -> bool:
    """Measure the normal and the disc of a point; tell whether its cell is open.

    The point then has too few neighbours all around, or lies at a rim; its disc is left to a last
    call, with `is_last`, which closes the cell. `position`: (N, 3) of all points. `neighbour`:
    (M, k) some points and their neighbours, by distance, themselves first. `n`: row of these.
    `normal`: (N, 3) scaled to unit length; filled where it is 0, with an arbitrary sign. `axes`,
    `spacing`: (N, 2, 3), first × second along the normal, and (N,) mean distance to the nearest
    neighbours; filled.
    """
    # Take the given normal, or the direction in which the neighbours are spread least.
    here = neighbour[n, 0]
    known = (float(normal[here, 0]), float(normal[here, 1]), float(normal[here, 2]))
    length = math.sqrt(dot(known, known))
    if length > 0.0:
        upward = (known[0] / length, known[1] / length, known[2] / length)
    else:
        upward = flattest(_spread(position, neighbour, n))

    # Clip the cell in the tangent plane.
    frame = across(upward), cross(upward, across(upward))
    half = WIDEST * _distance(position, neighbour, n, neighbour.shape[1])
    # Where it has no neighbour a cell extends by a share of the spacing.
    total = 0.0
    for j in range(1, AROUND + 1):
        total += _distance(position, neighbour, n, j)
    rim = OUTLINE_SHARE * total / AROUND
    if is_last:
        # In a clump the nearest neighbours are too near to tell how far the next ones may be.
        half = min(
            half, max(FARTHEST * rim, CLUMPED * _distance(position, neighbour, n, BATCH_SIZE))
        )
    count, corners, reach = _cell(position, neighbour, n, frame, FARAWAY * half, lines)
    is_open = reach > half * half

    # Store the normal, and leave open cells to a call with more neighbours.
    for c in range(3):
        normal[here, c] = np.float32(upward[c])
    if is_open and not is_last:
        return True
    # Close open cells at a rim by a polygon.
    if is_open:
        count = put_around(lines.line, count, min(half, rim))
        count, corners, _ = meet(lines, count, FARAWAY * half)

    # Fit the disc's ellipse, and map it to space.
    x1, y1, x2, y2 = _ellipse(lines, count, corners)
    for c in range(3):
        axes[here, 0, c] = np.float32(x1 * frame[0][c] + y1 * frame[1][c])
        axes[here, 1, c] = np.float32(x2 * frame[0][c] + y2 * frame[1][c])
    spacing[here] = np.float32(rim / OUTLINE_SHARE)
    return is_open


@parallel_kernel
def limit(
    counter: Counter, nearest: Nearest, spacing: Floats, size: Floats, most: float, axes: Floats
) -> None:
    """Shorten the half axes of discs that are far larger than those around them.

    A half axis is at most `most` times as long as the upper quartile of the sizes around it, which
    three outliers of twelve cannot raise. A stray point, around which at most one other is half as
    isolated, gets no more than the quartile. Otherwise points far from a surface would cover it,
    and spikes would stick out from its rims.

    `nearest`: (N, k) neighbours of each point, without itself. `spacing`: (N,) mean distance to the
    nearest of them. `size`: (N,) longest half axes before. `most`: factor of the limit. `axes`: (N,
    2, 3) changed in place.
    """
    count = nearest.shape[1]
    for chunk in tasks(counter, (nearest.shape[0] + CHUNK - 1) // CHUNK):
        sizes, lengths = np.empty(count), np.empty(2)
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, size.size)):
            # Collect the sizes around, and count neighbours as isolated as the point.
            alike, long = 0, 0.0
            for j in range(count):
                there = nearest[n, j]
                sizes[j] = size[there]
                alike += int(spacing[there] >= SIMILAR_SPACING * spacing[n])
            # A stray point gets no margin.
            factor = most if alike > FEW else 1.0
            for k in range(2):
                x, y, z = float(axes[n, k, 0]), float(axes[n, k, 1]), float(axes[n, k, 2])
                lengths[k] = math.sqrt(x * x + y * y + z * z)
                long = max(long, lengths[k])
            # Skip the sort if enough sizes around are long enough to hold the quartile.
            enough = 0
            for j in range(count):
                enough += int(sizes[j] * factor >= long)
            if enough >= count - 3 * count // 4:
                continue
            # Sort the sizes, and shorten the axes to the limit.
            for j in range(1, count):
                number, place = sizes[j], j
                while place > 0 and sizes[place - 1] > number:
                    sizes[place] = sizes[place - 1]
                    place -= 1
                sizes[place] = number
            reach = sizes[3 * count // 4] * factor
            for k in range(2):
                if lengths[k] > reach:
                    for c in range(3):
                        axes[n, k, c] *= np.float32(reach / lengths[k])


@parallel_kernel
def lay(counter: Counter, normal: Floats, radius: Floats, axes: Floats) -> None:
    """Make round discs of known radius (N,): fill `axes` (N, 2, 3).

    Normals are scaled to unit length.
    """
    for chunk in tasks(counter, (radius.size + CHUNK - 1) // CHUNK):
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, radius.size)):
            known = (float(normal[n, 0]), float(normal[n, 1]), float(normal[n, 2]))
            length = math.sqrt(dot(known, known))
            upward = (known[0] / length, known[1] / length, known[2] / length)
            # Any pair of perpendicular axes will do for a round disc.
            one = across(upward)
            two = cross(upward, one)
            for c in range(3):
                normal[n, c] = np.float32(upward[c])
                axes[n, 0, c] = np.float32(radius[n] * one[c])
                axes[n, 1, c] = np.float32(radius[n] * two[c])
