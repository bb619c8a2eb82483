"""Adaptive sampling: sub-pixels are interpolated where their surroundings change evenly.

Two lines of four sub-pixels cross at one, two before it and two behind. If neither line bends and
both agree in the middle, the sub-pixel lies on the cubics through them (Akimoto, Mase and Suenaga,
Pixel-Selected Ray Tracing, 1991, with third differences for first ones: a slope is no edge).
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel
from resample.types import Floats

# Positions of a sub-pixel's numbers; the first three are red, green and blue.
ALPHA, DEEP, FIRST, COVER, VALUE, PRESENCE = range(3, 9)
NUMBERS = 9  # per sub-pixel
# Weights of a cubic's middle for the nearer and the farther samples of two lines.
NEAR, FAR, THREE = np.float32(9 / 32), np.float32(1 / 32), np.float32(3.0)


class Evenness(NamedTuple):
    """Tolerance for bends where sub-pixels are interpolated."""

    bend: float  # of colors, absolute
    share: float  # of colors, relative to the largest nearby
    value: float  # data units


Line = tuple[int, int, int, int, int, int, int, int]  # rows and columns of four sub-pixels


@inner_kernel
def line_through(row: int, column: int, down: int, right: int) -> Line:
    """Sub-pixels at -3, -1, 1 and 3 steps of (down, right) from a position."""
    return (
        row - 3 * down, column - 3 * right, row - down, column - right,
        row + down, column + right, row + 3 * down, column + 3 * right,
    )  # fmt: skip


@inner_kernel
def _is_even(fine: Floats, one: Line, two: Line, number: int, even: Evenness) -> bool:
    """Whether one number is even along two lines, and both predict the same in the middle."""
    # Load the eight samples.
    a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
    c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
    e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
    g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
    # Set the tolerance: absolute, and relative to the nearer samples.
    most = max(abs(b), abs(c), abs(f), abs(g))
    slack = even.value if number == VALUE else even.bend + even.share * most
    # Compare what both lines predict in the middle.
    twist = abs(NEAR * (b + c - f - g) - FAR * (a + d - e - h))
    # Compare third differences; NaN compares as uneven.
    return bool(
        abs(a - d + THREE * (c - b)) <= slack
        and abs(e - h + THREE * (g - f)) <= slack
        and twist <= slack
    )


@inner_kernel
def is_even(fine: Floats, one: Line, two: Line, even: Evenness) -> bool:
    """Whether color, opacity, value and presence are even along two lines."""
    for number in (0, 1, 2, ALPHA, VALUE, PRESENCE):
        if not _is_even(fine, one, two, number, even):
            return False
    return True


@inner_kernel
def fill(fine: Floats, one: Line, two: Line, here: Floats) -> None:
    """Interpolate a sub-pixel from two lines, clamped to the samples on them."""
    for number in range(NUMBERS):
        a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
        c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
        e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
        g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
        # A nearest depth is not interpolated: take the least of the nearer four.
        if number == FIRST:
            here[number] = min(b, c, f, g)
            continue
        # Average the cubics of both lines, and clamp overshoot.
        between = NEAR * (b + c + f + g) - FAR * (a + d + e + h)
        least, most = min(a, b, c, d, e, f, g, h), max(a, b, c, d, e, f, g, h)
        here[number] = min(most, max(least, between))
