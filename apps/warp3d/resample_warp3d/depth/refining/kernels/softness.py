"""Softness of a depth map's edges, and restoration of blurred thin objects."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.kernels.ramps import BETWEEN

Marks = NDArray[np.uint8]

MISSED = -9.0  # steps: a level is not crossed
WHOLE = 0.98  # own share of a soft map's sample above which nothing is missing
NARROW = 0.05  # of the values: surfaces closer together are one
SAME = 0.25  # of the range around a sample: values closer together are of one surface


class Blur(NamedTuple):
    """Blur of a soft map."""

    sigma: float  # px
    least: float  # own share of a sample that is needed to remove the rest


@kernel
def _crossing(values: Floats, row: int, column: int, level: float, step: int, most: int) -> float:
    """Steps from a sample to where a row crosses a level, interpolated, or `MISSED`."""
    here = np.float64(values[row, column])
    rises = level > here
    for n in range(1, most + 1):
        there = np.float64(values[row, column + n * step])
        if (there >= level) == rises or there == level:
            return float(n - 1 + (level - here) / (there - here))
        here = there
    return MISSED


@kernel
def _excess(values: Floats, row: int, column: int, width: float, up: bool) -> float:
    """Lesser excess of an edge's sides over the surfaces beyond them, of its jump; 0 if unknown."""
    away, far = math.ceil(1.25 * width + 2.0), math.ceil(width) + 2
    if column - away - far < 0 or column + away + far >= values.shape[1]:
        return 0.0
    left, right = 0.0, 0.0
    for n in range(far):
        left += values[row, column - away - n] / far
        right += values[row, column + away + n] / far
    sign = 1.0 if up else -1.0
    below, above = -np.inf, -np.inf
    for n in range(away):
        below = max(below, sign * (left - values[row, column - n]))
        above = max(above, sign * (values[row, column + 1 + n] - right))
    return min(below, above) / max(abs(right - left), 1e-30)


@kernel
def _edge(values: Floats, row: int, column: int, reach: int, found: Doubles) -> bool:
    """Measure the edge with its middle after a sample, if any; see `measure_widths`."""
    first = np.float64(values[row, column])
    second = np.float64(values[row, column + 1])
    low, high = np.inf, -np.inf
    for n in range(column - reach + 1, column + reach + 1):
        value = np.float64(values[row, n])
        low, high = min(low, value), max(high, value)
    jump, middle, up = high - low, 0.5 * (low + high), bool(second > first)
    if low <= 0.0 or jump < found[3] * high or (first < middle) == (second < middle):
        return False
    # Find where it crosses 10 and 90 %, from its middle step to both sides.
    before, after = (0.1, 0.9) if up else (0.9, 0.1)
    left = float((low + before * jump - first) / (first - second))
    if left >= 0.0:
        left = _crossing(values, row, column, low + before * jump, -1, reach - 1)
    right = float((low + after * jump - second) / (second - first))
    if right >= 0.0:
        right = _crossing(values, row, column + 1, low + after * jump, 1, reach - 1)
    if min(left, right) == MISSED:
        return False
    width = left + right + 1.0
    found[0], found[1] = width, jump / high
    found[2] = _excess(values, row, column, width, up)
    return bool(width <= 0.5 * reach)


@kernel
def measure_widths(values: Floats, reach: int, least: float, found: Doubles) -> int:
    """Measure edges along rows within a distance; return how many.

    An edge is where a row crosses the middle of the range of all values within `reach` samples. Its
    width is the distance from 10 to 90 % of the range; it counts if it is at most half of
    `reach`, which slopes never are, however near one looks.

    `values`: (H, W); 0 where unknown. `least`: jump of an edge, of its largest value. `found`: (N,
    5) filled from the top: width (px), jump (of the largest value), overshoot (of the jump), row,
    and column.
    """
    count = 0
    edge = np.zeros(4)
    edge[3] = least
    for row in range(values.shape[0]):
        for column in range(reach, values.shape[1] - reach - 1):
            first, second = np.float64(values[row, column]), np.float64(values[row, column + 1])
            # An edge's middle is steeper than a slope of its width.
            steep = 1.2 * least * max(first, second) / reach
            if not (first > 0.0 and second > 0.0 and abs(second - first) > steep):
                continue
            if count < found.shape[0] and _edge(values, row, column, reach, edge):
                found[count, 0], found[count, 1], found[count, 2] = edge[0], edge[1], edge[2]
                found[count, 3], found[count, 4] = row, column
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
    The own share k of a sample follows from its surroundings: given values beyond half of the
    way to the surroundings, or refined values on the object's surface, whichever are more.
    """
    # Skip samples surrounded by one surface.
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
        for column in range(given.shape[1]):
            whole[row, column] = np.float32(0)
            # Only samples beside an edge that the refinement left alone can be thin objects.
            is_kept = refined[row, column] == given[row, column] and given[row, column] > 0
            if kind[row, column] and kind[row, column] != BETWEEN and is_kept:
                whole[row, column] = np.float32(_whole(given, refined, row, column, blur))
