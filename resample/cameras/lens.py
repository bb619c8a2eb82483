"""OpenCV's lens models: distort points of the plane at distance 1, and undistort them.

`Distortion`: radial, tangential and thin-prism distortion, then the tilt of the sensor, as in the
documentation of `cv2.calibrateCamera`. `Fisheye`: a ray at angle θ from the axis meets the picture
at θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸) focal lengths from its center, as in that of `cv2.fisheye`.
Points are x and y, (N,) float64.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.polynomial import Polynomial
from numpy.typing import NDArray

from resample.types import Doubles

COUNTS = (4, 5, 8, 12, 14)  # of coefficients
COUNT = 4  # of those of a fisheye
STEPS = 30  # of Newton's method; most points need 2
TABLE = 1024  # radii or angles in the table of initial guesses
FARTHEST = 1e6  # radius at distance 1 beyond which nothing is visible
NEAR_AXIS = 1e-8  # radius below which the ratio of angle and radius is 1

Points = tuple[Doubles, Doubles]  # x and y


class Distortion(NamedTuple):
    """Coefficients of a lens, grouped by effect."""

    numerator: Doubles  # (4,) of the radial factor, in the squared radius
    denominator: Doubles  # (4,)
    tangential: Doubles  # (2,)
    prism: Doubles  # (4,)
    tilt: Doubles  # (3, 3) homography of the plane
    fold: float  # squared radius at which the distorted radius stops increasing

    def bend(self, x: Doubles, y: Doubles) -> Points:
        """Distort points; NaN beyond the fold."""
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            bent = _bend(self, x, y)
            is_single = _is_single(self, x, y, bent)
            x, y = project(self.tilt, bent.x, bent.y)
        return np.where(is_single, x, np.nan), np.where(is_single, y, np.nan)

    def unbend(self, x: Doubles, y: Doubles, tolerance: float) -> Points:
        """Undistort points by Newton's method; NaN where no solution exists.

        A solution is valid if distorting it reproduces the point to within `tolerance`, and if it
        lies on the axis's side of the fold.
        """
        x, y = project(np.asarray(np.linalg.inv(self.tilt), np.float64), np.ravel(x), np.ravel(y))
        u, v = _start(self, x, y)
        is_found, left = np.zeros(x.shape, bool), np.arange(x.size)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            for _ in range(STEPS):
                bent = _bend(self, u[left], v[left])
                miss = x[left] - bent.x, y[left] - bent.y
                is_near = np.hypot(*miss) <= tolerance
                is_found[left] = is_near & _is_single(self, u[left], v[left], bent)
                # The last step is skipped: it concerns points that are found or have no solution.
                is_open = ~is_near & np.isfinite(miss[0] + miss[1])
                if not is_open.any():
                    break
                step = _step(self, u[left], v[left], bent, miss)
                left = left[is_open]
                u[left], v[left] = step[0][is_open], step[1][is_open]
        return np.where(is_found, u, np.nan), np.where(is_found, v, np.nan)


class _Bent(NamedTuple):
    """Distorted points and their derivatives by the undistorted ones."""

    x: Doubles
    y: Doubles
    x_by_x: Doubles
    x_by_y: Doubles
    y_by_x: Doubles
    y_by_y: Doubles

    def determinant(self) -> Doubles:
        return self.x_by_x * self.y_by_y - self.x_by_y * self.y_by_x


def distortion(coefficients: Doubles) -> Distortion:
    """Distortion from 4, 5, 8, 12 or 14 coefficients in OpenCV's order; missing ones are 0."""
    k1, k2, p1, p2, k3, k4, k5, k6, *others = np.pad(coefficients, (0, 14 - coefficients.size))
    numerator, denominator = np.array([1, k1, k2, k3]), np.array([1, k4, k5, k6])
    tangential, prism = np.array([p1, p2]), np.array(others[:4])
    # The radius r n(s) / d(s), s = r², stops increasing where its derivative is 0, or has a pole.
    n, d, s = Polynomial(numerator), Polynomial(denominator), Polynomial([0, 1])
    growth = n * d + 2 * s * (n.deriv() * d - n * d.deriv())
    fold = _least(np.concatenate([growth.roots(), d.roots()]), np.inf)
    tilt = _tilt(others[4], others[5])
    return Distortion(numerator, denominator, tangential, prism, tilt, fold)


def _least(roots: NDArray[Any], most: float) -> float:
    """Least real root above 0 and below a limit, or that."""
    root = np.asarray(roots, np.complex128)
    is_real = (np.abs(root.imag) <= 1e-9 * np.abs(root)) & (root.real > 0.0)
    return float(np.min(root.real[is_real], initial=most))


def _start(lens: Distortion, x: Doubles, y: Doubles) -> Points:
    """Initial guesses that invert only the radial part, read from a table."""
    radius, fold = np.hypot(x, y), float(np.sqrt(lens.fold))
    farthest = float(np.max(radius, initial=0.0, where=np.isfinite(radius)))
    reach = min(farthest, fold)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        while reach < min(fold, FARTHEST) and not _radial(lens, np.array(reach)) >= farthest:
            reach = min(2.0 * reach, fold)
        table = np.linspace(0.0, reach, TABLE, endpoint=False)
        found = np.interp(radius, _radial(lens, table), table)
        scale = np.where(radius > 0.0, found / radius, 1.0)
    return x * scale, y * scale


def _radial(lens: Distortion, radius: Doubles) -> Doubles:
    """Distort a radius by the radial part of the lens."""
    s = radius * radius
    return radius * _horner(lens.numerator, s)[0] / _horner(lens.denominator, s)[0]


def _tilt(across: float, along: float) -> Doubles:
    """Homography of a sensor tilted by τx and τy, rad."""
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(across), np.sin(across)], [0, -np.sin(across), np.cos(across)]]
    )
    about_y = np.array(
        [[np.cos(along), 0, -np.sin(along)], [0, 1, 0], [np.sin(along), 0, np.cos(along)]]
    )
    turn = about_y @ about_x
    back = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]])
    return np.asarray(back @ turn, np.float64)


def _bend(lens: Distortion, x: Doubles, y: Doubles) -> _Bent:
    """Apply radial, tangential and thin-prism distortion, with derivatives."""
    (p1, p2), (s1, s2, s3, s4) = lens.tangential, lens.prism
    s = x * x + y * y
    above, below = _horner(lens.numerator, s), _horner(lens.denominator, s)
    factor = above[0] / below[0]
    slope = 2.0 * (above[1] - factor * below[1]) / below[0]  # twice d factor / ds
    prism_x, prism_y = 2.0 * (s1 + 2.0 * s2 * s), 2.0 * (s3 + 2.0 * s4 * s)
    crossed = x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y
    return _Bent(
        x * factor + 2.0 * p1 * x * y + p2 * (s + 2.0 * x * x) + (s1 + s2 * s) * s,
        y * factor + p1 * (s + 2.0 * y * y) + 2.0 * p2 * x * y + (s3 + s4 * s) * s,
        factor + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x + prism_x * x,
        crossed + prism_x * y,
        crossed + prism_y * x,
        factor + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x + prism_y * y,
    )


def _horner(c: Doubles, s: Doubles) -> tuple[Doubles, Doubles]:
    """Value and slope of a cubic polynomial."""
    return ((c[3] * s + c[2]) * s + c[1]) * s + c[0], (3.0 * c[3] * s + 2.0 * c[2]) * s + c[1]


def _is_single(lens: Distortion, x: Doubles, y: Doubles, bent: _Bent) -> NDArray[np.bool_]:
    """Whether points are on the axis's side of the fold."""
    return (x * x + y * y < lens.fold) & (bent.determinant() > 0)


def _step(lens: Distortion, u: Doubles, v: Doubles, bent: _Bent, miss: Points) -> Points:
    """Newton step from the residual, never beyond the fold."""
    determinant = bent.determinant()
    next_u = u + (miss[0] * bent.y_by_y - miss[1] * bent.x_by_y) / determinant
    next_v = v + (miss[1] * bent.x_by_x - miss[0] * bent.y_by_x) / determinant
    if not np.isfinite(lens.fold):
        return next_u, next_v
    limit, radius = np.sqrt(lens.fold), np.hypot(next_u, next_v)
    shrink = np.where(radius < limit, 1.0, 0.5 * (np.hypot(u, v) + limit) / radius)
    return next_u * shrink, next_v * shrink


def project(matrix: Doubles, x: Doubles, y: Doubles) -> Points:
    """Apply a homography to points; NaN behind the eye."""
    d = matrix[2, 0] * x + matrix[2, 1] * y + matrix[2, 2]
    d = np.where(d > 0, d, np.nan)
    return (
        (matrix[0, 0] * x + matrix[0, 1] * y + matrix[0, 2]) / d,
        (matrix[1, 0] * x + matrix[1, 1] * y + matrix[1, 2]) / d,
    )


class Fisheye(NamedTuple):
    """Distance from the center of the picture, as a polynomial of the angle."""

    distance: Polynomial
    slope: Polynomial
    fold: float  # rad: angle at which the distance stops increasing, or the plane ends

    def bend(self, x: Doubles, y: Doubles) -> Points:
        """Distort points; NaN beyond the fold."""
        radius = np.hypot(x, y)
        angle = np.arctan(radius)
        scale = _ratio(self.distance(angle), radius)
        scale[~(angle < self.fold)] = np.nan
        with np.errstate(invalid="ignore"):  # infinite values are beyond the fold
            return x * scale, y * scale

    def unbend(self, x: Doubles, y: Doubles, tolerance: float) -> Points:
        """Undistort points by Newton's method; NaN where no solution exists.

        A solution is valid if distorting it reproduces the point to within `tolerance`.
        """
        x, y = np.ravel(x), np.ravel(y)
        distance = np.hypot(x, y)
        table = np.linspace(0.0, self.fold, TABLE)
        angle = np.interp(distance, self.distance(table), table)
        with np.errstate(divide="ignore", invalid="ignore"):
            for _ in range(STEPS):
                miss = distance - self.distance(angle)
                if not (np.abs(miss) > 0.5 * tolerance).any():
                    break
                step = np.nan_to_num(miss / self.slope(angle), posinf=0.0, neginf=0.0)
                angle = np.clip(angle + step, 0.0, self.fold)
            is_found = (np.abs(distance - self.distance(angle)) <= tolerance) & (angle < self.fold)
            scale = _ratio(np.tan(angle), distance)
        scale[~is_found] = np.nan
        return x * scale, y * scale


def fisheye(coefficients: Doubles) -> Fisheye:
    """Fisheye lens with coefficients k1, k2, k3, k4."""
    distance = Polynomial(np.ravel([[0.0, k] for k in (1.0, *coefficients)]))
    slope = distance.deriv()
    return Fisheye(distance, slope, _least(slope.roots(), 0.5 * math.pi))


def _ratio(after: Doubles, before: Doubles) -> Doubles:
    """Ratio of radii; 1 at the axis."""
    is_away = before > NEAR_AXIS
    return np.divide(after, before, out=np.ones_like(before), where=is_away)
