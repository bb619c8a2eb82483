"""Color sub-pixels by cells or look-ups, and the share that triangles cover at outlines.

Translucent triangles are composited layer by layer, front to back, in any order: depth peeling.
(Everitt, Interactive order-independent transparency, 2001.)

Around the sub-pixels that show nothing, each sub-pixel has 64 points. All triangles, hidden ones as
well, mark the points that they cover; the share of marked points is the coverage.
(Carpenter, The A-buffer, an antialiased hidden surface method, 1984.)
"""

import numpy as np

from resample.engine.jit import inner_kernel, making_kernel
from resample.types import Doubles
from resample_meshes.kernels.sampling import OPAQUE, Layer, Skin, evaluate, lit
from resample_meshes.kernels.surfaces import (
    Place,
    ProjectedTriangles,
    VisibilityCamera,
    plane_at,
)
from resample_meshes.kernels.visibility import (
    WIDE,
    TileBuffer,
    nearness_at,
    row_span,
    sample,
    set_edges,
    span,
)

POINTS = 64
# Of a sub-pixel, from its upper left corner: no two in one row or column, and evenly spread.
POINT_X = (np.arange(POINTS) + 0.5) / POINTS
POINT_Y = (np.arange(POINTS) * 19 % POINTS + 0.5) / POINTS

NOTHING = -1  # owner of a sub-pixel without a triangle
BEHIND = -2  # minus the nearest triangle, where it covers points of a sub-pixel but not its sample

NONE, ALL, ONE = np.uint64(0), np.uint64(0xFFFFFFFFFFFFFFFF), np.uint64(1)
LEAST_WEIGHT = 1e-2  # sub-pixels²; a sub-pixel that got less is looked up
FULL = 1.0 - 1e-3  # alpha beyond which nothing shows through


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


@inner_kernel
def is_sampled(triangles: ProjectedTriangles, skin: Skin, n: int) -> bool:
    """Whether a triangle has no cells: its texture has no area, or it is not opaque."""
    texture = skin.texture[n]
    return bool(texture < 0 or triangles.determinant[n] == 0.0 or skin.mode[texture] != OPAQUE)


@inner_kernel
def _is_reached(skin: Skin, block: TileBuffer, row: int, column: int) -> bool:
    """Whether cells gave a sub-pixel its color."""
    texture = skin.texture[block.owner[row, column]]
    is_opaque = texture < 0 or skin.mode[texture] == OPAQUE
    return bool(is_opaque and block.sums[row, column, 3] > LEAST_WEIGHT)


@inner_kernel
def _sampled(
    triangles: ProjectedTriangles, skin: Skin, block: TileBuffer, row: int, column: int
) -> Layer:
    """Color and alpha of the triangle that a sub-pixel shows, from its texture."""
    n, fine = block.owner[row, column], 1.0 / block.samples
    corner = (block.left + column * fine, block.top + row * fine)
    return evaluate(triangles, skin, n, sample(block, row, column), corner, fine)


@inner_kernel
def _mean(block: TileBuffer, row: int, column: int) -> Layer:
    """Weighted mean of the cells that landed in a sub-pixel, opaque."""
    sums, weight = block.sums, block.sums[row, column, 3]
    return (
        sums[row, column, 0] / weight,
        sums[row, column, 1] / weight,
        sums[row, column, 2] / weight,
        1.0,
    )


@inner_kernel
def count(skin: Skin, block: TileBuffer) -> None:
    """Count the tile's own sub-pixels that show a triangle, and those without cells."""
    margin, shown, missed = block.margin * block.samples, 0, 0
    for row in range(margin, block.owner.shape[0] - margin):
        for column in range(margin, block.owner.shape[1] - margin):
            n = block.owner[row, column]
            if n >= 0:
                shown += 1
                missed += skin.texture[n] >= 0 and not _is_reached(skin, block, row, column)
    block.tally[2] += shown
    block.tally[3] += missed


@inner_kernel
def shade(
    triangles: ProjectedTriangles, skin: Skin, lens: VisibilityCamera, block: TileBuffer
) -> None:
    """Turn an opaque layer's sums into color and coverage, its nearness into depth."""
    sums = block.sums
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            n = block.owner[row, column]
            # Nothing is infinitely far away.
            if n < 0:
                block.nearness[row, column] = np.inf
                continue
            # Take the mean of the cells, or look the texture up where too few landed.
            if sums[row, column, 3] > LEAST_WEIGHT:
                color = _mean(block, row, column)
            else:
                color = _sampled(triangles, skin, block, row, column)
            # Weigh by coverage and light.
            cover = covered(block, row, column)
            light = cover * lit(triangles, skin, n, sample(block, row, column))
            sums[row, column, 0] = light * color[0]
            sums[row, column, 1] = light * color[1]
            sums[row, column, 2] = light * color[2]
            sums[row, column, 3] = cover
            # Turn nearness into depth.
            nearness = block.nearness[row, column]
            block.nearness[row, column] = 1.0 / nearness if lens.perspective else -nearness


@inner_kernel
def put_behind(triangles: ProjectedTriangles, skin: Skin, block: TileBuffer) -> bool:
    """Composite the current layer under those in front; tell whether to go on."""
    seen, again = block.visible, False
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            n = block.owner[row, column]
            # Stop peeling after the last triangle.
            if n < 0:
                block.limit[row, column] = -np.inf
                continue
            # Take the mean of the cells, or look the texture up.
            if _is_reached(skin, block, row, column):
                color = _mean(block, row, column)
            else:
                color = _sampled(triangles, skin, block, row, column)
            # Note the depth of the first layer that is not fully transparent.
            rest, nearness = 1.0 - seen[row, column, 3], block.nearness[row, column]
            if color[3] > 0.0 and seen[row, column, 3] == np.float32(0):
                block.front[row, column] = nearness
            # Composite under: what the layers in front let through, times light and color.
            light = rest * lit(triangles, skin, n, sample(block, row, column))
            seen[row, column, 0] += light * color[0]
            seen[row, column, 1] += light * color[1]
            seen[row, column, 2] += light * color[2]
            seen[row, column, 3] += rest * color[3]
            # Peel on behind this layer unless the sub-pixel is opaque by now.
            is_through = seen[row, column, 3] < FULL
            again = again or is_through
            block.limit[row, column] = nearness if is_through else -np.inf
            # Clear the sub-pixel for the next layer.
            block.owner[row, column] = NOTHING
            block.nearness[row, column] = -np.inf
            for c in range(4):
                block.sums[row, column, c] = np.float32(0)
    return again


@inner_kernel
def finish(lens: VisibilityCamera, block: TileBuffer) -> None:
    """Write the composite of all layers in place of a single layer's sums."""
    sums, seen = block.sums, block.visible
    for row in range(block.owner.shape[0]):
        for column in range(block.owner.shape[1]):
            cover, front = covered(block, row, column), block.front[row, column]
            for c in range(4):
                sums[row, column, c] = cover * seen[row, column, c]
            depth = 1.0 / front if lens.perspective else -front
            block.nearness[row, column] = depth if front > -np.inf else np.inf
