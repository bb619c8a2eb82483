"""Section 4.2, Figure 4 (left): from the index i in the circle to the ray's distance d.

The affine map of the screen ellipse to a circle gives i = AC / AB. The kernel's table wants the
distance of the ray from the center, d = OD / OF, in radii. With OE = r / sin α, OF = r and
tan β = i AB / AE = i tan α:

    d = OD / OF = (OE / OF) sin β = sin(arctan(i tan α)) / sin α

The paper prints tan α as the divisor, with which the tangent ray i = 1 gets cos α instead of 1.
Without trigonometric functions and without a root, the same is

    d² = i² / (cos² α + i² sin² α)

"For angles outside this range, we simply evaluate the equation": so do we beyond 15 degrees.
"""

import math

import numpy as np

from resample.engine.jit import inner_step
from resample.types import Doubles, Floats, Single

ANGLES, INDICES = 64, 1024  # entries for i as many as the footprint table has
LARGEST = math.radians(15.0)  # α up to which there is a table
PER_ANGLE = np.float32((ANGLES - 1) / LARGEST)
LAST = np.float32(INDICES)
HALF, ONE = np.float32(0.5), np.float32(1.0)
EQUATION = -1  # in place of a row of the table


def true_distance(index: Doubles, alpha: Doubles) -> Doubles:
    """Distance d of a ray from the center of a sphere, in radii, as the equation reads.

    Parameters
    ----------
    index
        Index i of the ray, 0 center, 1 rim.
    alpha
        Half angle of the sphere's tangent cone, rad, above 0 and below π/2.
    """
    return np.asarray(np.sin(np.arctan(index * np.tan(alpha))) / np.sin(alpha), np.float64)


def correction_table() -> Floats:
    """Table (ANGLES, INDICES + 1) of d² over alpha, 0 to 15 degrees, and i², 0 to 1."""
    alpha = np.maximum(np.linspace(0.0, LARGEST, ANGLES), 1e-6)[:, None]
    index = np.sqrt(np.linspace(0.0, 1.0, INDICES + 1))[None, :]
    return (true_distance(index, alpha) ** 2).astype(np.float32)


@inner_step
def row_of(alpha: Single) -> int:
    """Row of the table for an angle within it, the nearest one."""
    return int(alpha * PER_ANGLE + HALF)


@inner_step
def from_table(table: Floats, row: int, squared: Single) -> Single:
    """Value of d² at i², linear between entries."""
    place = squared * LAST
    entry = min(int(place), INDICES - 1)
    k, r = np.uint64(entry), np.uint64(row)
    step = table[r, k + np.uint64(1)] - table[r, k]
    return table[r, k] + (place - np.float32(entry)) * step


@inner_step
def by_equation(squared: Single, sine2: Single) -> Single:
    """Value of d² for i² and sin² α; i² for flat samples, with α 0."""
    return squared / (ONE - sine2 + squared * sine2)
