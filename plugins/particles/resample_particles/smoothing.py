"""Smoothing kernels of particles, their tables, and smoothing lengths found from neighbours.

A kernel of a support radius H is 0 from H on. Smoothing lengths are h = 2 σ, twice the standard
deviation of the kernel along an axis (Dehnen & Aly 2012), which is the same resolution for every
kernel; H / h depends on the kernel. SWIFT stores h, GADGET stores H of the cubic spline.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from resample.types import Doubles

NEIGHBOURS = 48  # within H of a cubic spline: h is 1.2348 times the mean spacing
# Tables of a kernel.
STEPS = 4096  # of (r / H)²
NODES = 256  # of integrals along a line
CELLS = 256  # of the integral over a quadrant, along each axis


@dataclass(frozen=True)
class SmoothingKernel:
    """A kernel of smoothed particles in space, of mass 1 and support radius 1."""

    name: str
    gamma: float  # H / h
    density: Callable[[Doubles], Doubles]  # per volume, at distances from 0 to 1


def _spline(q: Doubles) -> Doubles:
    inner = 1.0 - 6.0 * q * q * (1.0 - q)
    return np.asarray(8.0 / np.pi * np.where(q < 0.5, inner, 2.0 * (1.0 - q) ** 3))


def _wendland(q: Doubles) -> Doubles:
    return np.asarray(21.0 / (2.0 * np.pi) * (1.0 - q) ** 4 * (1.0 + 4.0 * q))


CUT = 4.0  # standard deviations from which the Gaussian kernel is 0
WITHIN = 0.9988660157102147  # share of a Gaussian's mass within these, in space
RIM = np.exp(-0.5 * CUT * CUT)  # of the Gaussian there, which is taken off with its slope
HEIGHT = 1.0 / (
    WITHIN * (2.0 * np.pi) ** 1.5 / CUT**3 - RIM * np.pi * (4.0 / 3.0 + 4.0 * CUT**2 / 15.0)
)


def _gaussian(q: Doubles) -> Doubles:
    square = 0.5 * CUT * CUT * q * q
    return np.asarray(HEIGHT * (np.exp(-square) - RIM * (1.0 + 0.5 * CUT * CUT - square)))


KernelName = Literal["cubic", "wendland", "gaussian"]
KERNELS = {
    kernel.name: kernel
    for kernel in (
        SmoothingKernel("cubic", (10.0 / 3.0) ** 0.5, _spline),
        SmoothingKernel("wendland", (15.0 / 4.0) ** 0.5, _wendland),
        SmoothingKernel("gaussian", 2.0442688318779556, _gaussian),
    )
}


def kernel_of(name: str) -> SmoothingKernel:
    """Return a kernel by its name: `cubic`, `wendland` or `gaussian`.

    Examples
    --------
    >>> from resample_particles.smoothing import kernel_of
    >>> round(kernel_of("cubic").gamma, 4)
    1.8257
    """
    if name not in KERNELS:
        raise ValueError(f"kernel {name!r}; known: {', '.join(KERNELS)}")
    return KERNELS[name]


def found_smoothing(position: ArrayLike, box: ArrayLike | None = None) -> Doubles:
    """Return the smoothing lengths (N,) at which a cubic spline reaches 48 neighbours.

    Parameters
    ----------
    position
        (N, 3).
    box
        (3,) size of a periodic box.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_particles.smoothing import found_smoothing
    >>> lattice = np.stack(np.meshgrid(*[np.arange(8.0)] * 3), axis=-1).reshape(-1, 3)
    >>> found_smoothing(lattice, (8, 8, 8)).round(2).tolist()[:2]
    [1.22, 1.22]
    """
    from scipy.spatial import cKDTree

    from resample.engine.jit import workers

    place = np.asarray(position, np.float64)
    most = min(NEIGHBOURS, len(place) - 1)
    if most < 1:
        return np.zeros(len(place))
    size = None if box is None else np.asarray(box, np.float64)
    tree = cKDTree(place if size is None else wrapped(place, size), boxsize=size)
    away, _ = tree.query(tree.data, k=[most + 1], workers=workers())
    within = np.cbrt(NEIGHBOURS / most) / KERNELS["cubic"].gamma
    return np.asarray(away[:, 0] * within)


def wrapped(position: Doubles, box: Doubles) -> Doubles:
    """Return positions (N, 3) moved into a periodic box, from 0 up to below its size."""
    inside = np.mod(position, box)
    return np.where(inside < box, inside, 0.0)


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
