"""Real spherical harmonics of degrees 1 to 3: their values, their rotation, and 16-bit storage.

The order and the signs are as in trained scenes: m from -l to l within degree l, with the
Condon-Shortley phase.
"""

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles

CONSTANT = 0.28209479177387814  # value of the harmonic of degree 0, 1 / (2 √π)
LINEAR = 0.4886025119029199  # of degree 1, √(3 / 4π)
# Of degree 2: of xy and its like, of z², and of x² − y².
MIXED, SQUARE, APART = 1.0925484305920792, 0.31539156525252005, 0.5462742152960396
# Of degree 3, from its outermost orders inward, and of z (x² − y²).
CUBIC = 0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154
EVEN = 1.445305721320277
COUNTS = (0, 3, 8, 15)  # coefficients of degrees 1 to l
LARGEST = 32.0  # a coefficient beyond it would be a color beyond 15 times white
WIDEST = 32767  # largest stored whole number
TURNING = 96  # directions by which a rotation of harmonics is found
STEP = 1 << 12  # Gaussians per part: a part of a file stays in the cache


def harmonics_along(direction: ArrayLike, count: int) -> Doubles:
    """Return the first 3, 8 or 15 harmonics (N, count) along unit directions (N, 3)."""
    x, y, z = np.moveaxis(np.asarray(direction, np.float64), -1, 0)
    xx, yy, zz = x * x, y * y, z * z
    values = [
        *(-LINEAR * y, LINEAR * z, -LINEAR * x),
        *(MIXED * x * y, -MIXED * y * z, SQUARE * (2 * zz - xx - yy)),
        *(-MIXED * x * z, APART * (xx - yy)),
        -CUBIC[0] * y * (3 * xx - yy),
        CUBIC[1] * x * y * z,
        -CUBIC[2] * y * (4 * zz - xx - yy),
        CUBIC[3] * z * (2 * zz - 3 * xx - 3 * yy),
        -CUBIC[2] * x * (4 * zz - xx - yy),
        EVEN * z * (xx - yy),
        -CUBIC[0] * x * (xx - 3 * yy),
    ]
    return np.stack(values[:count], -1) if count else np.zeros((*x.shape, 0))


def turned_harmonics(rotation: ArrayLike, count: int) -> Doubles:
    """Return the matrix (count, count) that turns coefficients with a scene.

    `rotation`: (3, 3), old to new axes. A function f becomes f(Rᵀ d); its coefficients follow
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
    """Return slices of rows, so that temporary arrays stay small."""
    return [slice(first, min(first + STEP, count)) for first in range(0, count, STEP)]
