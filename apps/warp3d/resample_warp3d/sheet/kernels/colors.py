"""Colors inside samples' pixels: parabolas that keep the mean."""

import numpy as np

from resample.engine.jit import inner_kernel
from resample.types import Floats, Single
from resample_warp3d.sheet.kernels.segments import (
    BEND_U,
    BEND_V,
    CHANNEL,
    HALF,
    HIGH,
    LOW,
    MEAN,
    ONE,
    QUARTER,
    SLOPE_U,
    SLOPE_V,
    TWIST,
    ZERO,
)
from resample_warp3d.types import DOWN, LEFT, MARGIN, RIGHT, TURNS, UP, Links

Five = tuple[Single, Single, Single, Single, Single]
Four = tuple[bool, bool, bool, bool]

MEAN_SQUARE: Single = np.float32(1 / 12)  # of a uniform distribution over −1/2..1/2
SIXTH: Single = np.float32(1 / 6)
STEP: Single = np.float32(2 / 3)  # weight of the inner two of five samples in a slope
FAR_STEP: Single = np.float32(1 / 12)  # weight of the outer two
BEND: Single = np.float32(1.5)  # the same in a bend
BEND_HERE: Single = np.float32(2.5)


@inner_kernel
def _bent(values: Five, is_linked: Four) -> tuple[Single, Single]:
    """Slope and bend of the middle of five samples, by those that are on its surface.

    `is_linked`: links of the nearest on both sides, then of the far ones.
    The parabola passes through the values at the pixel's sides, (7 (a + b) − (z + c)) / 12 of
    the four samples around a side (Colella and Woodward 1984, the piecewise parabolic method).
    """
    far_back, back, here, ahead, far_ahead = values
    is_back, is_ahead, is_far_back, is_far_ahead = is_linked
    # Extrapolate linearly where a far sample is on another surface.
    behind = far_back if is_far_back else back + back - here
    before = far_ahead if is_far_ahead else ahead + ahead - here
    is_between = is_back & is_ahead
    # Fit the parabola, or a line if one of the nearest samples is missing.
    slope = STEP * (ahead - back) - FAR_STEP * (before - behind)
    bend = BEND * (back + ahead) - QUARTER * (behind + before) - BEND_HERE * here
    one_sided = (ahead - here if is_ahead else ZERO) + (here - back if is_back else ZERO)
    return slope if is_between else HALF * one_sided, bend if is_between else ZERO


@inner_kernel
def _turned(
    mean: Single, slope: Single, bend: Single, is_ahead: bool, is_back: bool
) -> tuple[Single, Single, Single]:
    """Mean, slope and bend of a cell with a side where the surface may curve away.

    The cell's outer half shows the last quarter of the sample: what lies at u in −1/2..1/2 of the
    cell is at u + 1/4 − u² of the sample, if it curves away ahead. The slope is one-sided there.
    """
    side = (ONE if is_ahead else ZERO) - (ONE if is_back else ZERO)
    steeper = slope + slope * abs(side)
    return mean + SIXTH * side * steeper, steeper, bend - side * steeper


@inner_kernel
def write_colors(
    color: Floats, links: Links, group: int, row: int, start: int, begin: int, end: int,
    numbers: Floats,
) -> None:  # fmt: skip
    """Write the colors of a run of a segment's samples: coefficients of `color_at`.

    Branch-free for SIMD: values of neighbours on other surfaces are read but not used. A parabola
    that exceeds a sample's neighbours on the surface would ripple, which real surfaces do not:
    hence the limits.
    """
    g, one, two = np.uint64(group), np.uint64(1), np.uint64(2)
    r = np.uint64(row + MARGIN)
    for c in range(3):
        k, at = np.uint64(c), np.uint64(c) * CHANNEL
        # Fit along u.
        for n in range(begin, end):
            m, x = at + np.uint64(n), np.uint64(start + n + MARGIN)
            bits = links[r, x]
            here = color[g, k, r, x]
            left, right = color[g, k, r, x - one], color[g, k, r, x + one]
            above, below = color[g, k, r - one, x], color[g, k, r + one, x]
            numbers[SLOPE_U + m], numbers[BEND_U + m] = _bent(
                (color[g, k, r, x - two], left, here, right, color[g, k, r, x + two]),
                (
                    bits & LEFT != 0, bits & RIGHT != 0,
                    links[r, x - one] & LEFT != 0, links[r, x + one] & RIGHT != 0,
                ),
            )  # fmt: skip
            # Compress the parabola where the surface curves away on the left or right.
            numbers[MEAN + m], numbers[SLOPE_U + m], numbers[BEND_U + m] = _turned(
                here, numbers[SLOPE_U + m], numbers[BEND_U + m],
                bits & (TURNS * RIGHT) != 0, bits & (TURNS * LEFT) != 0,
            )  # fmt: skip
            # Limit colors to the four neighbours' on the surface.
            a = right if bits & RIGHT != 0 else here
            b = left if bits & LEFT != 0 else here
            d = below if bits & DOWN != 0 else here
            e = above if bits & UP != 0 else here
            numbers[LOW + m], numbers[HIGH + m] = min(here, a, b, d, e), max(here, a, b, d, e)
        # Fit along v.
        for n in range(begin, end):
            m, x = at + np.uint64(n), np.uint64(start + n + MARGIN)
            bits, bits_above, bits_below = links[r, x], links[r - one, x], links[r + one, x]
            numbers[SLOPE_V + m], numbers[BEND_V + m] = _bent(
                (
                    color[g, k, r - two, x], color[g, k, r - one, x], color[g, k, r, x],
                    color[g, k, r + one, x], color[g, k, r + two, x],
                ),
                (bits & UP != 0, bits & DOWN != 0, bits_above & UP != 0, bits_below & DOWN != 0),
            )  # fmt: skip
            # Compress the parabola where the surface curves away above or below.
            numbers[MEAN + m], numbers[SLOPE_V + m], numbers[BEND_V + m] = _turned(
                numbers[MEAN + m], numbers[SLOPE_V + m], numbers[BEND_V + m],
                bits & (TURNS * DOWN) != 0, bits & (TURNS * UP) != 0,
            )  # fmt: skip
            # Take the twist from the four diagonal neighbours, if all are on the surface.
            before = color[g, k, r - one, x + one] - color[g, k, r - one, x - one]
            after = color[g, k, r + one, x + one] - color[g, k, r + one, x - one]
            sideways = bits & bits_above & bits_below
            is_whole = (sideways & LEFT != 0) & (sideways & RIGHT != 0)
            is_whole &= (bits & UP != 0) & (bits & DOWN != 0)
            numbers[TWIST + m] = QUARTER * (after - before) if is_whole else ZERO


@inner_kernel
def write_means(
    color: Floats, group: int, row: int, start: int, begin: int, end: int, numbers: Floats
) -> None:
    """Write only the mean colors of a run of a segment's samples."""
    for c in range(3):
        at = MEAN + np.uint64(c) * CHANNEL
        for n in range(begin, end):
            numbers[at + np.uint64(n)] = color[group, c, row + MARGIN, start + n + MARGIN]


@inner_kernel
def color_at(numbers: Floats, m: np.uint64, u: Single, v: Single, uu: Single, vv: Single) -> Single:
    """Evaluate a channel at u, v in −1/2..1/2 of a pixel, or its mean around there.

    `uu` and `vv` are the squares of u and v, or their means, minus 1/12.
    """
    value = numbers[MEAN + m] + numbers[SLOPE_U + m] * u + numbers[SLOPE_V + m] * v
    value += numbers[BEND_U + m] * uu + numbers[BEND_V + m] * vv + numbers[TWIST + m] * (u * v)
    return min(max(value, numbers[LOW + m]), numbers[HIGH + m])
