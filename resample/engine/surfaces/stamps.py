"""Ellipses on the screen: their forms, and lines of Gaussians over them, summed in stamps.

A circle around a sample is taken to the screen by the Jacobian J, whose columns are (xu, yu) and
(xv, yv). Its image is the form V; with d the way from its center, q = dᵀ V⁻¹ d is the squared
distance in units of V. In a row of pixels dy below the center q is least, dy² / V_yy, at slope × dy
to the right of it, and grows from there as curve × the square of the distance.

A splat weighs peak × exp(−q / 2) in the centers of pixels, as far as q ≤ `RIM`; sums lie
interleaved, the channels of a pixel and its weight side by side.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.types import Floats, Single

RIM = 11.0  # 3.3 standard deviations; 0.4 % of a Gaussian's mass lies beyond
UNIT = 1.0 / (2.0 * math.pi * (1.0 - math.exp(-0.5 * RIM)))  # peak that gives V = I the mass 1

# Rows of a line of splats: places of their centers, px; how far they reach, px; slope and curve as
# of an `Ellipse`, 1 / V_yy; and their peaks. What has no peak leaves no stamp; MASS is for callers.
X, Y, WIDE, HIGH, SLOPE, CURVE, REST, PEAK, MASS = range(9)
ROWS = 9

# exp(−z) as a polynomial, for 0 ≤ z ≤ RIM / 32; errs by 8e-8 of the value at most.
LAST_Z = np.float32(RIM / 32.0)
C0, C1, C2 = np.float32(0.99999992), np.float32(-0.99998921), np.float32(0.49975581)
C3, C4 = np.float32(-0.16469862), np.float32(0.035043686)

# A splat is weighed in stamps of up to SIDE × SIDE pixels, in one loop over all of them:
# pixel n of a stamp w pixels wide is in column ACROSS[w, n] and row DOWN[w, n].
SIDE = 16  # px
_PIXEL, _WIDTH = np.arange(SIDE * SIDE), np.maximum(np.arange(SIDE + 1), 1)[:, None]
ACROSS = (_PIXEL % _WIDTH).astype(np.float32)
DOWN = (_PIXEL // _WIDTH).astype(np.float32)


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


class Ground(NamedTuple):
    """Pixels that lines of splats are added to."""

    sums: Floats  # flat; channels and weight of each pixel side by side
    start: int  # of the first pixel's
    width: int  # px
    height: int  # px


@kernel
def _bell(z: Single) -> Single:
    """exp(−16 z), for z up to RIM / 32; errs by 3e-6 of the value at most."""
    power = C0 + z * (C1 + z * (C2 + z * (C3 + z * C4)))
    power *= power
    power *= power
    power *= power
    return power * power


@kernel
def _first_pixel(bound: Single) -> int:
    """First pixel whose center is not before a bound."""
    return math.ceil(float(max(bound - np.float32(0.5), np.float32(0))))


@kernel
def _last_pixel(bound: Single, size: int) -> int:
    """One past the last of `size` pixels whose center is not after a bound."""
    return math.floor(float(min(bound + np.float32(0.5), np.float32(size))))


@kernel
def _weigh(
    weight: Floats, count: int, width: int, x: Single, y: Single, line: Floats, splat: int
) -> None:
    """Weights of the `count` pixels of a stamp whose first center is at (x, y) from a splat's."""
    scale = np.float32(1.0 / 32.0)
    slope, peak = line[SLOPE, splat], line[PEAK, splat]
    curve, rest = line[CURVE, splat] * scale, line[REST, splat] * scale
    for n in range(count):
        m = np.uint64(n)
        below = y + DOWN[width, m]
        across = x + ACROSS[width, m] - slope * below
        z = curve * across * across + rest * below * below
        full = peak * _bell(min(z, LAST_Z))
        weight[m] = full if z <= LAST_Z else np.float32(0)


@kernel
def _add_stamp(
    sums: Floats,
    at: int,
    stride: int,
    weight: Floats,
    size: tuple[int, int],
    values: Floats,
    n: int,
) -> None:
    """Add a stamp of weights to the pixels from `at` on."""
    width, height = size
    lanes = values.shape[0] + 1
    from_weight = np.uint64(0)
    if lanes == 2:
        value = values[0, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                sums[to + m + m] += share * value
                sums[to + m + m + np.uint64(1)] += share
            from_weight += np.uint64(width)
    else:
        red, green, blue = values[0, n], values[1, n], values[2, n]
        for row in range(height):
            to = np.uint64(at + row * stride)
            for column in range(width):
                m = np.uint64(column)
                share = weight[from_weight + m]
                i = to + np.uint64(4) * m
                j, k, o = i + np.uint64(1), i + np.uint64(2), i + np.uint64(3)
                sums[i] += share * red
                sums[j] += share * green
                sums[k] += share * blue
                sums[o] += share
            from_weight += np.uint64(width)


@kernel
def _columns(line: Floats, n: int, dy: Single, rows: int, left: int, right: int) -> tuple[int, int]:
    """First and last + 1 of the columns that a splat may meet in some rows from `dy` below it."""
    half = math.sqrt(np.float32(RIM) / line[CURVE, n])
    first = line[X, n] + line[SLOPE, n] * dy
    last = first + line[SLOPE, n] * np.float32(rows - 1)
    return (
        max(left, _first_pixel(min(first, last) - half)),
        _last_pixel(max(first, last) + half, right),
    )


@kernel
def add_splats(ground: Ground, values: Floats, line: Floats, count: int, weight: Floats) -> None:
    """Add a line of splats to pixels.

    `values`: (1 or 3, N). `line`: (ROWS, N) of which `count` are added. `weight`: (SIDE²,) of
    numbers to work with.
    """
    sums, start, width, height = ground
    lanes = values.shape[0] + 1
    half = np.float32(0.5)
    for n in range(count):
        if not line[PEAK, n] > np.float32(0):
            continue
        x, y = line[X, n], line[Y, n]
        leftmost = _first_pixel(x - line[WIDE, n])
        rightmost = _last_pixel(x + line[WIDE, n], width)
        last = _last_pixel(y + line[HIGH, n], height)
        for top in range(_first_pixel(y - line[HIGH, n]), last, SIDE):
            bottom = min(top + SIDE, last)
            dy = np.float32(top) + half - y
            left, right = leftmost, rightmost
            if right - left > SIDE:
                left, right = _columns(line, n, dy, bottom - top, left, right)
            for column in range(left, right, SIDE):
                wide, high = min(SIDE, right - column), bottom - top
                _weigh(weight, wide * high, wide, np.float32(column) + half - x, dy, line, n)
                at = start + (top * width + column) * lanes
                _add_stamp(sums, at, width * lanes, weight, (wide, high), values, n)
