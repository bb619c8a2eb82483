"""Cubic B-spline interpolation of a field between samples on a lattice: values and gradients.

Positions count samples along x, y and z; the first sample is at (1, 1, 1), since an array of
coefficients begins `PAD` samples before it. So the integer part of a position, its cell, is also
where the 4 × 4 × 4 coefficients begin that the position depends on. Samples stand for cells of a
volume: the field reaches half a sample beyond the outermost ones, where it is mirrored.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, when_compiling
from resample.engine.rays.weights import SLOPES, WEIGHTS
from resample.engine.vectors import Vector
from resample.types import Floats, Single, SplineField

PAD = 2  # samples by which an array of coefficients is extended on each side

Four = tuple[Single, Single, Single, Single]


class StoredCoefficients(NamedTuple):
    """Coefficients of one of two types; the other array is empty."""

    short: NDArray[np.uint16]  # (N,) or (0,)
    long: Floats  # (0,) or (N,)


def bundled(flat: NDArray[Any]) -> StoredCoefficients:
    """Put coefficients of either type into one bundle, which one kernel takes."""
    if flat.dtype == np.uint16:
        return StoredCoefficients(flat, np.empty(0, np.float32))
    return StoredCoefficients(np.empty(0, np.uint16), flat)


def sums_at(
    coefficient: StoredCoefficients,
    strides: tuple[np.uint64, np.uint64],
    cell: tuple[np.uint64, np.uint64, np.uint64],
    fraction: tuple[Single, Single, Single],
) -> Four:
    """Weighted sum of the 4 × 4 × 4 coefficients of a cell, and its derivatives along x, y and z.

    `strides`: from one row to the next, and from one plane to the next. Kernels compute it by
    operations on vectors (`spline_vectors`).
    """
    row, plane = (int(stride) for stride in strides)
    first = int(cell[2]) * plane + int(cell[1]) * row + int(cell[0])
    four, flat = np.arange(4), coefficient.short if coefficient.short.size else coefficient.long
    taps = flat[first + plane * four[:, None, None] + row * four[:, None] + four]
    powers = [np.power(float(part), four) for part in fraction]
    x, y, z = (np.float32(power @ np.array(WEIGHTS)) for power in powers)
    across, down, deep = (np.float32(power[:3] @ np.array(SLOPES)) for power in powers)
    pairs = ((x, y, z), (across, y, z), (x, down, z), (x, y, deep))
    one, two, three, four_ = (np.einsum("kji,i,j,k", np.float32(taps), *each) for each in pairs)
    return one, two, three, four_


def ends_at(
    coefficient: StoredCoefficients,
    strides: tuple[np.uint64, np.uint64],
    cell: tuple[np.uint64, np.uint64, np.uint64],
    fraction: tuple[Single, Single, Single],  # noqa: ARG001  as of `sums_at`
) -> Four:
    """Least of the eight samples around a cell, and the least of them negated, twice each."""
    corners = np.argwhere(np.ones((2, 2, 2))).astype(np.float32)
    samples = [sums_at(coefficient, strides, cell, (x, y, z))[0] for x, y, z in corners]
    least, most = min(samples), -max(samples)
    return least, most, least, most


@when_compiling
def _compile_as_vectors() -> None:
    from resample.engine.rays import spline_vectors

    spline_vectors.define(sums_at, ends_at)


@inner_step
def _sums_at(flat: SplineField, place: Vector) -> Four:
    """Sums of coefficients at a position within a field."""
    i, j, k = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    fraction = (np.float32(place[0] - i), np.float32(place[1] - j), np.float32(place[2] - k))
    strides = (np.uint64(flat.row), np.uint64(flat.plane))
    coefficient: Any = flat.coefficient  # in kernels as `bundled` makes it
    return sums_at(coefficient, strides, (i, j, k), fraction)


@inner_step
def value_at(flat: SplineField, place: Vector) -> float:
    """Value of a field at a position within it, data units."""
    return flat.zero + flat.scale * float(_sums_at(flat, place)[0])


@inner_step
def value_and_slope_at(flat: SplineField, place: Vector) -> tuple[float, Vector]:
    """Value of a field at a position within it, and its gradient, data units per sample."""
    value, x, y, z = _sums_at(flat, place)
    scale = flat.scale
    slope = scale * float(x), scale * float(y), scale * float(z)
    return flat.zero + scale * float(value), slope


@inner_step
def samples_around(flat: SplineField, place: Vector) -> tuple[float, float]:
    """Least and greatest of the eight samples around a position, data units."""
    cell = np.uint64(place[0]), np.uint64(place[1]), np.uint64(place[2])
    strides, no = (np.uint64(flat.row), np.uint64(flat.plane)), np.float32(0)
    coefficient: Any = flat.coefficient
    least, most, _, _ = ends_at(coefficient, strides, cell, (no, no, no))
    return flat.zero + flat.scale * float(least), flat.zero - flat.scale * float(most)
