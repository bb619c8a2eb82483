"""Forms of ellipses on the screen.

A circle around a sample is taken to the screen by the Jacobian J, whose columns are (xu, yu) and
(xv, yv). Its image is the form V; with d the way from its center, q = dᵀ V⁻¹ d is the squared
distance in units of V. In a row of pixels dy below the center q is least, dy² / V_yy, at slope × dy
to the right of it, and grows from there as curve × the square of the distance.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.types import Single


class Ellipse(NamedTuple):
    """A form V, ready to be scanned row by row."""

    wide: Single  # V_xx, px²
    high: Single  # V_yy, px²
    slope: Single  # V_xy / V_yy, px to the right per px downward
    curve: Single  # V_yy / det V, px⁻²


@kernel
def blurred_ellipse(
    along_u: tuple[Single, Single],
    along_v: tuple[Single, Single],
    area: Single,
    variance: Single,
    filter_variance: Single,
) -> tuple[Ellipse, Single]:
    """Form `variance` J Jᵀ + `filter_variance` of a circle under a filter, and det V.

    `area` is |det J|; `variance` is in the sample's units, `filter_variance` in px².
    """
    xu, yu = along_u
    xv, yv = along_v
    across, down = xu * xu + xv * xv, yu * yu + yv * yv
    wide, high = variance * across + filter_variance, variance * down + filter_variance
    # det V without the difference of two large numbers that long, thin ellipses would make it.
    rest = filter_variance * (variance * (across + down) + filter_variance)
    both = variance * area * (variance * area) + rest
    return Ellipse(wide, high, variance * (xu * yu + xv * yv) / high, high / both), both


@kernel
def longest_stretch(along_u: tuple[Single, Single], along_v: tuple[Single, Single]) -> Single:
    """Largest singular value of J."""
    half, two = np.float32(0.5), np.float32(2)
    xu, yu = along_u
    xv, yv = along_v
    across, down = xu * xu + xv * xv, yu * yu + yv * yv
    odd, twist = xu * xu + yu * yu - xv * xv - yv * yv, two * (xu * xv + yu * yv)
    return math.sqrt(half * (across + down + math.sqrt(odd * odd + twist * twist)))
