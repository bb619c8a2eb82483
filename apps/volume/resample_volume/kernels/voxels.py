"""Where voxels lie, and how their values slope."""

import math
from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

from resample.kernels.jit import kernel, parallel_kernel
from resample.kernels.vectors import matrix_of, multiply
from resample.types import Doubles, Floats

CHUNK = 4096  # voxels that a thread takes at a time

Indices = NDArray[np.int64]
Step = tuple[int, int, int]  # z, y, x


@kernel
def _place_chunk(
    index: Indices, size: Step, lattice: Doubles, origin: Doubles, position: Floats, first: int
) -> None:
    """Positions of one chunk's voxels."""
    steps = matrix_of(lattice)
    for n in range(first, min(first + CHUNK, index.size)):
        z, rest = divmod(index[n], size[1] * size[2])
        y, x = divmod(rest, size[2])
        moved = multiply(steps, (float(x), float(y), float(z)))
        for c in range(3):
            position[n, c] = origin[c] + moved[c]


@parallel_kernel
def place(index: Indices, size: Step, lattice: Doubles, origin: Doubles, position: Floats) -> None:
    """Scene positions (N, 3) of voxels that are given by their flat index into (Z, Y, X)."""
    for chunk in numba.prange((index.size + CHUNK - 1) // CHUNK):
        _place_chunk(index, size, lattice, origin, position, chunk * CHUNK)


@kernel
def _value(values: NDArray[Any], place: Step) -> float:
    """Value of a voxel; NaN outside the volume."""
    z, y, x = place
    depth, height, width = values.shape
    if 0 <= z < depth and 0 <= y < height and 0 <= x < width:
        return float(values[z, y, x])
    return math.nan


@kernel
def _moved(place: Step, count: int, step: Step) -> Step:
    return (place[0] + count * step[0], place[1] + count * step[1], place[2] + count * step[2])


@kernel
def _slope(values: NDArray[Any], place: Step, step: Step) -> float:
    """Mean of the differences to the voxel before and to the one after.

    Where one of the two has no value the other decides, where both have none it is NaN. So values
    that are missing or infinite change no slope, and linear fields come out exactly everywhere.
    """
    here = _value(values, place)
    ahead = _value(values, _moved(place, 1, step)) - here
    behind = here - _value(values, _moved(place, -1, step))
    if not math.isfinite(ahead):
        return behind if math.isfinite(behind) else math.nan
    return 0.5 * (ahead + behind) if math.isfinite(behind) else ahead


@kernel
def _smooth_slope(values: NDArray[Any], place: Step, step: Step, reach: int) -> float:
    """Weighted mean of the slopes along parallel lines; 0 where none is known.

    The weights are a tent over `reach` voxels to either side: 1 for reach 0, which is the central
    difference, and 1-2-1 × 1-2-1 for reach 1, which is Sobel's.
    """
    across = (step[1], step[2], step[0])
    along = (step[2], step[0], step[1])
    total = weight = 0.0
    for a in range(-reach, reach + 1):
        line = _moved(place, a, across)
        for b in range(-reach, reach + 1):
            slope = _slope(values, _moved(line, b, along), step)
            if math.isfinite(slope):
                share = (reach + 1 - abs(a)) * (reach + 1 - abs(b))
                total += share * slope
                weight += share
    return total / weight if weight > 0.0 else 0.0


@kernel
def _gradient_chunk(
    values: NDArray[Any],
    index: Indices,
    reach: int,
    to_scene: Doubles,
    gradient: Floats,
    first: int,
) -> None:
    """Gradients of one chunk's voxels."""
    turn = matrix_of(to_scene)
    _, height, width = values.shape
    for n in range(first, min(first + CHUNK, index.size)):
        z, rest = divmod(index[n], height * width)
        y, x = divmod(rest, width)
        place = (z, y, x)
        slope = (
            _smooth_slope(values, place, (0, 0, 1), reach),
            _smooth_slope(values, place, (0, 1, 0), reach),
            _smooth_slope(values, place, (1, 0, 0), reach),
        )
        turned = multiply(turn, slope)
        for c in range(3):
            gradient[n, c] = turned[c]


@parallel_kernel
def gradients(
    values: NDArray[Any], index: Indices, reach: int, to_scene: Doubles, gradient: Floats
) -> None:
    """Gradients (N, 3) of `values` (Z, Y, X) at flat indices.

    `reach` is that of the smoothing, 0 or 1; `to_scene` (3, 3) the inverse transpose of the
    lattice, which takes slopes per voxel to slopes per scene unit.
    """
    for chunk in numba.prange((index.size + CHUNK - 1) // CHUNK):
        _gradient_chunk(values, index, reach, to_scene, gradient, chunk * CHUNK)
