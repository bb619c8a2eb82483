"""Real spherical harmonics of degrees 1 to 3: their values, their rotation, and 16-bit storage.

The order and the signs are those of trained scenes: m from -l to l within degree l, with the
Condon-Shortley phase.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles

CONSTANT = 0.28209479177387814  # value of the harmonic of degree 0, 1 / (2 √π)
COUNTS = (0, 3, 8, 15)  # coefficients of degrees 1 to l
LARGEST = 32.0  # a coefficient beyond it would be a color beyond 15 times white
WIDEST = 32767  # largest stored whole number
TURNING = 96  # directions by which a rotation of harmonics is found
STEP = 1 << 12  # Gaussians per part: a part of a file stays in the cache


def harmonics_along(direction: ArrayLike, count: int) -> Doubles:
    """Return the first 3, 8 or 15 harmonics (N, count) along unit directions (N, 3)."""
    x, y, z = np.moveaxis(np.asarray(direction, np.float64), -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    first, second = math.sqrt(3 / (4 * math.pi)), math.sqrt(15 / (4 * math.pi))
    values = [
        *(-first * y, first * z, -first * x),
        *(second * x * y, -second * y * z),
        math.sqrt(5 / (16 * math.pi)) * (2 * zz - xx - yy),
        *(-second * x * z, second / 2 * (xx - yy)),
        -math.sqrt(35 / (32 * math.pi)) * y * (3 * xx - yy),
        math.sqrt(105 / (4 * math.pi)) * x * y * z,
        -math.sqrt(21 / (32 * math.pi)) * y * (4 * zz - xx - yy),
        math.sqrt(7 / (16 * math.pi)) * z * (2 * zz - 3 * xx - 3 * yy),
        -math.sqrt(21 / (32 * math.pi)) * x * (4 * zz - xx - yy),
        math.sqrt(105 / (16 * math.pi)) * z * (xx - yy),
        -math.sqrt(35 / (32 * math.pi)) * x * (xx - 3 * yy),
    ]
    return np.stack(values[:count], -1) if count else np.zeros((*x.shape, 0))


def turned_harmonics(rotation: ArrayLike, count: int) -> Doubles:
    """Return the matrix (count, count) that turns coefficients with a scene.

    `rotation`: (3, 3), old to new axes. A function f becomes f(Rᵀ d), whose coefficients follow
    from its values along fixed directions; the matrix has one block per degree.
    """
    turn = np.asarray(rotation, np.float64)
    values = harmonics_along(_directions() @ turn, count)
    matrix: Doubles = np.linalg.pinv(harmonics_along(_directions(), count)) @ values
    return matrix


@cache
def _directions() -> Doubles:
    """Directions (TURNING, 3) that are evenly spread over the sphere."""
    n = np.arange(TURNING) + 0.5
    z, angle = 1 - 2 * n / TURNING, math.pi * (1 + math.sqrt(5)) * n
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], -1)


def step_of(largest: float) -> float:
    """Return the step of 16-bit whole numbers that hold coefficients up to a size."""
    return min(largest, LARGEST) / WIDEST if largest > 0 else 1.0 / WIDEST


def rounded_to(values: NDArray[Any], step: float) -> NDArray[np.int16]:
    """Return coefficients as whole numbers of steps; beyond 32767 steps they are clipped."""
    with np.errstate(over="ignore"):
        steps = values * np.float32(1.0 / step)
    np.clip(np.rint(steps, out=steps), -WIDEST, WIDEST, out=steps)
    return steps.astype(np.int16)


def parts_of(count: int) -> list[slice]:
    """Return slices of rows, so that what is computed with them stays small."""
    return [slice(first, min(first + STEP, count)) for first in range(0, count, STEP)]
