"""Line integrals of a kernel around a sample, up to a position on the ray: in lanes of sub-pixels.

Distances are in radii. With t = 1 - squared distance of the ray from the center, the kernel spans
positions from -sqrt(t) to sqrt(t). The integral of a density Σ_j d_j t^j from 0 to x is

    Σ_j d_j ∫ (t - x²)^j dx = x Σ_m q_m(t) x^(2m)
    q_m(t) = (-1)^m / (2m + 1) Σ_j d_j (j over m) t^(j-m)

The nine q_m are computed once per ray, and serve all positions on it. A Gaussian, lowered by its
value at the rim, is a product of a factor across the ray and one along it, so one number suffices:

    q(t) x Σ_m p_m x^(2m) - rim x
"""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.rows import LANES
from resample.engine.jit import lane_step
from resample.engine.roles import lane_role, plays
from resample.types import Floats, Profile, Single

# Scratch for the rays of sixteen sub-pixels: LANES numbers each.
HALF, ALONG, SHIFT, AMPLITUDE, BEFORE, Q0, Q1, Q2, Q3, Q4, Q5, Q6, Q7, Q8 = (
    np.uint64(number * LANES) for number in range(14)
)
ROW = Q0  # of a table, in place of coefficients
WORK = 14 * LANES

Coefficients = tuple[Single, ...]  # of 1, t, t², ...


class Smooth(NamedTuple):
    """A kernel whose density is a polynomial in t."""

    whole: Profile  # line integrals, sqrt(t) times a polynomial in t
    q0: Coefficients  # nine coefficients in t
    q1: Coefficients  # eight, and so on
    q2: Coefficients
    q3: Coefficients
    q4: Coefficients
    q5: Coefficients
    q6: Coefficients
    q7: Coefficients
    q8: Coefficients


class Product(NamedTuple):
    """A Gaussian, lowered by its value at the rim."""

    whole: Profile  # line integrals, sqrt(t) times a polynomial in t
    across: Coefficients  # nine, in t
    along: Coefficients  # nine, in the squared position
    edge_value: float


class TabulatedIntegral(NamedTuple):
    """Any other kernel, tabulated."""

    whole: Floats  # (K + 1,) line integrals over the squared distance, 0..1
    part: Floats  # ((J + 1)²,) up to a position, -1..1, which varies fastest, over that distance
    steps: int  # J


Integral = Smooth | Product | TabulatedIntegral


@lane_role
def whole(integral: Integral, t: Single) -> Single:
    """Line integral through the whole kernel, from the ray's t."""
    raise NotImplementedError


@lane_role
def record_ray(
    integral: Integral, work: Floats, lane: np.uint64, t: Single, half: Single
) -> tuple[Single, Single]:
    """Set up a ray in `work`, from its t and sqrt(t).

    Return the value of `up_to` at the kernel's near end, and the whole line integral.
    """
    raise NotImplementedError


@lane_role
def up_to(integral: Integral, work: Floats, lane: np.uint64, x: Single) -> Single:
    """Integral up to a position within ±HALF, up to a constant of the ray."""
    raise NotImplementedError


@plays(whole, Product)
@plays(whole, Smooth)
def _whole_of_formula(integral, t):  # type: ignore[no-untyped-def]
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = integral.whole
    # Estrin's scheme: short dependency chains keep the lanes busy.
    t2 = t * t
    t4 = t2 * t2
    shape = (p4 + t * p5) + t2 * (p6 + t * p7) + t4 * p8
    shape = (p0 + t * p1) + t2 * (p2 + t * p3) + t4 * shape
    return shape * np.sqrt(t)


@plays(whole, TabulatedIntegral)
def _whole_of_table(integral, t):  # type: ignore[no-untyped-def]
    table = integral.whole
    # Interpolate linearly in the table.
    place = (np.float32(1.0) - t) * np.float32(table.size - 1)
    entry = min(np.uint32(place), np.uint32(table.size - 2))
    below = table[entry]
    return below + (place - np.float32(entry)) * (table[entry + np.uint32(1)] - below)


@plays(record_ray, Smooth)
def _record_by_formula(integral, work, lane, t, half):  # type: ignore[no-untyped-def]
    # Evaluate q0 to q7 at t, each by Estrin's scheme; q8 is a constant.
    _, a, b, c, d, e, f, g, h, i = integral
    t2 = t * t
    t4 = t2 * t2
    q0 = (a[4] + t * a[5]) + t2 * (a[6] + t * a[7]) + t4 * a[8]
    q0 = (a[0] + t * a[1]) + t2 * (a[2] + t * a[3]) + t4 * q0
    q1 = (b[4] + t * b[5]) + t2 * (b[6] + t * b[7])
    q1 = (b[0] + t * b[1]) + t2 * (b[2] + t * b[3]) + t4 * q1
    q2 = (c[0] + t * c[1]) + t2 * (c[2] + t * c[3]) + t4 * ((c[4] + t * c[5]) + t2 * c[6])
    q3 = (d[0] + t * d[1]) + t2 * (d[2] + t * d[3]) + t4 * (d[4] + t * d[5])
    q4 = (e[0] + t * e[1]) + t2 * (e[2] + t * e[3]) + t4 * e[4]
    q5 = (f[0] + t * f[1]) + t2 * (f[2] + t * f[3])
    q6 = (g[0] + t * g[1]) + t2 * g[2]
    q7 = h[0] + t * h[1]
    # Store them for `up_to`.
    work[lane + Q0] = q0
    work[lane + Q1] = q1
    work[lane + Q2] = q2
    work[lane + Q3] = q3
    work[lane + Q4] = q4
    work[lane + Q5] = q5
    work[lane + Q6] = q6
    work[lane + Q7] = q7
    work[lane + Q8] = i[0]
    work[lane + HALF] = half
    # Half of the line integral, from the middle to the far end.
    rest = (q4 + t * q5) + t2 * (q6 + t * q7) + t4 * i[0]
    middle = half * ((q0 + t * q1) + t2 * (q2 + t * q3) + t4 * rest)
    return -middle, middle + middle


@lane_step
def _nine(c: Coefficients, v: Single) -> Single:
    """Polynomial with nine coefficients, by Estrin's scheme."""
    v2 = v * v
    v4 = v2 * v2
    high = (c[4] + v * c[5]) + v2 * (c[6] + v * c[7]) + v4 * c[8]
    return (c[0] + v * c[1]) + v2 * (c[2] + v * c[3]) + v4 * high


@plays(record_ray, Product)
def _record_by_product(integral, work, lane, t, half):  # type: ignore[no-untyped-def]
    # Store the factor across the ray; the one along it is evaluated per position.
    q = _nine(integral.across, t)
    work[lane + Q0] = q
    work[lane + HALF] = half
    # Half of the line integral, from the middle to the far end.
    middle = half * (q * _nine(integral.along, t) - np.float32(integral.edge_value))
    return -middle, middle + middle


@plays(record_ray, TabulatedIntegral)
def _record_by_table(integral, work, lane, t, half):  # type: ignore[no-untyped-def]  # noqa: ARG001
    # Store the row of the table, between two lines of it.
    steps, table = integral.steps, integral.part
    row = (np.float32(1.0) - t) * np.float32(steps)
    work[lane + ROW] = row
    work[lane + HALF] = np.float32(1.0)
    # Interpolate the integral up to the last position.
    line = min(np.uint32(row), np.uint32(steps - 1))
    last = (line + np.uint32(1)) * np.uint32(steps + 1) - np.uint32(1)
    upper, lower = table[last], table[last + np.uint32(steps + 1)]
    return np.float32(0.0), upper + (row - np.float32(line)) * (lower - upper)


@plays(up_to, Smooth)
def _up_to_by_formula(integral, work, lane, x):  # type: ignore[no-untyped-def]  # noqa: ARG001
    # Sum over even powers of x, by Estrin's scheme.
    y = x * x
    y2 = y * y
    y4 = y2 * y2
    low = (work[lane + Q0] + y * work[lane + Q1]) + y2 * (work[lane + Q2] + y * work[lane + Q3])
    high = (work[lane + Q4] + y * work[lane + Q5]) + y2 * (work[lane + Q6] + y * work[lane + Q7])
    return x * (low + y4 * (high + y4 * work[lane + Q8]))


@plays(up_to, Product)
def _up_to_by_product(integral, work, lane, x):  # type: ignore[no-untyped-def]
    return x * (work[lane + Q0] * _nine(integral.along, x * x) - np.float32(integral.edge_value))


@plays(up_to, TabulatedIntegral)
def _up_to_by_table(integral, work, lane, x):  # type: ignore[no-untyped-def]
    # Locate the cell of the table.
    table, steps, row = integral.part, integral.steps, work[lane + ROW]
    line = min(np.uint32(row), np.uint32(steps - 1))
    place = (x + np.float32(1.0)) * np.float32(0.5 * steps)
    column = min(np.uint32(place), np.uint32(steps - 1))
    # Interpolate along positions, then across distances.
    down, right = row - np.float32(line), place - np.float32(column)
    above = line * np.uint32(steps + 1) + column
    below = above + np.uint32(steps + 1)
    upper = table[above] + right * (table[above + np.uint32(1)] - table[above])
    lower = table[below] + right * (table[below + np.uint32(1)] - table[below])
    return upper + down * (lower - upper)
