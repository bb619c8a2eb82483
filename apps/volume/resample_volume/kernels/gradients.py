"""Positions of voxels, and gradients of their values."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, kernel
from resample.engine.vectors import Matrix, Vector, matrix_of, multiply
from resample.types import Doubles, Floats

BRICK = 8  # voxels

Indices = NDArray[np.int64]
Step = tuple[int, int, int]  # z, y, x


@kernel
def _place_of(index: int, size: Step) -> Step:
    """Voxel of a flat index into an array of `size`."""
    row, x = divmod(index, size[2])
    z, y = divmod(row, size[1])
    return z, y, x


@kernel
def _next_place(index: int, before: int, at: Step, size: Step) -> Step:
    """Voxel of a flat index, given that of the previous index: mostly in the same row."""
    x = at[2] + index - before
    if 0 <= x < size[2]:
        return at[0], at[1], x
    return _place_of(index, size)


@kernel
def brick_order(index: Indices, size: Step, order: Indices) -> None:
    """Find the order (N,) that sorts voxels by flat index into bricks; stable."""
    rows, columns = (size[1] + BRICK - 1) // BRICK, (size[2] + BRICK - 1) // BRICK
    layers = (size[0] + BRICK - 1) // BRICK
    start = np.zeros(layers * rows * columns + 1, np.int64)
    brick = np.empty(index.size, np.int32)
    # Count the voxels of each brick.
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, size)
        before = index[n]
        z, y, x = at
        brick[n] = (z // BRICK * rows + y // BRICK) * columns + x // BRICK
        start[brick[n] + 1] += 1
    # Turn counts into start positions.
    for b in range(start.size - 1):
        start[b + 1] += start[b]
    # Place each voxel (counting sort).
    for n in range(index.size):
        order[start[brick[n]]] = n
        start[brick[n]] += 1


@kernel
def place(index: Indices, size: Step, lattice: Doubles, origin: Doubles, position: Floats) -> None:
    """Scene positions (N, 3) of voxels, given by their flat index into (Z, Y, X)."""
    steps = matrix_of(lattice)
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, size)
        before = index[n]
        z, y, x = at
        moved = multiply(steps, (float(x), float(y), float(z)))
        for c in range(3):
            position[n, c] = origin[c] + moved[c]


@kernel
def _mean(behind: float, ahead: float) -> float:
    """Mean of two differences, of which those that are not finite are left out; NaN if both are."""
    if not math.isfinite(ahead):
        return behind if math.isfinite(behind) else math.nan
    return 0.5 * (ahead + behind) if math.isfinite(behind) else ahead


@kernel
def _value(values: NDArray[Any], place: Step) -> float:
    """Value of a voxel; NaN outside the volume."""
    z, y, x = place
    depth, height, width = values.shape
    if 0 <= z < depth and 0 <= y < height and 0 <= x < width:
        return float(values[z, y, x])
    return math.nan


@kernel
def _slopes_at_border(values: NDArray[Any], place: Step) -> Vector:
    """Slopes along x, y and z from known neighbours; 0 where there is none."""
    z, y, x = place
    here = _value(values, place)
    # Difference to both sides along each axis; outside the volume these are NaN.
    left, right = here - _value(values, (z, y, x - 1)), _value(values, (z, y, x + 1)) - here
    above, below = here - _value(values, (z, y - 1, x)), _value(values, (z, y + 1, x)) - here
    before, after = here - _value(values, (z - 1, y, x)), _value(values, (z + 1, y, x)) - here
    x_slope, y_slope, z_slope = _mean(left, right), _mean(above, below), _mean(before, after)
    # Replace slopes without any neighbour.
    return (
        x_slope if math.isfinite(x_slope) else 0.0,
        y_slope if math.isfinite(y_slope) else 0.0,
        z_slope if math.isfinite(z_slope) else 0.0,
    )


@inner_step
def _central_slopes(values: NDArray[Any], place: Step) -> Vector:
    """Slopes along x, y and z from a voxel's neighbours; 0 where there is none."""
    z, y, x = place
    depth, height, width = values.shape
    # Inside the volume, and if all neighbours are finite, take central differences at once.
    if 0 < z < depth - 1 and 0 < y < height - 1 and 0 < x < width - 1:
        # Unsigned indices spare a test for negative ones.
        k, j, i, one = np.uint64(z), np.uint64(y), np.uint64(x), np.uint64(1)
        # Numba's float() of a float32 stays one: convert explicitly.
        here = np.float64(values[k, j, i])
        left, right = here - values[k, j, i - one], values[k, j, i + one] - here
        above, below = here - values[k, j - one, i], values[k, j + one, i] - here
        before, after = here - values[k - one, j, i], values[k + one, j, i] - here
        slope = (0.5 * (right + left), 0.5 * (below + above), 0.5 * (after + before))
        if math.isfinite(slope[0] + slope[1] + slope[2]):
            return slope
    return _slopes_at_border(values, place)


@kernel
def _store(turn: Matrix, slope: Vector, gradient: Floats, n: int) -> None:
    """Write a gradient, turned to the scene's axes."""
    # Unsigned indices spare a test for negative ones.
    k, one = np.uint64(n), np.uint64(1)
    gradient[k, one - one], gradient[k, one], gradient[k, one + one] = multiply(turn, slope)


@kernel
def _moved(place: Step, count: int, step: Step) -> Step:
    """Move a voxel's place by so many steps."""
    return (place[0] + count * step[0], place[1] + count * step[1], place[2] + count * step[2])


@kernel
def _smooth_slope(values: NDArray[Any], place: Step, step: Step) -> float:
    """Mean slope of nine parallel lines, weighted 1-2-1 × 1-2-1; 0 if none is known."""
    # Find the two axes across the step's.
    across = (step[1], step[2], step[0])
    along = (step[2], step[0], step[1])
    total = weight = 0.0
    for a in range(-1, 2):
        line = _moved(place, a, across)
        for b in range(-1, 2):
            middle = _moved(line, b, along)
            # Difference along the line, and weigh it unless nothing is known.
            here = _value(values, middle)
            behind = here - _value(values, _moved(middle, -1, step))
            slope = _mean(behind, _value(values, _moved(middle, 1, step)) - here)
            if math.isfinite(slope):
                share = (2 - abs(a)) * (2 - abs(b))
                total += share * slope
                weight += share
    return total / weight if weight > 0.0 else 0.0


@kernel
def _smooth_slopes(values: NDArray[Any], place: Step) -> Vector:
    """Slopes along x, y and z, smoothed across like Sobel's."""
    return (
        _smooth_slope(values, place, (0, 0, 1)),
        _smooth_slope(values, place, (0, 1, 0)),
        _smooth_slope(values, place, (1, 0, 0)),
    )


@kernel
def find_gradients(
    values: NDArray[Any], index: Indices, to_scene: Doubles, is_smooth: bool, gradient: Floats
) -> None:
    """Gradients (N, 3) of `values` (Z, Y, X) at flat indices; 0 if unknown.

    `to_scene` (3, 3), the inverse transpose of the lattice, takes slopes to scene units.
    """
    turn = matrix_of(to_scene)
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, values.shape)
        before = index[n]
        slopes = _smooth_slopes(values, at) if is_smooth else _central_slopes(values, at)
        _store(turn, slopes, gradient, n)
