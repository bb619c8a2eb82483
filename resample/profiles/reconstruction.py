"""Reconstruction: radial 3-D kernels around samples, and their line integrals as tables.

A reconstruction is a density over the distance from a sample, in voxels, zero beyond its radius.
Its scale does not matter: tables are normalised so that the kernel's integral over space is one
voxel. A constant field is then reconstructed as that constant, up to the error that `ripple`
reports.
"""

from dataclasses import dataclass
from functools import cache
from typing import Protocol

import numpy as np

from resample.messages import number
from resample.registry import once
from resample.types import Doubles, Floats, Pieces, Profile, RadialTable

STEPS = 1024  # linear interpolation in 1024 steps errs by under 3e-6 of the peak
PARTIAL_STEPS = 256  # in both directions; linear interpolation errs by under 2e-5 of the peak
PROFILE_ERROR = 5e-6  # of the peak
PIECES_ERROR = 1e-5  # likewise
WIDEST = 64.0  # voxels, radius of a kernel


class Reconstruction(Protocol):
    """Interface of a reconstruction plugin; NumPy only, not compiled."""

    @property
    def radius(self) -> float:
        """Distance in voxels beyond which the density is zero."""

    def __call__(self, distance: Doubles) -> Doubles:
        """Density at distances in voxels; same shape."""


@dataclass(frozen=True)
class GaussianKernel:
    """Gaussian minus its value at the radius, so that it ends without a step.

    Parameters
    ----------
    sigma
        Standard deviation of the Gaussian before the subtraction, voxels. The default makes a
        constant field flattest for radius 2: from -0.37 % to +0.76 %.
    radius
        Radius at which it ends, voxels.
    """

    sigma: float = 0.65
    radius: float = 2.0

    def __post_init__(self) -> None:
        number("sigma", self.sigma)
        number("radius", self.radius)
        if not (0 < self.sigma < np.inf and 0 < self.radius < np.inf):
            raise ValueError(f"sigma {self.sigma} and radius {self.radius} must be above 0")

    def __call__(self, distance: Doubles) -> Doubles:
        rim = np.exp(-0.5 * (self.radius / self.sigma) ** 2)
        inside = np.maximum(np.exp(-0.5 * (distance / self.sigma) ** 2) - rim, 0)
        return np.where(distance < self.radius, inside, 0.0)


@dataclass(frozen=True)
class BSplineKernel:
    """Cubic B-spline of the distance: two continuous derivatives, flat within 0.21 %.

    Parameters
    ----------
    radius
        Radius at which it ends, voxels; its knot is at half the radius.
    """

    radius: float = 2.0

    def __post_init__(self) -> None:
        if not 0 < number("radius", self.radius) < np.inf:
            raise ValueError(f"radius {self.radius} must be above 0")

    def __call__(self, distance: Doubles) -> Doubles:
        t = 2 * distance / self.radius
        near = 2 / 3 - t**2 + t**3 / 2
        far = (2 - t) ** 3 / 6
        return np.where(t < 1, near, np.where(t < 2, far, 0.0))


@once
def footprint_table(reconstruction: Reconstruction) -> RadialTable:
    """Line integrals over the squared distance of the line from the center, in radii.

    Normalised so that the integral over the unit disk is 1 (paper, section 4.2,
    "footprint table", here for any radial kernel and without a square root per look-up).
    """
    integral = _line_integrals(reconstruction, np.linspace(0, 1, STEPS + 1))
    return RadialTable(integral.astype(np.float32), 1.0)


@once
def footprint_profile(reconstruction: Reconstruction) -> Profile | None:
    """Fit a formula that is faster than the table of line integrals; None if none fits.

    With t = 1 - squared distance, the integral along the chord of half length sqrt(t) is sqrt(t)
    times a smooth function of t, if the density is smooth in the squared distance. For Gaussians a
    polynomial of degree 8 errs by 3e-6 of the peak, as linear interpolation in the table does.
    Painters rely on the formula being non-negative everywhere.
    """
    exact = footprint_table(reconstruction).values.astype(np.float64)
    t = 1 - np.linspace(0, 1, STEPS + 1)
    powers = np.sqrt(t)[:, None] * t[:, None] ** np.arange(len(Profile._fields))
    coefficient = np.linalg.lstsq(powers, exact, rcond=None)[0].astype(np.float32)
    fitted = powers @ coefficient
    if np.abs(fitted - exact).max() > PROFILE_ERROR * exact.max() or fitted.min() < 0:
        return None
    return Profile(*coefficient)


@once
def footprint_pieces(reconstruction: Reconstruction) -> Pieces | None:
    """Like `footprint_profile`, in two pieces and for more kernels; None if none fits.

    Splines and kernels with other knots are smooth in the distance, not in its square.
    """
    pieces, terms, coefficients = len(Pieces._fields), np.arange(10), []
    peak = float(np.abs(_line_integrals(reconstruction, np.linspace(0, 1, STEPS + 1))).max())
    for piece in range(pieces):
        distance = np.linspace(piece / pieces, (piece + 1) / pieces, STEPS // pieces + 1)
        away = (distance - (piece + 0.5) / pieces)[:, None]
        rim = np.sqrt(1 - distance**2)[:, None]
        powers = rim * (away * 2 * pieces) ** terms
        exact = _line_integrals(reconstruction, distance**2)
        fitted = np.linalg.lstsq(powers, exact, rcond=None)[0]
        coefficient = (fitted * (2.0 * pieces) ** terms).astype(np.float32)
        error = np.abs(rim[:, 0] * (away**terms @ coefficient) - exact).max()
        if not error <= PIECES_ERROR * peak:
            return None
        coefficients.append(tuple(coefficient))
    return Pieces(*coefficients)


@once
def partial_table(reconstruction: Reconstruction) -> Floats:
    """Line integrals up to a position, (K + 1, K + 1).

    Rows are the squared distance of the line from the center, 0..1 radii²; columns the position on
    it, -1..1 radii from the point nearest to the center. Normalised as in `footprint_table`; its
    values are the last column. For a Gaussian error functions give this; the table serves any
    kernel.
    """
    node, weight = np.polynomial.legendre.leggauss(6)
    squared = np.linspace(0, 1, PARTIAL_STEPS + 1)[:, None, None]
    edge = np.linspace(-1, 1, PARTIAL_STEPS + 1)
    half = 1 / PARTIAL_STEPS
    place = (edge[:-1, None] + half) + half * node
    distance = np.sqrt(squared + place**2) * reconstruction.radius
    piece = (reconstruction(distance) * weight).sum(axis=-1) * half / _mass(reconstruction)
    table = np.zeros((PARTIAL_STEPS + 1, PARTIAL_STEPS + 1))
    np.cumsum(piece, axis=1, out=table[:, 1:])
    return table.astype(np.float32)


def variance(reconstruction: Reconstruction) -> float:
    """Variance of the kernel along one axis, voxels²."""
    r, shell = _shells(reconstruction)
    return float((r**2 * shell).sum() / shell.sum() / 3) * reconstruction.radius**2


def ripple(reconstruction: Reconstruction, steps: int = 12) -> tuple[float, float]:
    """Smallest and largest relative error of a reconstructed constant field."""
    reach = int(np.ceil(reconstruction.radius)) + 1
    lattice = np.stack(np.meshgrid(*[np.arange(-reach, reach + 1.0)] * 3), axis=-1).reshape(-1, 3)
    place = np.stack(np.meshgrid(*[np.linspace(0, 0.5, steps)] * 3), axis=-1).reshape(-1, 1, 3)
    distance = np.linalg.norm(place - lattice, axis=-1)
    field = reconstruction(distance).sum(axis=1) / (
        _mass(reconstruction) * reconstruction.radius**3
    )
    return float(field.min() - 1), float(field.max() - 1)


@cache
def _quadrature() -> tuple[Doubles, Doubles]:
    """Gauss-Legendre nodes and weights; computing them takes longer than importing this module."""
    node, weight = np.polynomial.legendre.leggauss(200)
    return node, weight


def _line_integrals(reconstruction: Reconstruction, squared: Doubles) -> Doubles:
    """Integrals along lines at squared distances (K,) from the center, radii²; 1 over the disk."""
    node, weight = _quadrature()
    squared = squared[:, None]
    half_chord = np.sqrt(1 - squared)
    along = half_chord * node
    density = reconstruction(np.sqrt(squared + along**2) * reconstruction.radius)
    integral = (density * weight).sum(axis=1) * half_chord[:, 0] / _mass(reconstruction)
    return np.asarray(integral, np.float64)


def _shells(reconstruction: Reconstruction) -> tuple[Doubles, Doubles]:
    """Radii in (0, 1), and the contribution of the shell around each to the kernel's integral."""
    node, weight = _quadrature()
    r = (node + 1) / 2
    return r, 4 * np.pi * r**2 * reconstruction(r * reconstruction.radius) * weight / 2


def _mass(reconstruction: Reconstruction) -> float:
    """Integral of the kernel over the unit ball."""
    if not 0 < reconstruction.radius <= WIDEST:
        raise ValueError(
            f"{reconstruction} reaches {reconstruction.radius} voxels; above 0 to {WIDEST:g} are "
            "allowed"
        )
    mass = float(_shells(reconstruction)[1].sum())
    if not 0 < mass < np.inf:
        raise ValueError(f"the integral of {reconstruction} is {mass}; it must be above 0")
    return mass
