"""Vectors and matrices as tuples of numbers.

They live in registers, need no allocation, and have no reference counts that calls would touch.
"""

import numpy as np

from resample.engine.jit import inner_kernel, kernel
from resample.types import Doubles, Floats

Vector = tuple[float, float, float]
Matrix = tuple[Vector, Vector, Vector]  # rows


# Products, written out for three dimensions.
@kernel
def dot(u: Vector, v: Vector) -> float:
    """Dot product."""
    return u[0] * v[0] + u[1] * v[1] + u[2] * v[2]


@kernel
def cross(u: Vector, v: Vector) -> Vector:
    """Cross product."""
    return (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0])


@kernel
def combine(u: Vector, scale: float, v: Vector) -> Vector:
    """Sum u + scale v."""
    return (u[0] + scale * v[0], u[1] + scale * v[1], u[2] + scale * v[2])


@kernel
def scaled(scale: float, v: Vector) -> Vector:
    """Product of a scalar and a vector."""
    return (scale * v[0], scale * v[1], scale * v[2])


@kernel
def multiply(matrix: Matrix, v: Vector) -> Vector:
    """Matrix times column vector."""
    return (dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v))


@kernel
def column(matrix: Matrix, c: int) -> Vector:
    """Column of a matrix."""
    return (matrix[0][c], matrix[1][c], matrix[2][c])


# Conversions from arrays.
@inner_kernel
def vector_at(flat: Floats, n: np.uint64) -> Vector:
    """The nth of many vectors with contiguous numbers."""
    # Unsigned indices need no test for negative values.
    k = np.uint64(3) * n
    return float(flat[k]), float(flat[k + np.uint64(1)]), float(flat[k + np.uint64(2)])


@kernel
def matrix_of(array: Doubles) -> Matrix:
    """Matrix from an array (3, 3)."""
    return (
        (array[0, 0], array[0, 1], array[0, 2]),
        (array[1, 0], array[1, 1], array[1, 2]),
        (array[2, 0], array[2, 1], array[2, 2]),
    )
