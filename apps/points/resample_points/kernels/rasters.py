"""Values of a cloud at the centers of cells seen from above; one thread owns a row of cells.

Points lie in square bins, in the order of the bins' rows, so that the points around a cell are runs
of their arrays.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, inner_step, parallel_kernel, tasks
from resample.types import Doubles

DOUBLINGS = 3  # of the radius around a cell that is searched
ENOUGH = 4  # points for a plane
STEEP = 2.0  # height of a surface over distance, from which it is a wall
ONE_SIDED = 0.5  # of the radius, distance to the mean place of points that lie on one side
RIDGE = 1e-3  # of the radius squared, added to the points' covariance
X, Y, W, XX, XY, YY, COUNT = 0, 1, 2, 3, 4, 5, 6  # of sums
SUMS = 7


@inner_step
def _run(start: NDArray[np.int64], across: int, row: int, left: int, right: int) -> tuple[int, int]:
    """First and one past the last point of the bins `left` to `right` of a row of bins."""
    down = (start.shape[0] - 1) // across
    if row < 0 or row >= down or right < 0 or left >= across:
        return 0, 0
    first = start[row * across + max(left, 0)]
    return int(first), int(start[row * across + min(right, across - 1) + 1])


@inner_kernel
def _topmost(
    x: float, y: float, place: Doubles, start: NDArray[np.int64], across: int, side: float, k: int
) -> int:
    """Return the highest point of the cell around x, y, else the nearest within k bins, else -1."""
    row, column = int(y / side), int(x / side)
    best, least = -1, math.inf
    is_inside = False
    for r in range(row - k, row + k + 1):
        first, last = _run(start, across, r, column - k, column + k)
        for n in range(first, last):
            dx, dy = place[n, 0] - x, place[n, 1] - y
            distance = dx * dx + dy * dy
            is_here = -0.5 <= dx < 0.5 and -0.5 <= dy < 0.5
            if is_here and not is_inside:
                is_inside, least = True, math.inf
            elif is_here < is_inside:
                continue
            order = -place[n, 2] if is_here else distance
            if order < least:
                best, least = n, order
    return best


@inner_step
def _weight(
    x: float, y: float, place: Doubles, n: int, top: int, reach: float
) -> tuple[float, float, float]:
    """Return a point's place relative to x, y, and its weight; 0 on another surface than `top`."""
    dx, dy = place[n, 0] - x, place[n, 1] - y
    share = (dx * dx + dy * dy) / (reach * reach)
    rise = place[n, 2] - place[top, 2]
    across, down = place[n, 0] - place[top, 0], place[n, 1] - place[top, 1]
    is_wall = rise * rise > STEEP * STEEP * (across * across + down * down)
    return dx, dy, 0.0 if is_wall or share >= 1.0 else (1.0 - share) * (1.0 - share)


@inner_kernel
def _sum_surface(
    x: float, y: float, place: Doubles, start: NDArray[np.int64], across: int, side: float,
    k: int, top: int, sums: Doubles,
) -> None:  # fmt: skip
    """Sum the weights and places of the points within k bins on the surface of `top`."""
    row, column = int(y / side), int(x / side)
    sums[:] = 0.0
    for r in range(row - k, row + k + 1):
        first, last = _run(start, across, r, column - k, column + k)
        for n in range(first, last):
            dx, dy, weight = _weight(x, y, place, n, top, side * k)
            sums[W] += weight
            sums[X] += weight * dx
            sums[Y] += weight * dy
            sums[XX] += weight * dx * dx
            sums[XY] += weight * dx * dy
            sums[YY] += weight * dy * dy
            sums[COUNT] += weight > 0.0


@inner_kernel
def _blend_surface(
    x: float, y: float, place: Doubles, values: Doubles, start: NDArray[np.int64], across: int,
    side: float, k: int, top: int, sums: Doubles, cell: Doubles, ends: Doubles,
) -> None:  # fmt: skip
    """Evaluate at x, y the plane through the values of a surface, within their range."""
    row, column = int(y / side), int(x / side)
    mean_x, mean_y, by_x, by_y = sums[X] / sums[W], sums[Y] / sums[W], 0.0, 0.0
    if sums[COUNT] >= ENOUGH and math.hypot(mean_x, mean_y) <= ONE_SIDED * side * k:
        ridge = RIDGE * (side * k) ** 2
        xx, yy = sums[XX] / sums[W] - mean_x**2 + ridge, sums[YY] / sums[W] - mean_y**2 + ridge
        xy = sums[XY] / sums[W] - mean_x * mean_y
        whole = xx * yy - xy * xy
        by_x, by_y = (xy * mean_y - yy * mean_x) / whole, (xy * mean_x - xx * mean_y) / whole
    cell[:] = 0.0
    ends[0], ends[1] = math.inf, -math.inf
    for r in range(row - k, row + k + 1):
        first, last = _run(start, across, r, column - k, column + k)
        for n in range(first, last):
            dx, dy, weight = _weight(x, y, place, n, top, side * k)
            if weight > 0.0:
                share = weight / sums[W] * (1.0 + by_x * (dx - mean_x) + by_y * (dy - mean_y))
                for c in range(cell.shape[0]):
                    cell[c] += share * values[n, c]
                    ends[0, c] = min(ends[0, c], values[n, c])
                    ends[1, c] = max(ends[1, c], values[n, c])
    for c in range(cell.shape[0]):
        cell[c] = min(max(cell[c], ends[0, c]), ends[1, c])


@parallel_kernel
def fill_cells(
    counter: Counter,
    place: Doubles,
    values: Doubles,
    start: NDArray[np.int64],
    across: int,
    side: float,
    nearest: float,
    raster: Doubles,
    top: NDArray[np.int64],
) -> None:
    """Give cells the values of the surface that is seen from above.

    `place`: (N, 3) of points: right and down in cells from the first bin's corner, and height in
    sides of a cell. `values`: (N, C) at points. `start`, `across`, `side`: first point of each bin;
    number of bins in a row, and their side in cells. `nearest`: distance in cells within which a
    point suffices; farther ones must lie all around. `raster`: (H, W, C), filled where there is a
    surface; its corner is `2**DOUBLINGS` bins right of and below the bins'. `top`: (H, W)
    point with the surface that a cell shows, or -1.
    """
    height, width, count = raster.shape
    border = side * (1 << DOUBLINGS)
    for row in tasks(counter, height):
        sums, ends = np.zeros(SUMS), np.zeros((2, count))
        for column in range(width):
            x, y = border + column + 0.5, border + row + 0.5
            for doubling in range(DOUBLINGS + 1):
                k = 1 << doubling
                first = _topmost(x, y, place, start, across, side, k)
                if first < 0:
                    continue
                _sum_surface(x, y, place, start, across, side, k, first, sums)
                away = math.hypot(place[first, 0] - x, place[first, 1] - y)
                aside = math.hypot(sums[X], sums[Y])
                is_around = sums[COUNT] >= ENOUGH and aside <= ONE_SIDED * side * k * sums[W]
                if not is_around and away > nearest:
                    continue
                top[row, column], raster[row, column] = first, values[first]
                if sums[W] > 0.0:
                    cell = raster[row, column]
                    _blend_surface(
                        x, y, place, values, start, across, side, k, first, sums, cell, ends
                    )
                break
