"""The direction in which points are spread least: an eigenvector of a symmetric 3 × 3 matrix."""

import math

from resample.engine.jit import kernel
from resample.engine.vectors import Matrix, Vector

SWEEPS = 6  # of Jacobi's method: 3 × 3 matrices have then converged
STILL = 2.0**-52  # tangents of rotations that are left out: 2⁻²⁸ of what float32 tells apart


@kernel
def _turned(m: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
    """One rotation of Jacobi's method: makes the entry 0, 1 of a symmetric matrix 0.

    Rotations that would not show in float32 are left out. `v` holds what was turned so far.
    """
    if abs(m[0][1]) <= STILL * abs(m[1][1] - m[0][0]):
        return m, v
    half = 0.5 * (m[1][1] - m[0][0]) / m[0][1]
    t = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    top, low, last = _mixed(m[0], c, s), _mixed(m[1], c, s), _mixed(m[2], c, s)
    return (
        (
            (c * top[0] - s * low[0], c * top[1] - s * low[1], c * top[2] - s * low[2]),
            (s * top[0] + c * low[0], s * top[1] + c * low[1], s * top[2] + c * low[2]),
            last,
        ),
        (_mixed(v[0], c, s), _mixed(v[1], c, s), _mixed(v[2], c, s)),
    )


@kernel
def _mixed(row: Vector, c: float, s: float) -> Vector:
    """Row of a matrix whose first two columns are turned."""
    return c * row[0] - s * row[1], s * row[0] + c * row[1], row[2]


@kernel
def _swapped(m: Matrix) -> Matrix:
    """Matrix whose rows and columns 1 and 2 have changed places."""
    return (
        (m[0][0], m[0][2], m[0][1]),
        (m[2][0], m[2][2], m[2][1]),
        (m[1][0], m[1][2], m[1][1]),
    )


@kernel
def _rolled(m: Matrix) -> Matrix:
    """Matrix whose rows and columns are 1, 2, 0 of another."""
    return (
        (m[1][1], m[1][2], m[1][0]),
        (m[2][1], m[2][2], m[2][0]),
        (m[0][1], m[0][2], m[0][0]),
    )


@kernel
def flattest(m: Matrix) -> Vector:
    """Unit vector along which a symmetric 3 × 3 matrix is least."""
    v: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for _ in range(SWEEPS):
        before = v
        m, v = _turned(m, v)
        m, v = _turned(_swapped(m), _swapped(v))
        m, v = _turned(_rolled(_swapped(m)), _rolled(_swapped(v)))
        m, v = _rolled(_rolled(m)), _rolled(_rolled(v))
        if v == before:
            break
    least = v[0][0], v[1][0], v[2][0]
    if m[1][1] < m[0][0] and m[1][1] <= m[2][2]:
        least = v[0][1], v[1][1], v[2][1]
    elif m[2][2] < m[0][0]:
        least = v[0][2], v[1][2], v[2][2]
    return least
