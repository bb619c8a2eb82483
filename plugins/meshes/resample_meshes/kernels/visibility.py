"""Visibility: sub-pixels of a tile, and the triangles that each may show and shows."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, kernel
from resample.engine.surfaces import whole_within
from resample.engine.vectors import Vector, dot
from resample.types import Doubles, Floats, Tiles
from resample_meshes.kernels.surfaces import (
    Ints,
    Place,
    ProjectedTriangles,
    VisibilityCamera,
    plane_at,
)

WIDE = 8  # sub-pixels; rows of wider triangles are narrowed down first


class SubpixelGrid(NamedTuple):
    """Sampling of a frame."""

    samples: int  # sub-pixels per side of a pixel
    margin: int  # px around a tile that its pixels' filter reads
    quality: float  # cells per sub-pixel and axis, at least


class TileBuffer(NamedTuple):
    """Sub-pixels of one tile with its margin, and scratch to fill them."""

    left: float  # px
    top: float
    samples: int  # sub-pixels per side of a pixel
    margin: int  # px on all sides
    owner: NDArray[np.int32]  # (R, C) the visible triangle; -1: none
    nearness: Doubles  # (R, C) in the end depths, infinite where nothing is
    sums: Floats  # (R, C, 4) weighted red, green, blue and weight; in the end means and coverage
    taken: NDArray[np.uint64]  # (R, C) which of its points are covered, a bit for each
    # (R, C) nearness beyond which the next layer is peeled, infinite at first; empty, like the
    # next two, where there is only one layer.
    limit: Doubles
    visible: Floats  # (R, C, 4) red, green, blue and alpha of the layers in front
    front: Doubles  # (R, C) nearness of the first of them
    tally: Ints  # (4,) see `MeshScene`
    edge: Doubles  # (4, 5) of the current triangle: a point, a direction, the side that is inside
    polygon: Doubles  # (8, 2) px, the clipped part of the current triangle
    spare: Doubles  # (8, 2)
    rim: Doubles  # (8, 2) texture coordinates of the polygon
    corner: Doubles  # (3, 2) of the triangle


@kernel
def new_block(
    tile: int,
    tiles: Tiles,
    size: tuple[int, int],
    grid: SubpixelGrid,
    tally: Ints,
    is_layered: bool,
) -> TileBuffer:
    """Allocate an empty tile, clipped to the frame (height, width) and its margin."""
    # Clip the tile to the frame, and add the margin.
    row, column = divmod(int(np.int64(tile)), tiles.columns)
    left, top = column * tiles.size, row * tiles.size
    rows = (min(tiles.size, size[0] - top) + 2 * grid.margin) * grid.samples
    columns = (min(tiles.size, size[1] - left) + 2 * grid.margin) * grid.samples

    # Allocate buffers for layers only if something is translucent.
    layered = (rows, columns) if is_layered else (0, 0)
    return TileBuffer(
        # Origin and sampling.
        float(left - grid.margin),
        float(top - grid.margin),
        grid.samples,
        grid.margin,
        # Owner, nearness (none yet), sums, and points at outlines.
        np.full((rows, columns), -1, np.int32),
        np.full((rows, columns), -np.inf),
        np.zeros((rows, columns, 4), np.float32),
        np.empty((rows, columns), np.uint64),
        # Depth peeling: limit, composite, and nearness of the first layer.
        np.full(layered, np.inf),
        np.zeros((layered[0], layered[1], 4), np.float32),
        np.full(layered, -np.inf),
        tally,
        # Scratch for the current triangle.
        np.empty((4, 5)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((8, 2)),
        np.empty((3, 2)),
    )


@inner_kernel
def columns_within(block: TileBuffer, left: float, right: float) -> tuple[int, int]:
    """First and last column of the sub-pixels between two places, px."""
    last = block.owner.shape[1] - 1
    return (
        whole_within((left - block.left) * block.samples, 0, last + 1),
        whole_within((right - block.left) * block.samples, -1, last),
    )


@inner_kernel
def span(triangles: ProjectedTriangles, n: int, block: TileBuffer) -> tuple[int, int, int, int]:
    """First and last row, first and last column that a triangle may touch."""
    bounds = triangles.bounds[n]
    top, bottom = bounds["top"], bounds["bottom"]
    first, last = columns_within(block, bounds["left"], bounds["right"])
    rows = block.owner.shape[0]
    return (
        whole_within((top - block.top) * block.samples, 0, rows),
        whole_within((bottom - block.top) * block.samples, -1, rows - 1),
        first,
        last,
    )


@inner_kernel
def sample(block: TileBuffer, row: int, column: int) -> Place:
    """Place on screen at which a sub-pixel is tested for visibility.

    The grid of samples is rotated a little, so that vertical edges pass a pixel's samples one by
    one and not a column at a time.
    """
    # Rotated grid: each row of sub-pixels shifts along x, each column along y.
    fine = 1.0 / block.samples
    return (
        block.left + (column + 0.25 + 0.5 * fine * (row % block.samples + 0.5)) * fine,
        block.top + (row + 0.75 - 0.5 * fine * (column % block.samples + 0.5)) * fine,
    )


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
            # Thin triangles may own no sample: accept those at the visible depth.
            if owner < 0 or triangles.facing[n] != triangles.facing[owner]:
                continue
            nearness = nearness_at(plane, limit, sample(block, row, column))
            slack = lens.tolerance * (nearness if lens.perspective else 1.0)
            if nearness + slack >= block.nearness[row, column]:
                return True
    return False
