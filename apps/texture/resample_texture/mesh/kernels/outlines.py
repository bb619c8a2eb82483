"""Share of a sub-pixel at an outline that triangles cover together.

Around the sub-pixels that show nothing, each sub-pixel has 64 points. All triangles, hidden ones as
well, mark the points that they cover; the share of marked points is the coverage.
(Carpenter, The A-buffer, an antialiased hidden surface method, 1984.)
"""

import numpy as np

from resample.engine.jit import inner_kernel, making_kernel
from resample.types import Doubles
from resample_texture.mesh.kernels.surfaces import Place, ProjectedTriangles, plane_at
from resample_texture.mesh.kernels.tiles import TileBuffer, sample, span
from resample_texture.mesh.kernels.visibility import WIDE, nearness_at, row_span, set_edges

POINTS = 64
# Of a sub-pixel, from its upper left corner: no two in one row or column, and evenly spread.
POINT_X = (np.arange(POINTS) + 0.5) / POINTS
POINT_Y = (np.arange(POINTS) * 19 % POINTS + 0.5) / POINTS

NOTHING = -1  # owner of a sub-pixel without a triangle
BEHIND = -2  # minus the nearest triangle, where it covers points of a sub-pixel but not its sample

NONE, ALL, ONE = np.uint64(0), np.uint64(0xFFFFFFFFFFFFFFFF), np.uint64(1)


@making_kernel
def open_outline(block: TileBuffer) -> None:
    """Find sub-pixels where outlines may be.

    They are beside those that show nothing, and at the tile's border.
    """
    owner, taken = block.owner, block.taken
    rows, columns = owner.shape
    least = np.empty(columns, np.int32)
    # Mark sub-pixels as open if any of the 3 × 3 around shows nothing; the minimum is separable.
    for row in range(rows):
        above, below = max(0, row - 1), min(rows - 1, row + 1)
        is_rim = not 0 < row < rows - 1
        for column in range(columns):
            least[column] = min(owner[above, column], owner[row, column], owner[below, column])
        for column in range(1, columns - 1):
            is_open = min(least[column - 1], least[column], least[column + 1]) < 0
            taken[row, column] = NONE if is_open or is_rim else ALL
        taken[row, 0] = taken[row, columns - 1] = NONE


@inner_kernel
def _beyond(edge: Doubles, k: int, corner: Place, fine: float) -> np.uint64:
    """Points of a sub-pixel, as bits, on the inner side of edge k."""
    # Evaluate the edge function at the sub-pixel's corner, and its change across it.
    across, down = edge[k, 2] * fine, edge[k, 3] * fine
    start = edge[k, 2] * (corner[1] - edge[k, 1]) - edge[k, 3] * (corner[0] - edge[k, 0])
    # Test the whole square first: most lie on one side.
    middle, reach = start + 0.5 * (across - down), 0.5 * (abs(across) + abs(down))
    if abs(middle) > reach:
        return ALL if (middle > 0.0) == (edge[k, 4] > 0.0) else NONE
    # Test point by point.
    points = NONE
    for point in range(POINTS):
        value = start + across * POINT_Y[point] - down * POINT_X[point]
        points |= np.uint64(value >= 0.0) << np.uint64(point)
    return points if edge[k, 4] > 0.0 else ~points


@inner_kernel
def _points_within(edge: Doubles, count: int, corner: Place, fine: float) -> np.uint64:
    """Points of a sub-pixel that a polygon covers, as bits."""
    points = ALL
    for k in range(count):
        points &= _beyond(edge, k, corner, fine)
        if points == NONE:
            break
    return points


@inner_kernel
def take_points(triangles: ProjectedTriangles, n: int, block: TileBuffer) -> None:
    """Mark the points that a triangle covers where outlines may be."""
    # Set up the edges and the sub-pixels that the triangle may touch.
    edge, count, taken = block.edge, triangles.corners[n], block.taken
    plane, limit = plane_at(triangles, n), (triangles.limit[n, 0], triangles.limit[n, 1])
    set_edges(triangles, n, edge)
    first, last, start, end = span(triangles, n, block)
    is_wide = end - start > WIDE
    fine = 1.0 / block.samples
    # Narrow each row down where the triangle is wide.
    for row in range(first, last + 1):
        if is_wide:
            start, end = row_span(edge, count, block, row)
        for column in range(start, end + 1):
            # Skip sub-pixels that are covered already, or away from outlines.
            if taken[row, column] == ALL:
                continue
            corner = (block.left + column * fine, block.top + row * fine)
            points = _points_within(edge, count, corner, fine)
            if points == NONE:
                continue
            # Mark the points, and note the nearest triangle where no sample was hit.
            taken[row, column] |= points
            if block.owner[row, column] < 0:
                nearness = nearness_at(plane, limit, sample(block, row, column))
                if nearness > block.nearness[row, column]:
                    block.nearness[row, column] = nearness
                    block.owner[row, column] = BEHIND - n


@inner_kernel
def close_outline(block: TileBuffer) -> None:
    """Show the nearest triangle where points, but not the sample, are covered."""
    owner = block.owner
    for row in range(owner.shape[0]):
        for column in range(owner.shape[1]):
            n = owner[row, column]
            owner[row, column] = n if n >= NOTHING else BEHIND - n


@inner_kernel
def covered(block: TileBuffer, row: int, column: int) -> float:
    """Share of a sub-pixel that triangles cover: the count of its marked points."""
    points, count = block.taken[row, column], 0
    if points == ALL:
        return 1.0
    # Count bits, clearing the lowest one each time.
    while points != NONE:
        points &= points - ONE
        count += 1
    return count / POINTS
