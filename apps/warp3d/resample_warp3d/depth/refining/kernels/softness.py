"""Softness of a depth map's edges, and restoration of blurred thin objects."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.kernels.ramps import BETWEEN, UP

Marks = NDArray[np.uint8]

WHOLE = 0.98  # own share of a soft map's sample above which nothing is missing
NARROW = 0.05  # of the values: surfaces closer together are one
SAME = 0.25  # of the range around a sample: values closer together are of one surface


class Blur(NamedTuple):
    """Blur of a soft map."""

    sigma: float  # px
    least: float  # own share of a sample that is needed to remove the rest


@kernel
def _run(values: Floats, mark: Marks, row: int, column: int, found: Doubles) -> int:
    """Measure the edge that begins at a sample; return where it ends.

    Fills one row of `measure_edges`.
    """
    # Sum the moments of the steps, and find the two largest.
    kind, total, mean, square, cube = mark[row, column, 0], 0.0, 0.0, 0.0, 0.0
    largest, second, n = 0.0, 0.0, 0
    while column + n + 1 < values.shape[1] and mark[row, column + n, 0] == kind:
        step = abs(np.float64(values[row, column + n + 1]) - values[row, column + n])
        if step > largest:
            largest, second = step, largest
        else:
            second = max(second, step)
        total, mean = total + step, mean + step * n
        square, cube = square + step * n * n, cube + step * n * n * n
        n += 1
    # Normalize to variance, skew toward the far side, and the second step's share.
    if total > 0.0:
        mean, square, cube = mean / total, square / total, cube / total
        skew = cube - 3.0 * mean * square + 2.0 * mean * mean * mean
        found[0], found[1] = square - mean * mean, skew if kind == UP else -skew
        found[2] = second / total
    return column + max(n, 1)


@kernel
def measure_edges(values: Floats, mark: Marks, found: Doubles) -> int:
    """Measure edges along rows; return how many.

    `values`: (H, W) monotonic functions of nearness; 0 where unknown. `mark`: (H, W, 2) of
    `ramps.mark_edges`. `found`: (N, 3) filled from the top: variance of an edge's steps (px²),
    their skew, toward the far side (px³), and the share of the jump that the second largest of them
    has.
    """
    count = 0
    for row in range(values.shape[0]):
        column = 0
        while column < values.shape[1] and count < found.shape[0]:
            # Skip to the next edge.
            if mark[row, column, 0] == 0:
                column += 1
                continue
            # Count only edges that no other edge adjoins.
            is_first = column == 0 or mark[row, column - 1, 0] == 0
            column = _run(values, mark, row, column, found[count])
            if is_first and (column >= values.shape[1] or mark[row, column, 0] == 0):
                count += 1
    return count


@kernel
def _range(values: Floats, row: int, column: int, reach: int) -> tuple[float, float]:
    """Least and largest of the known values around a sample."""
    low, high = np.inf, 0.0
    for r in range(max(0, row - reach), min(values.shape[0], row + reach + 1)):
        for c in range(max(0, column - reach), min(values.shape[1], column + reach + 1)):
            value = np.float64(values[r, c])
            if value > 0.0:
                low, high = min(low, value), max(high, value)
    return low, high


@kernel
def _whole(given: Floats, refined: Floats, row: int, column: int, blur: Blur) -> float:
    """Value of a thin object without its surroundings; 0 if that is impossible.

    A soft map's value is k a + (1 − k) b with the object's own value a and the surroundings' b.
    The own share k of a sample follows from what lies around it: given values beyond half of the
    way to the surroundings, or refined values on the object's surface, whichever are more.
    """
    # Skip samples whose surroundings are one surface.
    reach = math.ceil(3.0 * blur.sigma)
    here = np.float64(given[row, column])
    low, high = _range(refined, row, column, reach)
    if high - low < NARROW * high:
        return 0.0
    # Sum the blur's weights of both estimates, and the value of the surroundings.
    half = 0.5 * (here + (low if here - low > high - here else high))
    total, similar, beyond, others = 0.0, 0.0, 0.0, 0.0
    for r in range(max(0, row - reach), min(given.shape[0], row + reach + 1)):
        for c in range(max(0, column - reach), min(given.shape[1], column + reach + 1)):
            if not refined[r, c] > 0:
                continue
            apart = (r - row) * (r - row) + (c - column) * (c - column)
            weight = math.exp(-0.5 * apart / (blur.sigma * blur.sigma))
            total += weight
            if (given[r, c] - half) * (here - half) > 0.0:
                beyond += weight
            if abs(refined[r, c] - here) <= SAME * (high - low):
                similar += weight
            else:
                others += weight * refined[r, c]

    # Give up if too little is left; solve the mixture for the object's value otherwise.
    own = max(similar, beyond) / total
    if own < blur.least:
        return 0.0
    if own > WHOLE or total - similar <= 0.0:
        return here
    return max((here - (1.0 - own) * others / (total - similar)) / own, 0.3 * here)


@kernel
def _restore_row(
    given: Floats, refined: Floats, kind: Marks, blur: Blur, row: int, whole: Floats
) -> None:
    """Restore a row; see `restore`."""
    for column in range(given.shape[1]):
        whole[row, column] = np.float32(0)
        # Only samples beside an edge that the refinement left alone can be thin objects.
        is_kept = refined[row, column] == given[row, column] and given[row, column] > 0
        if kind[row, column] and kind[row, column] != BETWEEN and is_kept:
            whole[row, column] = np.float32(_whole(given, refined, row, column, blur))


@parallel_kernel
def restore(
    counter: Counter, given: Floats, refined: Floats, kind: Marks, blur: Blur, whole: Floats
) -> None:
    """Write the values of thin objects before a map became soft.

    `given`, `refined`: (H, W) values in which the map was blurred, before and after its edges were
    made hard. `kind`: (H, W) of samples in a band around edges: not 0, and `BETWEEN` where between
    surfaces. `blur`: blur of the map. `whole`: (H, W) filled: 0 where nothing can be restored.
    """
    for row in tasks(counter, given.shape[0]):
        _restore_row(given, refined, kind, blur, row, whole)
