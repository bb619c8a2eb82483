"""What a point of a cloud stands for: its cell among its neighbours, in the plane of the surface.

The cell is that part of the tangent plane which is nearer to the point than to any neighbour. Discs
that contain the cells of their points leave no gap on a surface, however irregular the sampling.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.engine.vectors import Matrix, Vector, cross, dot
from resample.types import Doubles, Floats
from resample_warp3d.clouds.kernels.flattest import flattest

Indices = NDArray[np.int64]
Nearest = NDArray[np.int32]

CHUNK = 1024  # points that a thread takes at a time
MOST_CORNERS = 64
SIDES = 8  # of the polygon that a cell is cut out of
WIDEST = 0.7  # distances to the last neighbour, half the width of that polygon
AROUND = 5  # nearest neighbours, whose mean distance is the spacing at a rim
RIM = 0.65  # of that spacing: how far a cell reaches where there is no neighbour
FARTHEST = 5.0  # times that: how far it reaches among neighbours
LONGEST = 8.0  # times its width a disc may be long
ALIKE = 0.5  # of a point's spacing: neighbours with as much lie as lonely as it does
FEW = 1  # of such neighbours have only stray points
SLACK = 1.02  # discs overlap by this
CORNERS = tuple(
    (math.cos(2.0 * math.pi * k / SIDES), math.sin(2.0 * math.pi * k / SIDES)) for k in range(SIDES)
)


class Spaced(NamedTuple):
    """What is measured of N points."""

    axes: Floats  # (N, 2, 3) half axes of each point's disc, first × second along the normal
    spacing: Floats  # (N,) mean distance to the nearest neighbours


@inner_kernel
def _spread(position: Floats, neighbour: Indices, n: int) -> Matrix:
    """Covariance of a point's neighbours, of which it is one itself."""
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
    xx, xy, xz = xx - sx * sx / count, xy - sx * sy / count, xz - sx * sz / count
    yy, yz, zz = yy - sy * sy / count, yz - sy * sz / count, zz - sz * sz / count
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


@kernel
def across(normal: Vector) -> Vector:
    """A unit vector perpendicular to another."""
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
def _open_polygon(polygons: Doubles, half: float) -> None:
    """Start with a regular polygon of half a width, the first one."""
    outer = half / math.cos(math.pi / SIDES)
    for k in range(SIDES):
        polygons[0, k, 0], polygons[0, k, 1] = outer * CORNERS[k][0], outer * CORNERS[k][1]
        polygons[0, k, 2] = 0.0  # the side from here to the next corner is of no neighbour


@inner_kernel
def _is_cut(polygons: Doubles, which: int, corners: int, side: Vector) -> bool:
    """Whether a corner is where side · (x, y) is above side[2]; by how much is its last number."""
    beyond = 0
    for k in range(corners):
        by = side[0] * polygons[which, k, 0] + side[1] * polygons[which, k, 1] - side[2]
        polygons[which, k, 3] = by
        beyond += int(by > 0.0)
    return beyond > 0


@inner_kernel
def _cut(polygons: Doubles, which: int, corners: int, distance: float) -> int:
    """Cut away what `_is_cut` has found; `distance` marks the new side.

    What is left is in the other polygon; gives the number of its corners.
    """
    other, count, last = 1 - which, 0, corners - 1
    before = polygons[which, last, 3]
    for k in range(corners):
        here = polygons[which, k, 3]
        if (before > 0.0) != (here > 0.0) and count < MOST_CORNERS:
            share = before / (before - here)
            for c in range(2):
                start = polygons[which, last, c]
                polygons[other, count, c] = start + share * (polygons[which, k, c] - start)
            polygons[other, count, 2] = distance if here > 0.0 else polygons[which, last, 2]
            count += 1
        if here <= 0.0 and count < MOST_CORNERS:
            for c in range(3):
                polygons[other, count, c] = polygons[which, k, c]
            count += 1
        before, last = here, k
    return count


@inner_kernel
def _reach(polygons: Doubles, which: int, corners: int) -> float:
    """Square of the distance of the farthest corner."""
    most = 0.0
    for k in range(corners):
        x, y = polygons[which, k, 0], polygons[which, k, 1]
        most = max(most, x * x + y * y)
    return most


@inner_kernel
def _cell(
    position: Floats,
    neighbour: Indices,
    n: int,
    frame: tuple[Vector, Vector],
    half: float,
    polygons: Doubles,
) -> tuple[int, int]:
    """Cell of a point in the plane of two unit vectors; which polygon it is, and its corners.

    Polygons are (2, MOST_CORNERS, 4): x, y, the mark of the side after a corner, and how far it is
    beyond a cut.
    """
    which, corners = 0, SIDES
    _open_polygon(polygons, half)
    reach = _reach(polygons, which, corners)
    here = neighbour[n, 0]
    for j in range(1, neighbour.shape[1]):
        there = neighbour[n, j]
        step = (
            float(position[there, 0]) - position[here, 0],
            float(position[there, 1]) - position[here, 1],
            float(position[there, 2]) - position[here, 2],
        )
        square = dot(step, step)
        if square >= 4.0 * reach:  # neighbours come by distance
            break
        # The plane between both points, where it meets the tangent plane.
        side = dot(step, frame[0]), dot(step, frame[1]), 0.5 * square
        if square > 0.0 and _is_cut(polygons, which, corners, side):
            corners = _cut(polygons, which, corners, math.sqrt(square))
            which = 1 - which
            reach = _reach(polygons, which, corners)
    return which, corners


@inner_kernel
def _is_open(polygons: Doubles, which: int, corners: int) -> bool:
    """Whether a side of a cell is of no neighbour."""
    least = np.inf
    for k in range(corners):
        least = min(least, polygons[which, k, 2])
    return least == 0.0


@inner_kernel
def _distance(position: Floats, neighbour: Indices, n: int, j: int) -> float:
    """Distance of a point's j-th neighbour; of the last one if there are fewer."""
    here, there = neighbour[n, 0], neighbour[n, min(j, neighbour.shape[1] - 1)]
    x = float(position[there, 0]) - position[here, 0]
    y = float(position[there, 1]) - position[here, 1]
    z = float(position[there, 2]) - position[here, 2]
    return math.sqrt(x * x + y * y + z * z)


@inner_kernel
def _rim(position: Floats, neighbour: Indices, n: int) -> float:
    """How far a cell reaches where it has no neighbour."""
    total = 0.0
    for j in range(1, AROUND + 1):
        total += _distance(position, neighbour, n, j)
    return RIM * total / AROUND


@inner_kernel
def _ellipse(polygons: Doubles, which: int, corners: int) -> tuple[float, float, float, float]:
    """Half axes (x₁, y₁), (x₂, y₂) of an ellipse about the origin that contains a polygon.

    Its shape is that of the polygon's second moments.
    """
    xx, xy, yy = 0.0, 0.0, 0.0
    for k in range(corners):
        m = k + 1 if k + 1 < corners else 0
        ax, ay = polygons[which, k, 0], polygons[which, k, 1]
        bx, by = polygons[which, m, 0], polygons[which, m, 1]
        area = ax * by - bx * ay
        xx += area * (ax * ax + ax * bx + bx * bx)
        xy += area * (2.0 * ax * ay + ax * by + bx * ay + 2.0 * bx * by)
        yy += area * (ay * ay + ay * by + by * by)
    xy *= 0.5
    mean, odd = 0.5 * (xx + yy), math.hypot(0.5 * (xx - yy), xy)
    if mean <= 0.0:
        return 0.0, 0.0, 0.0, 0.0
    angle = 0.5 * math.atan2(xy, 0.5 * (xx - yy))
    c, s = math.cos(angle), math.sin(angle)
    long = math.sqrt(mean + odd)
    short = max(math.sqrt(max(0.0, mean - odd)), long / LONGEST)
    scale = 0.0
    for k in range(corners):
        x, y = polygons[which, k, 0], polygons[which, k, 1]
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
    polygons: Doubles,
    normal: Floats,
    discs: Spaced,
) -> bool:
    """Find normal and disc of a point.

    Parameters
    ----------
    position
        (N, 3) of all points.
    neighbour
        (M, k) some points and their neighbours, by distance, themselves first.
    n
        Which of these.
    is_last
        Close the cell if it is open.
    polygons
        (2, MOST_CORNERS, 4) to work with.
    normal
        (N, 3) made unit length; filled where it is 0, with either of both signs.
    discs
        Filled.

    Returns
    -------
    Whether there are not enough neighbours all around the point, or it lies at a rim; its disc is
    then left to the last look.
    """
    here = neighbour[n, 0]
    known = (float(normal[here, 0]), float(normal[here, 1]), float(normal[here, 2]))
    length = math.sqrt(dot(known, known))
    if length > 0.0:
        upward = (known[0] / length, known[1] / length, known[2] / length)
    else:
        upward = flattest(_spread(position, neighbour, n))
    frame = across(upward), cross(upward, across(upward))
    half = WIDEST * _distance(position, neighbour, n, neighbour.shape[1])
    rim = _rim(position, neighbour, n)
    if is_last:
        half = min(half, FARTHEST * rim)
    which, corners = _cell(position, neighbour, n, frame, half, polygons)
    is_open = _is_open(polygons, which, corners)
    for c in range(3):
        normal[here, c] = np.float32(upward[c])
    if is_open and not is_last:
        return True
    if is_open and is_last:
        half = min(half, rim)
        which, corners = _cell(position, neighbour, n, frame, half, polygons)
    x1, y1, x2, y2 = _ellipse(polygons, which, corners)
    for c in range(3):
        discs.axes[here, 0, c] = np.float32(x1 * frame[0][c] + y1 * frame[1][c])
        discs.axes[here, 1, c] = np.float32(x2 * frame[0][c] + y2 * frame[1][c])
    discs.spacing[here] = np.float32(rim / RIM)
    return is_open


@kernel
def _upper_of(numbers: Doubles, count: int) -> float:
    """Upper quartile of the first numbers, which change their order."""
    for n in range(1, count):
        number, place = numbers[n], n
        while place > 0 and numbers[place - 1] > number:
            numbers[place] = numbers[place - 1]
            place -= 1
        numbers[place] = number
    return float(numbers[3 * count // 4])


@kernel
def _limit(
    nearest: Nearest, spacing: Floats, size: Floats, most: float, axes: Floats, chunk: int
) -> None:
    start = int(np.int64(chunk)) * CHUNK
    count = nearest.shape[1]
    sizes, lengths = np.empty(count), np.empty(2)
    for n in range(start, min(start + CHUNK, size.size)):
        alike, long = 0, 0.0
        for j in range(count):
            there = nearest[n, j]
            sizes[j] = size[there]
            alike += int(spacing[there] >= ALIKE * spacing[n])
        factor = most if alike > FEW else 1.0
        for k in range(2):
            lengths[k] = _length(axes, n, k)
            long = max(long, lengths[k])
        enough = 0
        for j in range(count):
            enough += int(sizes[j] * factor >= long)
        if enough >= count - 3 * count // 4:
            continue  # the upper quartile is one of those
        reach = _upper_of(sizes, count) * factor
        for k in range(2):
            if lengths[k] > reach:
                for c in range(3):
                    axes[n, k, c] *= np.float32(reach / lengths[k])


@kernel
def _length(axes: Floats, n: int, k: int) -> float:
    x, y, z = float(axes[n, k, 0]), float(axes[n, k, 1]), float(axes[n, k, 2])
    return math.sqrt(x * x + y * y + z * z)


@parallel_kernel
def limit(
    counter: Counter,
    nearest: Nearest,
    spacing: Floats,
    size: Floats,
    most: float,
    axes: Floats,
) -> None:
    """Shorten the half axes of discs that are far larger than those around them.

    A half axis is at most `most` times as long as the upper quartile of the sizes around it, which
    three of twelve cannot raise; of a stray point, as no more than one around is half as lonely,
    not longer than that. Points far from a surface would else cover it, and thorns stand out from
    its rims.

    Parameters
    ----------
    nearest
        (N, k) neighbours of each point, without itself.
    spacing
        (N,) mean distance to the nearest of them.
    size
        (N,) longest half axes before.
    most
        See above.
    axes
        (N, 2, 3) what is changed.
    """
    for chunk in tasks(counter, (nearest.shape[0] + CHUNK - 1) // CHUNK):
        _limit(nearest, spacing, size, most, axes, chunk)


@kernel
def _lay(normal: Floats, radius: Floats, axes: Floats, chunk: int) -> None:
    start = int(np.int64(chunk)) * CHUNK
    for n in range(start, min(start + CHUNK, radius.size)):
        known = (float(normal[n, 0]), float(normal[n, 1]), float(normal[n, 2]))
        length = math.sqrt(dot(known, known))
        upward = (known[0] / length, known[1] / length, known[2] / length)
        one = across(upward)
        two = cross(upward, one)
        for c in range(3):
            normal[n, c] = np.float32(upward[c])
            axes[n, 0, c] = np.float32(radius[n] * one[c])
            axes[n, 1, c] = np.float32(radius[n] * two[c])


@parallel_kernel
def lay(counter: Counter, normal: Floats, radius: Floats, axes: Floats) -> None:
    """Round discs of known radius (N,); `axes` (N, 2, 3) is filled, normals get unit length."""
    for chunk in tasks(counter, (radius.size + CHUNK - 1) // CHUNK):
        _lay(normal, radius, axes, chunk)
