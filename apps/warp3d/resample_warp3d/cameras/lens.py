"""OpenCV's model of a lens: where it bends points of the plane at distance 1, and back.

The model is OpenCV's own; what is added is a way back that converges, and knows which points no
light reaches.
"""

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from resample.types import Doubles

COUNTS = (4, 5, 8, 12, 14)  # of coefficients
STEPS = 30  # of Newton's method; most points need 2
BLOCK = 1 << 15  # points at a time; OpenCV writes 48 numbers for each


class Bent(NamedTuple):
    """N points behind the lens."""

    point: Doubles  # (N, 2)
    derivative: Doubles  # (N, 2, 2) by the point before the lens


def bend(coefficients: Doubles, point: Doubles) -> Bent:
    """Points (N, 2) behind the lens."""
    import cv2

    ray = np.column_stack([point, np.ones(len(point))])
    nothing = np.zeros(3)
    bent, derivative = cv2.projectPoints(ray[:, None], nothing, nothing, np.eye(3), coefficients)
    return Bent(bent[:, 0], derivative[:, 3:5].reshape(-1, 2, 2))  # at distance 1, by a shift


def unbend(coefficients: Doubles, point: Doubles, tolerance: float) -> Doubles:
    """Points (N, 2) before the lens; not a number where there is none.

    A point counts as found if the lens takes it to within `tolerance` of where it should, and if it
    lies where the lens has not begun to turn points back.
    """
    limit = fold(coefficients)
    blocks = range(0, len(point), BLOCK)
    found = [_unbend(coefficients, point[n : n + BLOCK], tolerance, limit) for n in blocks]
    return np.concatenate(found) if found else np.empty((0, 2))


def fold(coefficients: Doubles) -> float:
    """Radius before the lens at which it begins to turn points back; inf if it never does.

    The smallest r at which r n(r²) / d(r²), the model's radial part, stops to grow or has a pole.
    """
    k1, k2, _, _, k3, k4, k5, k6 = np.pad(coefficients, (0, 14 - coefficients.size))[:8]
    n, d, s = Polynomial([1, k1, k2, k3]), Polynomial([1, k4, k5, k6]), Polynomial([0, 1])
    growth = n * d + 2 * s * (n.deriv() * d - n * d.deriv())
    root = np.concatenate([growth.roots(), d.roots()]).astype(np.complex128)
    is_radius = (np.abs(root.imag) <= 1e-9 * np.abs(root)) & (root.real > 0)
    return float(np.sqrt(np.min(root.real[is_radius], initial=np.inf)))


def _unbend(coefficients: Doubles, point: Doubles, tolerance: float, limit: float) -> Doubles:
    """Newton's method; points that are found drop out."""
    found = _start(coefficients, point, limit)
    is_found = np.zeros(len(point), bool)
    left = np.arange(len(point))
    for _ in range(STEPS):
        bent = bend(coefficients, found[left])
        miss = point[left] - bent.point
        determinant = np.linalg.det(bent.derivative)
        is_near = np.hypot(miss[:, 0], miss[:, 1]) <= tolerance
        is_found[left] = is_near & (determinant > 0)
        is_open = ~is_near & (np.abs(determinant) > 1e-12)
        left = left[is_open]
        if not left.size:
            break
        step = np.linalg.solve(bent.derivative[is_open], miss[is_open, :, None])[..., 0]
        found[left] = _inside(found[left], found[left] + step, limit)
    is_found &= np.hypot(found[:, 0], found[:, 1]) < limit
    return np.where(is_found[:, None], found, np.nan)


def _start(coefficients: Doubles, point: Doubles, limit: float) -> Doubles:
    """What a few steps of OpenCV give; where they lead astray, the point itself, drawn inward."""
    import cv2

    first = cv2.undistortPoints(np.ascontiguousarray(point[:, None]), np.eye(3), coefficients)[:, 0]
    radius = np.maximum(np.hypot(point[:, 0], point[:, 1]), 1e-300)
    inward = point * np.minimum(1.0, 0.5 * limit / radius)[:, None]
    is_astray = ~(np.hypot(first[:, 0], first[:, 1]) < 0.9 * limit)
    return np.where(is_astray[:, None], inward, first)


def _inside(before: Doubles, after: Doubles, limit: float) -> Doubles:
    """Points moved, but never beyond the fold."""
    if not np.isfinite(limit):
        return after
    radius = np.hypot(after[:, 0], after[:, 1])
    halfway = 0.5 * (np.hypot(before[:, 0], before[:, 1]) + limit)
    return after * np.where(radius < limit, 1.0, halfway / np.maximum(radius, 1e-300))[:, None]
