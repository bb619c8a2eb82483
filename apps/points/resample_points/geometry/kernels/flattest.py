"""Direction of least spread of points: an eigenvector of a symmetric 3 × 3 matrix."""

import math

from resample.engine.jit import kernel
from resample.engine.vectors import Matrix, Vector, dot

STEPS = 8  # of Newton's method at most
NEAR = 2.0**-26  # of the trace: after a step this small, the next would make no difference
APART = 2.0**-8  # of the trace's square: least distance of an eigenvalue from the others
SWEEPS = 6  # of Jacobi's method: 3 × 3 matrices have then converged
STILL = 2.0**-52  # tangents of rotations that are skipped: 2⁻²⁸ of float32's resolution


@kernel
def _turned(m: Matrix, v: Matrix) -> tuple[Matrix, Matrix]:
    """Rotate by Jacobi's method: make the entry 0, 1 of a symmetric matrix 0.

    Rotations too small for float32 are skipped. `v` accumulates the rotations.
    """
    if abs(m[0][1]) <= STILL * abs(m[1][1] - m[0][0]):
        return m, v
    # Find the smaller of the two angles that make the entry 0.
    half = 0.5 * (m[1][1] - m[0][0]) / m[0][1]
    t = math.copysign(1.0, half) / (abs(half) + math.sqrt(half * half + 1.0))
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    # Rotate columns, then rows, and the vectors found so far.
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
    """Rotate the first two columns of one row of a matrix."""
    return c * row[0] - s * row[1], s * row[0] + c * row[1], row[2]


@kernel
def _swapped(m: Matrix) -> Matrix:
    """Exchange rows and columns 1 and 2 of a matrix."""
    return (
        (m[0][0], m[0][2], m[0][1]),
        (m[2][0], m[2][2], m[2][1]),
        (m[1][0], m[1][2], m[1][1]),
    )


@kernel
def _rolled(m: Matrix) -> Matrix:
    """Permute rows and columns of a matrix to 1, 2, 0."""
    return (
        (m[1][1], m[1][2], m[1][0]),
        (m[2][1], m[2][2], m[2][0]),
        (m[0][1], m[0][2], m[0][0]),
    )


@kernel
def _turned_flattest(m: Matrix) -> Vector:
    """Return `flattest` by Jacobi's method, for eigenvalues however close."""
    v: Matrix = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    for _ in range(SWEEPS):
        # Rotate each of the three pairs of axes once, by permuting it to the front.
        before = v
        m, v = _turned(m, v)
        m, v = _turned(_swapped(m), _swapped(v))
        m, v = _turned(_rolled(_swapped(m)), _rolled(_swapped(v)))
        m, v = _rolled(_rolled(m)), _rolled(_rolled(v))
        # Stop when no rotation was needed.
        if v == before:
            break
    # Pick the vector of the least eigenvalue.
    least = v[0][0], v[1][0], v[2][0]
    if m[1][1] < m[0][0] and m[1][1] <= m[2][2]:
        least = v[0][1], v[1][1], v[2][1]
    elif m[2][2] < m[0][0]:
        least = v[0][2], v[1][2], v[2][2]
    return least


@kernel
def _least(m: Matrix, trace: float) -> float:
    """Least eigenvalue of a positive semidefinite matrix; NaN if another is as near.

    Newton's method does not overshoot the first zero of the characteristic polynomial.
    """
    # Compute the coefficients of the characteristic polynomial.
    minors = (
        m[0][0] * m[1][1]
        - m[0][1] * m[0][1]
        + (m[0][0] * m[2][2] - m[0][2] * m[0][2])
        + (m[1][1] * m[2][2] - m[1][2] * m[1][2])
    )
    # Without a gap to the other eigenvalues the method would not converge.
    if not minors > APART * trace * trace:
        return math.nan
    determinant = (
        m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[1][2])
        - m[0][1] * (m[0][1] * m[2][2] - m[1][2] * m[0][2])
        + m[0][2] * (m[0][1] * m[1][2] - m[1][1] * m[0][2])
    )
    # Approach the zero from below.
    value = 0.0
    for _ in range(STEPS):
        rest = ((value - trace) * value + minors) * value - determinant
        step = rest / ((3.0 * value - 2.0 * trace) * value + minors)
        value -= step
        if abs(step) <= NEAR * trace:
            return value
    return math.nan


@kernel
def flattest(m: Matrix) -> Vector:
    """Unit vector along which a positive semidefinite symmetric 3 × 3 matrix is least.

    Columns of the adjugate of the matrix minus the eigenvalue lie along the eigenvector.
    """
    trace = m[0][0] + m[1][1] + m[2][2]
    value = _least(m, trace)
    # Compute the adjugate's diagonal; Jacobi's method takes what is close to degenerate, or NaN.
    x, y, z = m[0][0] - value, m[1][1] - value, m[2][2] - value
    xx, yy, zz = y * z - m[1][2] * m[1][2], x * z - m[0][2] * m[0][2], x * y - m[0][1] * m[0][1]
    if not xx + yy + zz > APART * trace * trace:
        return _turned_flattest(m)
    # Take the longest column of the adjugate.
    xy, xz = m[0][2] * m[1][2] - m[0][1] * z, m[0][1] * m[1][2] - m[0][2] * y
    yz = m[0][1] * m[0][2] - x * m[1][2]
    if xx >= yy and xx >= zz:
        along = xx, xy, xz
    elif yy >= zz:
        along = xy, yy, yz
    else:
        along = xz, yz, zz
    length = math.sqrt(dot(along, along))
    return along[0] / length, along[1] / length, along[2] / length
