"""Line integrals of kernels, and opacities, eight sub-pixels at a time."""

import math
from typing import Any

import numpy as np

from resample.engine.jit import lane_kernel, lane_role, lane_step, plays
from resample.engine.lookup import unit_lookup
from resample.types import Pieces, Profile, Single, Tabulated

Integral = Profile | Pieces | Tabulated

# expm1(x) / x - 1 over -1..0 by powers of x: least squares, within 1e-7.
_X = -np.linspace(1e-3, 1.0, 2000)
_SERIES = np.linalg.lstsq(_X[:, None] ** np.arange(1, 6), np.expm1(_X) / _X - 1.0, rcond=None)[0]
E1, E2, E3, E4, E5 = (np.float32(power) for power in _SERIES)


@lane_role
def line_integral(integral: Integral, t: Single, chord: Single) -> Single:
    """Line integral of a splat's kernel along the ray of a sub-pixel."""
    raise NotImplementedError


@plays(line_integral, Profile)
def _of_profile(integral, t, chord):  # type: ignore[no-untyped-def]
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = integral
    # Estrin's scheme: short dependency chains keep the lanes busy.
    t2 = t * t
    t4 = t2 * t2
    shape = (p4 + t * p5) + t2 * (p6 + t * p7) + t4 * p8
    shape = (p0 + t * p1) + t2 * (p2 + t * p3) + t4 * shape
    return chord * shape * math.sqrt(t)


@lane_kernel
def _two(
    is_far: Any, near: Single, next_near: Single, far: Single, next_far: Single, v: Single
) -> Single:
    """Two terms of the polynomial for the piece that a distance lies in."""
    return (far if is_far else near) + v * (next_far if is_far else next_near)


@plays(line_integral, Pieces)
def _of_pieces(integral, t, chord):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0.0), np.float32(1.0)
    # Distance from the middle of the piece; the two pieces meet at half the radius.
    distance = math.sqrt(max(zero, one - t))
    p, q = integral
    is_far = distance >= np.float32(0.5)
    v = distance - (np.float32(0.75) if is_far else np.float32(0.25))
    # Estrin's scheme, each coefficient selected by the piece.
    v2 = v * v
    v4 = v2 * v2
    low = _two(is_far, p[0], p[1], q[0], q[1], v) + v2 * _two(is_far, p[2], p[3], q[2], q[3], v)
    high = _two(is_far, p[4], p[5], q[4], q[5], v) + v2 * _two(is_far, p[6], p[7], q[6], q[7], v)
    high += v4 * _two(is_far, p[8], p[9], q[8], q[9], v)
    return chord * max(zero, low + v4 * high) * math.sqrt(t)


@plays(line_integral, Tabulated)
def _of_table(integral, t, chord):  # type: ignore[no-untyped-def]
    # Interpolate in the table; its kernel may have negative lobes.
    squared = max(np.float32(0.0), np.float32(1.0) - t)
    return chord * max(np.float32(0.0), unit_lookup(integral.values, squared))


@lane_step
def expm1_of(x: Single) -> Single:
    """Compute expm1 of a number between -1 and 0."""
    one, x2 = np.float32(1.0), x * x
    return x * ((one + x * E1) + x2 * ((E2 + x * E3) + x2 * (E4 + x * E5)))


@lane_step
def of_16_times(fall: Single) -> Single:
    """Compute expm1(16 x) from expm1(x): expm1(2x) = expm1(x) (expm1(x) + 2), four times."""
    two = np.float32(2.0)
    fall *= fall + two
    fall *= fall + two
    fall *= fall + two
    fall *= fall + two
    return fall
