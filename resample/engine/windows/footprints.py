"""Footprints of pixels in a grid, and the boxes that stand for them.

A pixel covers about a parallelogram of the grid. A box with the same second moments has the same
mean of what varies slowly, up to fourth order; a pixel in which the grid varies too much for that
is split into parts. A parallelogram along the grid's axes is such a box itself.

Where a pixel lies is up to the application, which plays the role `footprint_at`.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel, inner_step, kernel
from resample.engine.roles import role
from resample.engine.windows.boxes import Integral, Plate, PointTaps, folded
from resample.engine.windows.limits import Limits
from resample.types import Doubles

MOST_CORNERS = 8  # of a quadrilateral clipped to a rectangle


@inner_kernel
def halve(
    polygon: Doubles, spare: Doubles, count: int, axis: int, bound: float, sign: float
) -> int:
    """Clip a convex polygon at a bound on one axis; return the number of its corners."""
    kept = 0
    # Sutherland-Hodgman: keep corners inside, and add where edges cross the bound.
    for k in range(count):
        m = (k + 1) % count
        here, there = sign * (polygon[k, axis] - bound), sign * (polygon[m, axis] - bound)
        if here >= 0.0:
            spare[kept, 0], spare[kept, 1] = polygon[k, 0], polygon[k, 1]
            kept += 1
        if (here >= 0.0) != (there >= 0.0):
            share = here / (here - there)
            for c in range(2):
                spare[kept, c] = polygon[k, c] + share * (polygon[m, c] - polygon[k, c])
            kept += 1
    # Copy the result back.
    for k in range(kept):
        polygon[k, 0], polygon[k, 1] = spare[k, 0], spare[k, 1]
    return kept


@inner_kernel
def cut_to(
    polygon: Doubles, spare: Doubles, count: int, rectangle: tuple[float, float, float, float]
) -> int:
    """Clip a convex polygon to left, top, right, bottom; return the number of its corners."""
    count = halve(polygon, spare, count, 0, rectangle[0], 1.0)
    count = halve(polygon, spare, count, 1, rectangle[1], 1.0)
    count = halve(polygon, spare, count, 0, rectangle[2], -1.0)
    return halve(polygon, spare, count, 1, rectangle[3], -1.0)


@inner_kernel
def area(polygon: Doubles, count: int) -> float:
    """Area of a polygon of `count` corners, of either orientation."""
    # Shoelace formula.
    total = 0.0
    for k in range(count):
        m = (k + 1) % count
        total += polygon[k, 0] * polygon[m, 1] - polygon[m, 0] * polygon[k, 1]
    return float(0.5 * np.abs(total))


@kernel
def crossing(rim: Doubles, count: int, height: float) -> tuple[float, float]:
    """Left and right end of a level line in a convex polygon; not in order if none.

    Each edge is computed from its upper end, so that polygons which share it agree on it.
    """
    low, high = np.inf, -np.inf
    for k in range(count):
        m = (k + 1) % count
        # Intersect each edge that crosses the line.
        if (rim[k, 1] <= height) != (rim[m, 1] <= height):
            upper, lower = (k, m) if rim[k, 1] < rim[m, 1] else (m, k)
            share = (height - rim[upper, 1]) / (rim[lower, 1] - rim[upper, 1])
            x = rim[upper, 0] + share * (rim[lower, 0] - rim[upper, 0])
            low, high = min(low, x), max(high, x)
    return low, high


@kernel
def box(polygon: Doubles, count: int) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a polygon (count, 2)."""
    left, top, right, bottom = np.inf, np.inf, -np.inf, -np.inf
    for k in range(count):
        left, right = min(left, polygon[k, 0]), max(right, polygon[k, 0])
        top, bottom = min(top, polygon[k, 1]), max(bottom, polygon[k, 1])
    return left, top, right, bottom


@kernel
def reach(polygon: Doubles, count: int) -> float:
    """Width and height of a polygon together."""
    left, top, right, bottom = box(polygon, count)
    return right - left + bottom - top


PixelGeometry = Any  # a bundle of the application's, whose class selects where pixels lie

LEAN = 0.1  # samples², 12 times a part's mixed moment, from which on two boxes stand for it
LEANEST = 0.5  # samples², mixed moment of one side of a part, at most
MOST_PARTS = 64.0  # of a pixel along an axis
LIMITED = 2.0  # samples along u and v up to which the limits at one position hold for a pixel
NEARLY = 1e-6  # samples, or share of a pixel, that count as nothing
OWN = 1.001  # samples², a sample's own extent along an axis, and what maps in float32 round


class PixelFootprint(NamedTuple):
    """The footprint of a pixel: a parallelogram in source coordinates."""

    u: float  # its center; NaN: nothing
    v: float
    along_x: tuple[float, float]  # step (u, v) of a pixel to the right
    along_y: tuple[float, float]  # and down


class GridView(NamedTuple):
    """A grid, and how pixels gather from it."""

    plate: Plate
    integral: Integral
    points: PointTaps  # its weights at points; none: pixels are averaged over all that they cover
    size: tuple[int, int]  # (height, width) of the source; the grid is a part of it, with margins
    edge: int
    margin: float  # samples around the source into which positions are folded; inf: they are not
    finest: float  # samples², tolerance of splitting pixels; see `parts_of`
    limits: Limits


@role
def footprint_at(geometry: PixelGeometry, row: int, column: int) -> PixelFootprint:
    """The footprint of a pixel."""
    raise NotImplementedError


@inner_step
def is_box(footprint: PixelFootprint, finest: float) -> bool:
    """Whether one or two boxes approximate a pixel well enough; see `parts_of`."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    leans = max(abs(ux * vx), abs(uy * vy)) <= LEANEST * finest
    return bool(leans and max(abs(ux * uy), abs(vx * vy)) <= finest)


@inner_kernel
def parts_of(footprint: PixelFootprint, finest: float) -> tuple[int, int]:
    """Parts of a pixel along x and y that boxes approximate up to a fourth moment.

    Along u, that moment of a parallelogram differs from a box's by (a b)² / 60, with a and b the
    extents of its sides, which falls with the square of the number of parts. Slanted parts become
    two boxes, which stand for about a sample along a diagonal at most.
    """
    # Split sides that slant too much.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    parts, leanest = max(abs(ux * uy), abs(vx * vy)) / finest, LEANEST * finest
    count_x = max(1.0, math.ceil(math.sqrt(abs(ux * vx) / leanest)))
    count_y = max(1.0, math.ceil(math.sqrt(abs(uy * vy) / leanest)))
    # If that is not enough, split further, the longer side first.
    if parts > count_x * count_y:
        longer = math.hypot(uy, vy) / max(math.hypot(ux, vx), 1e-30)
        count_x = max(count_x, math.ceil(min(math.sqrt(parts / longer), MOST_PARTS)))
        count_y = max(count_y, math.ceil(min(parts / count_x, MOST_PARTS)))
    return int(min(count_x, MOST_PARTS)), int(min(count_y, MOST_PARTS))


@inner_kernel
def nth_part(footprint: PixelFootprint, counts: tuple[int, int], n: int) -> PixelFootprint:
    """The nth part of a pixel."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    x = (n % counts[0] + 0.5) / counts[0] - 0.5
    y = (n // counts[0] + 0.5) / counts[1] - 0.5
    return PixelFootprint(
        footprint.u + x * ux + y * uy,
        footprint.v + x * vx + y * vy,
        (ux / counts[0], vx / counts[0]),
        (uy / counts[1], vy / counts[1]),
    )


@inner_kernel
def shrunk(footprint: PixelFootprint, own: float) -> PixelFootprint:
    """By how much a footprint is larger than a sample: their second moments' difference.

    A sample is already a mean over its own extent, which interpolation may widen, so only what a
    pixel covers beyond that is to be averaged: nothing where samples keep their size or grow.
    """
    # Second moments, times 12, and their eigenvalues.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    uu, vv, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    # Both are below a sample's own if its moments less these are those of an ellipse.
    if uu <= own and vv <= own and uv * uv <= (own - uu) * (own - vv):
        return PixelFootprint(footprint.u, footprint.v, (0.0, 0.0), (0.0, 0.0))
    middle, half = 0.5 * (uu + vv), 0.5 * (uu - vv)
    apart = math.sqrt(half * half + uv * uv)
    # Subtract the sample's own along both eigenvectors.
    longer = math.sqrt(max(middle + apart - own, 0.0))
    shorter = math.sqrt(max(middle - apart - own, 0.0))
    # Halve the angle 2 a of their axes: cos 2a = (uu − vv) / 2 apart.
    double = 0.5 * (uu - vv) / apart if apart > NEARLY else 1.0
    x = math.sqrt(max(0.5 + 0.5 * double, 0.0))
    y = math.copysign(math.sqrt(max(0.5 - 0.5 * double, 0.0)), uv)
    along_x, along_y = (longer * x, longer * y), (-shorter * y, shorter * x)
    return PixelFootprint(footprint.u, footprint.v, along_x, along_y)


@inner_step
def averaged(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """What a pixel is averaged over: its footprint, or what of it is larger than a sample."""
    return footprint if view.points.taps == 0 else shrunk(footprint, view.points.own)


@inner_step
def fold(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """Fold a pixel to the equivalent footprint within the grid."""
    if view.margin == math.inf:
        return footprint
    u, turn_u = folded(footprint.u, float(view.size[1]), view.edge, view.margin)
    v, turn_v = folded(footprint.v, float(view.size[0]), view.edge, view.margin)
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return PixelFootprint(u, v, (turn_u * ux, turn_v * vx), (turn_u * uy, turn_v * vy))


@inner_step
def is_small(footprint: PixelFootprint) -> bool:
    """Whether the samples around a pixel's center suffice for its limits."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return bool(max(abs(ux) + abs(uy), abs(vx) + abs(vy)) <= LIMITED)
