"""Slopes and bends of surfaces, measured only away from edges."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats

Marks = NDArray[np.uint8]

FEWEST = 4  # samples that a slope needs
BENT = 5  # samples that a bend needs


class Bends(NamedTuple):
    """Options of the measurement."""

    length: int  # samples on each side, at most
    steepest: float  # of the nearness, change per sample
    bent: float  # of the nearness, change of that per sample; 0: planes


@kernel
def _reach(
    nearness: Floats, band: Marks, row: int, column: int, step: tuple[int, int], most: int
) -> int:
    """Count the samples in a direction up to the band, the border or unknown ones."""
    height, width = nearness.shape
    for n in range(1, most + 1):
        r, c = row + n * step[0], column + n * step[1]
        if not (0 <= r < height and 0 <= c < width) or band[r, c] or not nearness[r, c] > 0:
            return n - 1
    return most


@kernel
def _parabola(
    nearness: Floats, row: int, column: int, step: tuple[int, int], reach: tuple[int, int],
    bends: Bends,
) -> tuple[float, float]:  # fmt: skip
    """Fit a parabola through a sample along an axis; return its slope and bend."""
    back, ahead = reach
    here = np.float64(nearness[row, column])
    # Sum up the normal equations of slope and bend.
    squares, cubes, fourths, first, second = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(-back, ahead + 1):
        value = nearness[row + n * step[0], column + n * step[1]] - here
        half = 0.5 * n * n
        squares, cubes, fourths = squares + n * n, cubes + n * half, fourths + half * half
        first, second = first + n * value, second + half * value
    # Fit a line, or a parabola if there are enough samples.
    slope, bend = first / squares, 0.0
    determinant = squares * fourths - cubes * cubes
    if bends.bent > 0.0 and back + ahead + 1 >= BENT and determinant > 1e-9:
        slope = (first * fourths - second * cubes) / determinant
        bend = (second * squares - first * cubes) / determinant
    # Limit both.
    steep, bent = bends.steepest * here, bends.bent * here
    return min(max(slope, -steep), steep), min(max(bend, -bent), bent)


@kernel
def _measure_row(nearness: Floats, band: Marks, bends: Bends, row: int, slope: Floats) -> None:
    """Measure the slopes of a row; see `measure_slopes`."""
    for column in range(nearness.shape[1]):
        for n in range(4):
            slope[row, column, n] = np.float32(0)
        # Skip samples near edges and unknown ones.
        if band[row, column] or not nearness[row, column] > 0:
            continue
        # Fit along both axes, within the surface.
        for axis in range(2):
            step, back = ((0, 1), (0, -1)) if axis == 0 else ((1, 0), (-1, 0))
            reach = (
                _reach(nearness, band, row, column, back, bends.length),
                _reach(nearness, band, row, column, step, bends.length),
            )
            if reach[0] + reach[1] + 1 >= FEWEST:
                found = _parabola(nearness, row, column, step, reach, bends)
                slope[row, column, axis] = np.float32(found[0])
                slope[row, column, 2 + axis] = np.float32(found[1])


@parallel_kernel
def measure_slopes(
    counter: Counter, nearness: Floats, band: Marks, bends: Bends, slope: Floats
) -> None:
    """Write slopes (H, W, 4) of surfaces along rows and columns, and their changes.

    0 where `band` (H, W) is not 0, and where a surface is too small.
    """
    for row in tasks(counter, nearness.shape[0]):
        _measure_row(nearness, band, bends, row, slope)
