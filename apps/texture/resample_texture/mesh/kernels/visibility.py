"""Visibility: the triangle that each sub-pixel shows, and those of its surface."""

import math

from resample.engine.jit import inner_kernel
from resample.engine.vectors import Vector, dot
from resample.types import Doubles
from resample_texture.mesh.kernels.surfaces import (
    Place,
    ProjectedTriangles,
    VisibilityCamera,
    plane_at,
)
from resample_texture.mesh.kernels.tiles import TileBuffer, columns_within, sample, span

WIDE = 8  # sub-pixels; rows of wider triangles are narrowed down first


@inner_kernel
def set_edges(triangles: ProjectedTriangles, n: int, edge: Doubles) -> None:
    """Set up the edges of a polygon, each from its smaller to its greater end.

    So both triangles at an edge compute with the same numbers, and a point on it belongs to exactly
    one of them.
    """
    count = triangles.corners[n]
    for k in range(count):
        m = (k + 1) % count
        ax, ay = triangles.corner[n, k, 0], triangles.corner[n, k, 1]
        bx, by = triangles.corner[n, m, 0], triangles.corner[n, m, 1]
        side = triangles.facing[n]
        # Swap the ends if needed, and the inner side with them.
        if bx < ax or (bx == ax and by < ay):
            ax, ay, bx, by, side = bx, by, ax, ay, -side
        edge[k, 0], edge[k, 1], edge[k, 2], edge[k, 3] = ax, ay, bx - ax, by - ay
        edge[k, 4] = side


@inner_kernel
def _is_inside(edge: Doubles, count: int, place: Place) -> bool:
    """Whether a polygon contains a place, by its edge functions."""
    for k in range(count):
        value = edge[k, 2] * (place[1] - edge[k, 1]) - edge[k, 3] * (place[0] - edge[k, 0])
        # Break ties by the side: a place on an edge belongs to one of its two triangles.
        if value == 0.0:
            if edge[k, 4] < 0.0:
                return False
        elif (value > 0.0) != (edge[k, 4] > 0.0):
            return False
    return True


@inner_kernel
def _between(edge: Doubles, count: int, top: float, bottom: float) -> tuple[float, float]:
    """Least and greatest x of a polygon between two heights, up to rounding."""
    left, right = math.inf, -math.inf
    for k in range(count):
        x, y, across, down = edge[k, 0], edge[k, 1], edge[k, 2], edge[k, 3]
        # Skip edges above or below the band; clip the others to it.
        if min(y, y + down) > bottom or max(y, y + down) < top:
            continue
        first, last = 0.0, 1.0
        if down != 0.0:
            first, last = (
                max(0.0, min(1.0, (top - y) / down)),
                max(0.0, min(1.0, (bottom - y) / down)),
            )
        left = min(left, x + first * across, x + last * across)
        right = max(right, x + first * across, x + last * across)
    return left, right


@inner_kernel
def row_span(edge: Doubles, count: int, block: TileBuffer, row: int) -> tuple[int, int]:
    """First and last column of a row's sub-pixels that a polygon may touch."""
    fine = 1.0 / block.samples
    top = block.top + row * fine
    left, right = _between(edge, count, top, top + fine)
    return columns_within(block, left - fine, right + fine)


@inner_kernel
def nearness_at(plane: Vector, limit: tuple[float, float], place: Place) -> float:
    """Nearness of a triangle at a place, clamped to its own limits."""
    value = dot(plane, (place[0], place[1], 1.0))
    return max(limit[0], min(limit[1], value))


@inner_kernel
def show(triangles: ProjectedTriangles, n: int, block: TileBuffer) -> None:
    """Give a triangle the sub-pixels where it passes the depth test."""
    # Set up the edges and the sub-pixels that the triangle may touch.
    edge, count = block.edge, triangles.corners[n]
    plane, limit = plane_at(triangles, n), (triangles.limit[n, 0], triangles.limit[n, 1])
    set_edges(triangles, n, edge)
    first, last, start, end = span(triangles, n, block)
    is_wide, is_layered = end - start > WIDE, len(block.limit) > 0
    # Narrow each row down where the triangle is wide.
    for row in range(first, last + 1):
        if is_wide:
            start, end = row_span(edge, count, block, row)
        for column in range(start, end + 1):
            # Test the sample against the edges.
            place = sample(block, row, column)
            if not _is_inside(edge, count, place):
                continue
            # Depth test; with layers, only what lies behind those peeled so far.
            nearness = nearness_at(plane, limit, place)
            if nearness > block.nearness[row, column] and (
                not is_layered or nearness < block.limit[row, column]
            ):
                block.nearness[row, column] = nearness
                block.owner[row, column] = n


@inner_kernel
def is_beside(
    triangles: ProjectedTriangles, n: int, other: int, place: Place, lens: VisibilityCamera
) -> bool:
    """Whether two triangles that face the same way form one surface at a place."""
    if triangles.facing[n] != triangles.facing[other]:
        return False
    # Extend both planes to the place, and compare them within the tolerance.
    own = dot(plane_at(triangles, n), (place[0], place[1], 1.0))
    its = dot(plane_at(triangles, other), (place[0], place[1], 1.0))
    return abs(own - its) <= lens.tolerance * (abs(own) if lens.perspective else 1.0)


@inner_kernel
def may_show(
    triangles: ProjectedTriangles, n: int, block: TileBuffer, lens: VisibilityCamera
) -> bool:
    """Whether a triangle may be part of the visible surface, also between samples."""
    plane, limit = plane_at(triangles, n), (triangles.limit[n, 0], triangles.limit[n, 1])
    first, last, start, end = span(triangles, n, block)
    for row in range(first, last + 1):
        for column in range(start, end + 1):
            owner = block.owner[row, column]
            if owner == n:
                return True
            # Thin triangles may own no sample: accept those at the depth of what is visible.
            if owner < 0 or triangles.facing[n] != triangles.facing[owner]:
                continue
            nearness = nearness_at(plane, limit, sample(block, row, column))
            slack = lens.tolerance * (nearness if lens.perspective else 1.0)
            if nearness + slack >= block.nearness[row, column]:
                return True
    return False
