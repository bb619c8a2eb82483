"""Sub-pixels that need no ray: where those around them change evenly, they lie between them.

Two lines of four sub-pixels lead through one, two before it and two behind. If neither line bends
nor the two disagree, it is on the cubics through them (Akimoto, Mase and Suenaga, Pixel-Selected
Ray Tracing, 1991, with bends for differences: so a slope is no edge).
"""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_kernel
from resample.types import Floats

ALPHA, DEEP, FIRST, COVER, VALUE, PRESENCE = range(3, 9)
NUMBERS = 9  # of a sub-pixel
NEAR, FAR, THREE = np.float32(9 / 32), np.float32(1 / 32), np.float32(3.0)


class Evenness(NamedTuple):
    """What may bend where sub-pixels are spared, and is no edge."""

    bend: float  # of colors
    share: float  # of them, besides
    value: float  # data units


Line = tuple[int, int, int, int, int, int, int, int]  # rows and columns of four sub-pixels


@inner_kernel
def line_through(row: int, column: int, down: int, right: int) -> Line:
    """Sub-pixels three and one such ways before a place, and one and three behind it."""
    return (
        row - 3 * down, column - 3 * right, row - down, column - right,
        row + down, column + right, row + 3 * down, column + 3 * right,
    )  # fmt: skip


@inner_kernel
def _is_even(fine: Floats, one: Line, two: Line, number: int, even: Evenness) -> bool:
    """Whether a number changes evenly along two lines, and to the same in the middle."""
    a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
    c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
    e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
    g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
    most = max(abs(b), abs(c), abs(f), abs(g))
    slack = even.value if number == VALUE else even.bend + even.share * most
    twist = abs(NEAR * (b + c - f - g) - FAR * (a + d - e - h))
    # What is no number is not even.
    return bool(
        abs(a - d + THREE * (c - b)) <= slack
        and abs(e - h + THREE * (g - f)) <= slack
        and twist <= slack
    )


@inner_kernel
def is_even(fine: Floats, one: Line, two: Line, even: Evenness) -> bool:
    """Whether sub-pixels on two lines change evenly."""
    for number in (0, 1, 2, ALPHA, VALUE, PRESENCE):
        if not _is_even(fine, one, two, number, even):
            return False
    return True


@inner_kernel
def fill(fine: Floats, one: Line, two: Line, here: Floats) -> None:
    """Put a sub-pixel where two lines meet, within what is on them."""
    for number in range(NUMBERS):
        a, b = fine[one[0], one[1], number], fine[one[2], one[3], number]
        c, d = fine[one[4], one[5], number], fine[one[6], one[7], number]
        e, f = fine[two[0], two[1], number], fine[two[2], two[3], number]
        g, h = fine[two[4], two[5], number], fine[two[6], two[7], number]
        if number == FIRST:
            here[number] = min(b, c, f, g)
            continue
        between = NEAR * (b + c + f + g) - FAR * (a + d + e + h)
        least, most = min(a, b, c, d, e, f, g, h), max(a, b, c, d, e, f, g, h)
        here[number] = min(most, max(least, between))
