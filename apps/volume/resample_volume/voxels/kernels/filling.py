"""Nearest known voxel of each voxel in a plane.

The caller finds the nearest along z; then along y, of the results in each column, and along x, of
the results in each row. Maurer, Qi and Raghavan 2003, "A linear time algorithm for computing exact
Euclidean distance transforms of binary images in arbitrary dimensions".
"""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks

NOTHING = -1  # in place of an index, where nothing is known

Indices = NDArray[np.int64]
Places = NDArray[np.int32]


@kernel
def _envelope(away: Indices, stack: Indices) -> int:
    """Keep the places of a line that are nearest to some part of it; return how many.

    `away` (N,) is the squared distance from the line to the known voxel of each place; below 0
    there is none. `stack` (N,) receives the places, ascending. Section 4 of the paper: of three,
    the middle one is dropped where one of the two others is nearer all along the line.
    """
    count = 0
    for n in range(away.size):
        # Skip places without a known voxel.
        if away[n] < 0:
            continue
        # Pop places whose parabola is hidden by those before and after.
        while count >= 2:
            last, before = stack[count - 1], stack[count - 2]
            a, b = last - before, n - last
            c = a + b
            if c * away[last] - b * away[before] - a * away[n] - a * b * c <= 0:
                break
            count -= 1
        stack[count] = n
        count += 1
    return count


@kernel
def _nearest_on_line(away: Indices, stack: Indices, found: Indices) -> None:
    """Find the place with the nearest known voxel for all places of a line.

    Of equal distances the first counts.
    """
    count, at = _envelope(away, stack), 0
    for n in range(away.size):
        if count == 0:
            found[n] = NOTHING
            continue
        # Advance along the envelope while the next place is nearer.
        own = (stack[at] - n) * (stack[at] - n) + away[stack[at]]
        while at + 1 < count:
            after = stack[at + 1]
            other = (after - n) * (after - n) + away[after]
            if own <= other:
                break
            own = other
            at += 1
        found[n] = stack[at]


@parallel_kernel
def nearest_in_columns(counter: Counter, deep: Places, z: int, down: Places) -> None:
    """Find the row (Y, X) in each column that leads to the nearest known voxel.

    `deep` (Y, X) is the z of the known voxel that is nearest along z, or NOTHING.
    """
    height, width = deep.shape
    away, stack = np.empty(height, np.int64), np.empty(height, np.int64)
    found = np.empty(height, np.int64)
    for x in tasks(counter, width):
        # Measure along z, then search along y.
        for y in range(height):
            far = np.int64(deep[y, x]) - z
            away[y] = NOTHING if deep[y, x] < 0 else far * far
        _nearest_on_line(away, stack, found)
        for y in range(height):
            down[y, x] = found[y]


@parallel_kernel
def nearest_in_rows(
    counter: Counter, deep: Places, down: Places, z: int, known: NDArray[np.bool_], across: Places
) -> None:
    """Find the column (Y, X) in each row that leads to the nearest known voxel.

    `down` (Y, X) is of `nearest_in_columns`; rows in which all are `known` (Y, X) are skipped.
    """
    height, width = deep.shape
    away, stack = np.empty(width, np.int64), np.empty(width, np.int64)
    found = np.empty(width, np.int64)
    for y in tasks(counter, height):
        # Skip rows without gaps.
        if known[y].all():
            continue
        # Measure along y and z, then search along x.
        for x in range(width):
            row = np.int64(down[y, x])
            if row < 0:
                away[x] = NOTHING
                continue
            far = np.int64(deep[row, x]) - z
            away[x] = far * far + (row - y) * (row - y)
        _nearest_on_line(away, stack, found)
        for x in range(width):
            across[y, x] = found[x]
