"""The sub-pixels of a tile as rows of numbers, on which splats are painted eight at a time.

A row holds nine numbers of each of its sub-pixels: all the first ones, then all the second ones,
and so on. As these lie at fixed distances, a compiler sees that they do not meet, and works on
eight sub-pixels at once. Rows are addressed by unsigned numbers, whose sign need not be looked at.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.kernels.canvas import Home
from resample.kernels.jit import kernel, lane_kernel
from resample.kernels.lookup import absorbed
from resample.kernels.over import VISIBLE
from resample.kernels.splats import cut_integral, seen_span
from resample.types import Doubles, Ellipsoid, Film, Floats, Place, Profile, Single, View

LANES = 8
MOST_COLUMNS = 200  # sub-pixels in a row of a tile with the margins of its filter
_STRIDE = MOST_COLUMNS + LANES  # what is painted may run over the end
RED, GREEN, BLUE, ALPHA, DEPTH, WEIGHT, FIRST, RAY, CHORD = (
    np.uint64(number * _STRIDE) for number in range(9)
)
ROW = np.uint64(9 * _STRIDE)

# expm1(x) / x - 1 over -1..0 by powers of x: least squares, within 1e-7.
_X = -np.linspace(1e-3, 1.0, 2000)
_SERIES = np.linalg.lstsq(_X[:, None] ** np.arange(1, 6), np.expm1(_X) / _X - 1.0, rcond=None)[0]
E1, E2, E3, E4, E5 = (np.float32(power) for power in _SERIES)
DEEPEST = np.float32(-16.0)  # optical depth, negated, at which nothing passes
PER_DEEPEST = np.float32(1.0 / 16.0)

Groups = NDArray[np.uint32]  # (h,) per row, a bit for every eight columns


class Splat(NamedTuple):
    """A splat's quadratic form, extinction and light, as in `FOOTPRINT`."""

    a: Single
    b: Single
    c: Single
    extinction: Single
    red: Single
    green: Single
    blue: Single
    depth: Single


class Span(NamedTuple):
    """Sub-pixels that a splat may touch, and where their centers lie from its own."""

    top: int
    bottom: int  # one past the last
    left: int
    right: int  # one past the last
    across: Single  # px from the splat's center to that of column 0
    down: Single  # px from the splat's center to that of row 0
    step: Single  # px between sub-pixels


class Limits(NamedTuple):
    """What all splats of a tile share."""

    opaque: Single  # transmittance below which nothing is painted
    per_layer: Single  # coverage of a line integral of 1
    widest: Single  # value of the quadratic form beyond which nothing is touched


@kernel
def new_rows(height: int, width: int) -> Floats:
    """Empty sub-pixels."""
    rows = np.empty(height * int(ROW), np.float32)
    zero, far = np.float32(0.0), np.float32(np.inf)
    for row in range(height):
        base = np.uint64(row) * ROW
        for column in range(width + LANES):
            k = base + np.uint64(column)
            rows[k + RED] = zero
            rows[k + GREEN] = zero
            rows[k + BLUE] = zero
            rows[k + ALPHA] = zero
            rows[k + DEPTH] = zero
            rows[k + WEIGHT] = zero
            rows[k + FIRST] = far
            rows[k + RAY] = zero
            rows[k + CHORD] = zero
    return rows


@kernel
def cast_rays_of_rows(
    rows: Floats, height: int, width: int, place: Place, view: View, ellipsoid: Ellipsoid
) -> Single:
    """Per sub-pixel, what the exact footprints of all samples share; gives the least 1 / |w|²."""
    n, unit, least = place.subpixels, ellipsoid.to_unit, np.float32(np.inf)
    for row in range(height):
        base = np.uint64(row) * ROW
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(width):
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            if not view.perspective:
                x, y = 0.0, 0.0
            squared = 0.0
            for axis in range(3):
                across = unit[axis, 0] * x + unit[axis, 1] * y + unit[axis, 2]
                squared += across * across
            k = base + np.uint64(column)
            rows[k + RAY] = 1.0 / squared
            rows[k + CHORD] = ellipsoid.scale * math.sqrt((1.0 + x * x + y * y) / squared)
            least = min(least, rows[k + RAY])
    return least


@kernel
def groups_between(left: int, right: int) -> np.uint32:
    """Bits of the eights of columns that meet those from `left` to before `right`."""
    first, last = np.uint64(left // LANES), np.uint64((right - 1) // LANES)
    return np.uint32((np.uint64(2) << last) - (np.uint64(1) << first))


@kernel
def narrowed(splat: Splat, span: Span, dy: Single, widest: Single) -> tuple[int, int]:
    """First column of a row that the splat may touch, and one past the last."""
    a, b = float(splat.a), float(splat.b) * dy
    inside = b * b - a * (float(splat.c) * dy * dy - widest)
    if inside <= 0.0:
        return span.right, span.right
    half, middle = math.sqrt(inside), -b
    per_column = 1.0 / (a * span.step)
    shift = float(span.across) / span.step
    first = math.floor((middle - half) * per_column - shift)
    last = math.ceil((middle + half) * per_column - shift) + 1
    return max(span.left, int(first)), min(span.right, int(last))


@lane_kernel
def paint_splat_on_rows(
    rows: Floats,
    open_groups: Groups,
    splat: Splat,
    span: Span,
    profile: Profile,
    limits: Limits,
    is_thin: bool,
) -> None:
    """Composite a splat of exact footprint; `is_thin`: none of its optical depths exceeds 1."""
    zero, one, two = np.float32(0.0), np.float32(1.0), np.float32(2.0)
    a, b, c, extinction, red, green, blue, depth = splat
    opaque, per_layer, widest = limits
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = profile
    left, right, step = span.left, span.right, span.step
    under, is_wide, visible = groups_between(left, right), right - left > LANES, np.float32(VISIBLE)
    for row in range(span.top, span.bottom):
        if open_groups[row] & under == np.uint32(0):
            continue
        dy = span.down + np.float32(row) * step
        if is_wide:
            left, right = narrowed(splat, span, dy, widest)
        cross, rest = two * b * dy, c * dy * dy
        base = np.uint64(row) * ROW
        for start in range(left, right, LANES):
            eight = base + np.uint64(start)
            dx_start = span.across + np.float32(start) * step
            for lane in range(LANES):
                k = eight + np.uint64(lane)
                dx = dx_start + np.float32(lane) * step
                t = max(zero, one - ((a * dx + cross) * dx + rest) * rows[k + RAY])
                t2 = t * t
                t4 = t2 * t2
                shape = (p0 + t * p1) + t2 * (p2 + t * p3)
                shape += t4 * ((p4 + t * p5) + t2 * (p6 + t * p7)) + t4 * (t4 * p8)
                integral = max(zero, rows[k + CHORD] * shape * math.sqrt(t))
                x = -integral * extinction
                if not is_thin:
                    x = max(DEEPEST, x) * PER_DEEPEST
                x2 = x * x
                fall = x * ((one + x * E1) + x2 * ((E2 + x * E3) + x2 * (E4 + x * E5)))
                if not is_thin:  # expm1(2x) = expm1(x) (expm1(x) + 2), to 16 x
                    fall *= fall + two
                    fall *= fall + two
                    fall *= fall + two
                    fall *= fall + two
                alpha = rows[k + ALPHA]
                before = one - alpha
                share = -fall * before if before > opaque else zero
                after = alpha + share
                rows[k + RED] += share * red
                rows[k + GREEN] += share * green
                rows[k + BLUE] += share * blue
                rows[k + ALPHA] = after
                rows[k + DEPTH] += share * depth
                rows[k + WEIGHT] += integral * per_layer if before > opaque else zero
                first = rows[k + FIRST]
                rows[k + FIRST] = depth if (first == np.inf) & (after > visible) else first


@kernel
def paint_cut_splat_on_rows(
    rows: Floats,
    splat: Splat,
    span: Span,
    place: Place,
    view: View,
    ellipsoid: Ellipsoid,
    planes: Doubles,
    partial: Floats,
    limits: Limits,
) -> None:
    """Composite what is seen of a sphere that a plane cuts; its form is its center."""
    n, one, center = place.subpixels, np.float32(1.0), (splat.a, splat.b, splat.c)
    for row in range(span.top, span.bottom):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        base = np.uint64(row) * ROW
        for column in range(span.left, span.right):
            k = base + np.uint64(column)
            before = one - rows[k + ALPHA]
            if before <= limits.opaque:
                continue
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            seen = seen_span(x, y, view, planes)
            integral = np.float32(cut_integral(center, x, y, seen, view, ellipsoid, partial))
            if integral <= np.float32(0.0):
                continue
            share = before * absorbed(splat.extinction * integral)
            rows[k + RED] += share * splat.red
            rows[k + GREEN] += share * splat.green
            rows[k + BLUE] += share * splat.blue
            rows[k + ALPHA] += share
            rows[k + DEPTH] += share * splat.depth
            rows[k + WEIGHT] += integral * limits.per_layer
            if rows[k + FIRST] == np.inf and rows[k + ALPHA] > np.float32(VISIBLE):
                rows[k + FIRST] = splat.depth


@kernel
def open_rows(height: int, width: int) -> Groups:
    """All groups of columns open."""
    return np.full(height, groups_between(0, width), np.uint32)


@kernel
def close_rows(open_groups: Groups, rows: Floats, width: int, opaque: Single) -> bool:
    """Clear the bits of groups that are opaque by now; gives whether others are left."""
    one, left_open = np.float32(1.0), np.uint32(0)
    for row in range(open_groups.size):
        bits = open_groups[row]
        if bits == np.uint32(0):
            continue
        base = np.uint64(row) * ROW + ALPHA
        for start in range(0, width, LANES):
            bit = np.uint32(1) << np.uint32(start // LANES)
            if bits & bit:
                column, end = start, min(start + LANES, width)
                while column < end and one - rows[base + np.uint64(column)] <= opaque:
                    column += 1
                if column == end:
                    bits ^= bit
        open_groups[row] = bits
        left_open |= bits
    return bool(left_open != np.uint32(0))


@kernel
def is_open(open_groups: Groups, top: int, bottom: int, left: int, right: int) -> bool:
    """Whether a rectangle of sub-pixels may hold some that are not opaque."""
    found = np.uint32(0)
    for row in range(top, bottom):
        found |= open_groups[row]
    return bool(found & groups_between(left, right) != np.uint32(0))


@kernel
def resolve_rows(rows: Floats, n: int, weight: Floats, home: Home, film: Film) -> None:
    """Filter the sub-pixels of a tile to its pixels of a film (H, W)."""
    height, width = film.depth.shape
    one, zero = np.float32(1.0), np.float32(0.0)
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    for row in range(home.top, min(home.top + home.size, height)):
        for column in range(home.left, min(home.left + home.size, width)):
            red = green = blue = alpha = far = cover = zero
            first = np.float32(np.inf)
            for down in range(weight.size):
                base = np.uint64((row - home.top) * n + down) * ROW
                for right in range(weight.size):
                    k = base + np.uint64((column - home.left) * n + right)
                    share = weight[down] * weight[right]
                    red += share * rows[k + RED]
                    green += share * rows[k + GREEN]
                    blue += share * rows[k + BLUE]
                    alpha += share * rows[k + ALPHA]
                    far += share * rows[k + DEPTH]
                    cover += share * max(rows[k + ALPHA], min(one, rows[k + WEIGHT]))
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, rows[k + FIRST])
            film.rgba[row, column, 0] = max(zero, red)
            film.rgba[row, column, 1] = max(zero, green)
            film.rgba[row, column, 2] = max(zero, blue)
            film.rgba[row, column, 3] = min(one, max(zero, alpha))
            if alpha > zero:
                film.depth[row, column] = far / alpha
            film.first_depth[row, column] = first
            film.coverage[row, column] = min(one, max(zero, cover))
