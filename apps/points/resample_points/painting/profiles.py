"""Tables of smoothing kernels that column densities and slices are painted from."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from resample.types import Doubles
from resample_points.data.smoothing import SmoothingKernel, kernel_of

STEPS = 4096  # of (r / H)²
NODES = 256  # of integrals along a line
CELLS = 256  # of the integral over a quadrant, along each axis


class ColumnTables(NamedTuple):
    """A kernel of support radius 1, integrated along lines; its integral over the plane is 1."""

    profile: Doubles  # (STEPS + 1, 2) at even (distance)²: the integral, and its Laplacian
    quadrant: Doubles  # (CELLS + 1, CELLS + 1) integral from 0 to y and from 0 to x


@lru_cache(maxsize=8)
def column_tables(name: str) -> ColumnTables:
    """Return the tables of a kernel's columns."""
    from scipy.interpolate import CubicSpline

    square = np.linspace(0.0, 1.0, STEPS + 1)
    column = line_integral(kernel_of(name), np.sqrt(square))
    smooth = CubicSpline(square, column)
    laplacian = 4.0 * (smooth(square, 1) + square * smooth(square, 2))
    return ColumnTables(np.stack([column, laplacian], axis=1), _quadrant(square, column))


@lru_cache(maxsize=8)
def slice_tables(name: str) -> ColumnTables:
    """Return a kernel's density at even (distance)², in place of its columns."""
    profile = np.zeros((STEPS + 1, 2))
    profile[:, 0] = kernel_of(name).density(np.sqrt(np.linspace(0.0, 1.0, STEPS + 1)))
    return ColumnTables(profile, column_tables(name).quadrant)


@lru_cache(maxsize=8)
def _mass_outside(name: str) -> tuple[Doubles, Doubles]:
    """Even (distance)², and the integral of 2 π r W(r) from there to 1."""
    square = np.linspace(0.0, 1.0, STEPS + 1)
    kernel, half = kernel_of(name), 0.5 / STEPS
    ends, middle = kernel.density(np.sqrt(square)), kernel.density(np.sqrt(square[:-1] + half))
    parts = np.pi / (6.0 * STEPS) * (ends[:-1] + 4.0 * middle + ends[1:])
    return square, np.append(np.cumsum(parts[::-1])[::-1], 0.0)


def plane_share(name: str, square: Doubles) -> Doubles:
    """Return the integrals of a kernel over planes at given (distance / H)², per 1 / H."""
    places, values = _mass_outside(name)
    return np.interp(square, places, values)


def line_integral(kernel: SmoothingKernel, distance: Doubles) -> Doubles:
    """Return the integrals of a kernel along lines at these distances (N,) from its center."""
    nodes, weights = np.polynomial.legendre.leggauss(NODES)
    half = np.sqrt(np.maximum(1.0 - distance * distance, 0.0))
    along = half[:, None] * (0.5 + 0.5 * nodes)
    away = np.minimum(np.hypot(along, distance[:, None]), 1.0)
    return np.asarray(half * (kernel.density(away) @ weights))


def _quadrant(square: Doubles, column: Doubles) -> Doubles:
    """Return the integral of a column over rectangles from its center, a quarter in all."""
    nodes, weights = np.polynomial.legendre.leggauss(4)
    place = ((np.arange(CELLS)[:, None] + 0.5 + 0.5 * nodes) / CELLS).ravel()
    weight = np.tile(weights / (2.0 * CELLS), CELLS)
    away = place[:, None] ** 2 + place**2
    parts = np.interp(away, square, column, right=0.0) * weight[:, None] * weight
    cells = parts.reshape(CELLS, 4, CELLS, 4).sum(axis=(1, 3))
    whole = np.zeros((CELLS + 1, CELLS + 1))
    whole[1:, 1:] = cells.cumsum(axis=0).cumsum(axis=1)
    return np.asarray(whole * (0.25 / whole[-1, -1]))
