"""Convex polygons as arrays of corners (N, 2): clipped to rectangles, crossed, measured."""

import numpy as np

from resample.engine.jit import inner_kernel, kernel
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
