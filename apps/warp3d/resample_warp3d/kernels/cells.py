"""A cell of a sheet on the screen: its shape, its nearness as a plane, and its colors inside.

Everything in float32, so that nothing is converted on the way.
"""

import numpy as np

from resample.kernels.jit import kernel
from resample.types import Floats, Single
from resample_warp3d.kernels.screen import Corner, Indices
from resample_warp3d.types import DOWN, INNER, LEFT, RIGHT, UP, Links

Shape = tuple[
    Single, Single, Single, Single, Single, Single, Single, Single, Single, Single, Single, Single
]
Plane = tuple[Single, Single, Single, Single, Single, Single, Single, Single]
Bend = tuple[Single, Single]

ZERO: Single = np.float32(0)
QUARTER: Single = np.float32(0.25)
HALF: Single = np.float32(0.5)
ONE: Single = np.float32(1)
STEEP: Single = np.float32(0.05)  # of the nearness: a surface's most change per px that is heeded
LARGEST: Single = np.float32(4096)  # px: a longer cell is before the eye, not in the picture
SMALLEST: Single = np.float32(1e-9)  # px²: a cell seen edge-on covers nothing
SIDE_OUTER: Single = np.float32(1 / 12)
SIDE_INNER: Single = np.float32(7 / 12)


@kernel
def corners_of(
    screen: Floats, torn: Floats, index: Indices, row: int, column: int
) -> tuple[bool, Corner, Corner, Corner, Corner]:
    """Whether there is a cell, and its corners: top left, top right, bottom left, bottom right."""
    n = index[row, column]
    if n >= 0:
        p = torn[n, 0, 0], torn[n, 0, 1], torn[n, 0, 2]
        q = torn[n, 1, 0], torn[n, 1, 1], torn[n, 1, 2]
        r = torn[n, 2, 0], torn[n, 2, 1], torn[n, 2, 2]
        s = torn[n, 3, 0], torn[n, 3, 1], torn[n, 3, 2]
    else:
        below, right = row + 1, column + 1
        p = screen[row, column, 0], screen[row, column, 1], screen[row, column, 2]
        q = screen[row, right, 0], screen[row, right, 1], screen[row, right, 2]
        r = screen[below, column, 0], screen[below, column, 1], screen[below, column, 2]
        s = screen[below, right, 0], screen[below, right, 1], screen[below, right, 2]
    is_there = n > -2 and min(p[2], q[2], r[2], s[2]) > ZERO
    return is_there, p, q, r, s


@kernel
def floor_of(number: Single) -> int:
    """Floor of a number that fits; `math.floor` of a float32 is a call of a function."""
    whole = int(number)
    return whole - int(number < np.float32(whole))


@kernel
def extent_of(
    p: Corner, q: Corner, r: Corner, s: Corner, first: int, last: int, width: int
) -> tuple[int, int, int, int]:
    """Pixels of rows first..last − 1 that a cell may meet: left, top, right, bottom (excluded)."""
    left = max(0, floor_of(min(p[0], q[0], r[0], s[0])))
    right = min(width, floor_of(max(p[0], q[0], r[0], s[0])) + 1)
    top = max(first, floor_of(min(p[1], q[1], r[1], s[1])))
    bottom = min(last, floor_of(max(p[1], q[1], r[1], s[1])) + 1)
    return left, top, right, bottom


@kernel
def is_worth_painting(p: Corner, q: Corner, r: Corner, s: Corner, orientation: Single) -> bool:
    """Whether a cell shows its front, and is neither edge-on nor larger than any picture."""
    covered = orientation * area_of(p, q, r, s)
    across = max(abs(s[0] - p[0]), abs(s[1] - p[1]), abs(r[0] - q[0]), abs(r[1] - q[1]))
    return bool(covered > SMALLEST and not across > LARGEST)


@kernel
def shape_of(p: Corner, q: Corner, r: Corner, s: Corner) -> Shape:
    """Place, sides and twist of a cell: x, y and nearness of each.

    A point of it is place + u side_u + v side_v + u v twist with u, v in −1/2..1/2.
    """
    return (
        QUARTER * (p[0] + q[0] + r[0] + s[0]),
        QUARTER * (p[1] + q[1] + r[1] + s[1]),
        QUARTER * (p[2] + q[2] + r[2] + s[2]),
        HALF * (q[0] - p[0] + s[0] - r[0]),
        HALF * (q[1] - p[1] + s[1] - r[1]),
        HALF * (q[2] - p[2] + s[2] - r[2]),
        HALF * (r[0] - p[0] + s[0] - q[0]),
        HALF * (r[1] - p[1] + s[1] - q[1]),
        HALF * (r[2] - p[2] + s[2] - q[2]),
        p[0] - q[0] - r[0] + s[0],
        p[1] - q[1] - r[1] + s[1],
        p[2] - q[2] - r[2] + s[2],
    )


@kernel
def area_of(p: Corner, q: Corner, r: Corner, s: Corner) -> Single:
    """Px² that a cell covers; negative where its corners run the other way round."""
    return HALF * ((s[0] - p[0]) * (r[1] - q[1]) - (s[1] - p[1]) * (r[0] - q[0]))


@kernel
def plane_of(p: Corner, q: Corner, r: Corner, s: Corner) -> Plane:
    """A cell's nearness as a plane over the screen, its limits, and how much it may err.

    Place x, y, nearness there, its slopes, least and most, and a tolerance.
    """
    x, y, near, ax, ay, an, bx, by, bn, _, _, _ = shape_of(p, q, r, s)
    inverse = ONE / (ax * by - ay * bx)
    slope_x, slope_y = (an * by - bn * ay) * inverse, (bn * ax - an * bx) * inverse
    most = STEEP * near
    slack = min(HALF * (abs(slope_x) + abs(slope_y)), most)
    slope_x = min(max(slope_x, -most), most)
    slope_y = min(max(slope_y, -most), most)
    least = min(p[2], q[2], r[2], s[2])
    greatest = max(p[2], q[2], r[2], s[2])
    return x, y, near, slope_x, slope_y, least, greatest, slack


@kernel
def nearness_at(plane: Plane, column: int, row: int) -> Single:
    """Nearness of a cell's plane over a pixel's center, within the cell's own limits."""
    x, y = np.float32(column) + HALF - plane[0], np.float32(row) + HALF - plane[1]
    return min(max(plane[2] + plane[3] * x + plane[4] * y, plane[5]), plane[6])


@kernel
def _bend_of(
    color: Floats, links: Links, group: int, row: int, column: int, c: int, down: bool
) -> Bend:
    """Slope and curvature of a channel inside a sample's pixel along an axis, keeping its mean.

    A parabola through the values at the pixel's sides, which are (7 (a + b) − (z + c)) / 12 of the
    four samples around a side (Colella and Woodward 1984, the piecewise parabolic method).
    """
    dr, dc = (1, 0) if down else (0, 1)
    ahead, back = (DOWN, UP) if down else (RIGHT, LEFT)
    bits = links[row, column]
    here = color[group, row, column, c]
    is_ahead, is_back = bits & ahead != 0, bits & back != 0
    if is_ahead and is_back:
        before = color[group, row - dr, column - dc, c]
        after = color[group, row + dr, column + dc, c]
        first, last = before + before - here, after + after - here
        if links[row - dr, column - dc] & back:
            first = color[group, row - 2 * dr, column - 2 * dc, c]
        if links[row + dr, column + dc] & ahead:
            last = color[group, row + 2 * dr, column + 2 * dc, c]
        low = SIDE_INNER * (before + here) - SIDE_OUTER * (first + after)
        high = SIDE_INNER * (here + after) - SIDE_OUTER * (before + last)
        return high - low, np.float32(3) * (low + high) - np.float32(6) * here
    if is_ahead:
        return HALF * (color[group, row + dr, column + dc, c] - here), ZERO
    if is_back:
        return HALF * (here - color[group, row - dr, column - dc, c]), ZERO
    return ZERO, ZERO


@kernel
def _inner_bend(z: Single, a: Single, here: Single, b: Single, c: Single) -> Bend:
    """Slope and curvature of the middle of five samples, as of `_bend_of`."""
    slope = np.float32(2 / 3) * (b - a) - SIDE_OUTER * (c - z)
    return slope, np.float32(1.5) * (a + b) - QUARTER * (z + c) - np.float32(2.5) * here


@kernel
def _inner_bends(
    color: Floats, group: int, row: int, column: int, c: int
) -> tuple[Bend, Bend, Single]:
    """Slopes and curvatures of a channel along both axes, and its twist, away from tears."""
    here = color[group, row, column, c]
    along = _inner_bend(
        color[group, row, column - 2, c], color[group, row, column - 1, c], here,
        color[group, row, column + 1, c], color[group, row, column + 2, c],
    )  # fmt: skip
    across = _inner_bend(
        color[group, row - 2, column, c], color[group, row - 1, column, c], here,
        color[group, row + 1, column, c], color[group, row + 2, column, c],
    )  # fmt: skip
    above = color[group, row - 1, column + 1, c] - color[group, row - 1, column - 1, c]
    below = color[group, row + 1, column + 1, c] - color[group, row + 1, column - 1, c]
    return along, across, QUARTER * (below - above)


@kernel
def bends_of(
    color: Floats, links: Links, group: int, row: int, column: int, c: int
) -> tuple[Bend, Bend, Single]:
    """Slopes and curvatures of a channel along both axes, and its twist."""
    if links[row, column] & INNER:
        return _inner_bends(color, group, row, column, c)
    return (
        _bend_of(color, links, group, row, column, c, False),
        _bend_of(color, links, group, row, column, c, True),
        _twist_of(color, links, group, row, column, c),
    )


@kernel
def _twist_of(color: Floats, links: Links, group: int, row: int, column: int, c: int) -> Single:
    """How a channel's slope along a row changes down the columns; 0 near tears."""
    sideways = LEFT | RIGHT
    if links[row, column] & (sideways | UP | DOWN) != (sideways | UP | DOWN):
        return ZERO
    if links[row - 1, column] & sideways != sideways:
        return ZERO
    if links[row + 1, column] & sideways != sideways:
        return ZERO
    above = color[group, row - 1, column + 1, c] - color[group, row - 1, column - 1, c]
    below = color[group, row + 1, column + 1, c] - color[group, row + 1, column - 1, c]
    return QUARTER * (below - above)


@kernel
def range_of(
    color: Floats, links: Links, group: int, row: int, column: int, c: int
) -> tuple[Single, Single]:
    """Least and greatest value of a channel in a sample and its neighbours on the surface.

    A parabola between them that goes further is a ripple, which no surface has.
    """
    bits = links[row, column]
    here = color[group, row, column, c]
    right = color[group, row, column + 1, c] if bits & RIGHT else here
    left = color[group, row, column - 1, c] if bits & LEFT else here
    below = color[group, row + 1, column, c] if bits & DOWN else here
    above = color[group, row - 1, column, c] if bits & UP else here
    return min(here, right, left, below, above), max(here, right, left, below, above)


@kernel
def within(value: Single, limits: tuple[Single, Single]) -> Single:
    """Value, or the limit that it exceeds."""
    return min(max(value, limits[0]), limits[1])


@kernel
def value_at(
    u: Single, v: Single, mean: Single, along: Bend, across: Bend, twist: Single
) -> Single:
    """A channel at a place u, v in −1/2..1/2 inside a sample's pixel."""
    value = mean + along[0] * u + across[0] * v + twist * u * v
    return value + along[1] * (u * u - SIDE_OUTER) + across[1] * (v * v - SIDE_OUTER)
