"""Triangles clipped to a rectangle; crossings and bounds of convex polygons."""

import numpy as np

from resample.engine.jit import kernel
from resample.engine.windows.polygons import cut_to
from resample.types import Doubles
from resample_texture.mesh.kernels.surfaces import ProjectedTriangles


@kernel
def cut_out(
    triangles: ProjectedTriangles,
    n: int,
    rectangle: tuple[float, float, float, float],
    polygon: Doubles,
    spare: Doubles,
) -> int:
    """Clip a triangle to left, top, right, bottom, px; count its corners.

    `polygon` (8, 2) receives them; `spare` is scratch of its shape.
    """
    count = triangles.corners[n]
    # Copy the corners: clipping overwrites them.
    for k in range(count):
        polygon[k, 0], polygon[k, 1] = triangles.corner[n, k, 0], triangles.corner[n, k, 1]
    return cut_to(polygon, spare, count, rectangle)


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
