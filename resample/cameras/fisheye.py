"""OpenCV's fisheye model: distort points of the plane at distance 1, and undistort them.

A ray at angle θ from the axis meets the picture at θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) focal
lengths from its center, as in the documentation of `cv2.fisheye`. Points are x and y, (N,) float64.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from resample.cameras.lens import Points
from resample.types import Doubles

COUNT = 4  # of coefficients
STEPS = 30  # of Newton's method; most points need 2
TABLE = 1024  # angles in the table of initial guesses
NEAR_AXIS = 1e-8  # radius below which the ratio of angle and radius is 1


class Fisheye(NamedTuple):
    """Distance from the center of the picture, as a polynomial of the angle."""

    distance: Polynomial
    slope: Polynomial
    fold: float  # rad: angle at which the distance stops increasing, or the plane ends


def fisheye(coefficients: Doubles) -> Fisheye:
    """Fisheye lens with coefficients k1, k2, k3, k4."""
    distance = Polynomial(np.ravel([[0.0, k] for k in (1.0, *coefficients)]))
    slope = distance.deriv()
    root = np.asarray(slope.roots(), np.complex128)
    is_angle = (np.abs(root.imag) <= 1e-9 * np.abs(root)) & (root.real > 0.0)
    fold = float(np.min(root.real[is_angle], initial=0.5 * math.pi))
    return Fisheye(distance, slope, fold)


def bend(lens: Fisheye, x: Doubles, y: Doubles) -> Points:
    """Distort points; NaN beyond the fold."""
    radius = np.hypot(x, y)
    angle = np.arctan(radius)
    scale = _ratio(lens.distance(angle), radius)
    scale[~(angle < lens.fold)] = np.nan
    with np.errstate(invalid="ignore"):  # infinite values are beyond the fold
        return x * scale, y * scale


def unbend(lens: Fisheye, x: Doubles, y: Doubles, tolerance: float) -> Points:
    """Undistort points by Newton's method; NaN where no solution exists.

    A solution is valid if distorting it reproduces the point to within `tolerance`.
    """
    x, y = np.ravel(x), np.ravel(y)
    distance = np.hypot(x, y)
    table = np.linspace(0.0, lens.fold, TABLE)
    angle = np.interp(distance, lens.distance(table), table)
    with np.errstate(divide="ignore", invalid="ignore"):
        for _ in range(STEPS):
            miss = distance - lens.distance(angle)
            if not (np.abs(miss) > 0.5 * tolerance).any():
                break
            step = np.nan_to_num(miss / lens.slope(angle), posinf=0.0, neginf=0.0)
            angle = np.clip(angle + step, 0.0, lens.fold)
        is_found = (np.abs(distance - lens.distance(angle)) <= tolerance) & (angle < lens.fold)
        scale = _ratio(np.tan(angle), distance)
    scale[~is_found] = np.nan
    return x * scale, y * scale


def _ratio(after: Doubles, before: Doubles) -> Doubles:
    """Ratio of radii; 1 at the axis."""
    is_away = before > NEAR_AXIS
    return np.divide(after, before, out=np.ones_like(before), where=is_away)
