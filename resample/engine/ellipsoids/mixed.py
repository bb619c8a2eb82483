"""Splats of any model, kernel and opacity on rows of sub-pixels, sixteen sub-pixels at a time.

As `resample.engine.ellipsoids.rows`, with more numbers for each splat, and a formula in two pieces
that kernels with knots have as well. Where none fits, a table is read for one sub-pixel at a time.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.ellipsoids.outlines import (
    ACROSS,
    AMPLITUDE,
    BENT,
    BOTTOM,
    CUT,
    DOWN,
    EXTINCTION,
    FLAT,
    HOME,
    LEFT,
    RIGHT,
    TOP,
    A,
    B,
    C,
)
from resample.engine.ellipsoids.outlines import BLUE as LIT_BLUE
from resample.engine.ellipsoids.outlines import DEPTH as FAR
from resample.engine.ellipsoids.outlines import GREEN as LIT_GREEN
from resample.engine.ellipsoids.outlines import RED as LIT_RED
from resample.engine.ellipsoids.rows import (
    CHORD,
    COLUMNS,
    LANES,
    PAIR,
    PER_DEEPEST,
    RAY,
    Groups,
    Limits,
    Members,
    fall_of,
    groups_between,
    index_of,
    is_open,
    lay_behind,
    line_integral,
    narrowed,
)
from resample.engine.jit import kernel, lane_kernel
from resample.engine.lookup import absorbed, unit_lookup
from resample.engine.over import Light
from resample.types import DISC, EXACT, Floats, Pieces, Profile, Single


class Mixture(NamedTuple):
    """What kernels of all kinds are painted by."""

    profile: Profile  # line integrals, if they fit
    pieces: Pieces  # of more kernels, if they fit
    is_smooth: bool  # the profile fits
    is_fitted: bool  # the pieces fit
    is_bent: bool  # by the model of footprints
    is_linear: bool  # opacity in the line integral
    is_plain: bool  # outlines and paddings tell where samples are painted
    least: float  # px, spacing of samples
    peak: float  # largest line integral, scene units
    layer: float  # scene units, thickness that linear opacities are those of


class Mark(NamedTuple):
    """A splat as numbers that all its sub-pixels share."""

    a: Single
    flat: Single
    bent: Single
    amplitude: Single
    per_integral: Single  # optical depth, negated, or opacity
    is_linear: bool
    is_thin: bool
    is_bent: bool
    light: Light


@kernel
def flatten_rays(rows: Floats, height: int, width: int, model: int) -> None:
    """Let rays have no part in what footprints do not take from them."""
    if model == EXACT:
        return
    for row in range(height):
        for column in range(width):
            k = index_of(row, column)
            rows[k + CHORD] = np.float32(1.0)
            if model != DISC:
                rows[k + RAY] = np.float32(1.0)


@kernel
def mark_of(room: Floats, s: np.uint64, mixture: Mixture) -> Mark:
    """A splat of a batch."""
    extinction = room[s + EXTINCTION]
    is_thin = extinction * mixture.peak <= 1.0
    per_integral = -extinction * (np.float32(1.0) if is_thin else PER_DEEPEST)
    if mixture.is_linear:
        layer = np.float32(mixture.layer)
        per_integral = -absorbed(extinction * layer) / layer
    return Mark(
        room[s + A],
        room[s + FLAT],
        room[s + BENT],
        room[s + AMPLITUDE],
        per_integral,
        mixture.is_linear,
        is_thin,
        mixture.is_bent,
        (room[s + LIT_RED], room[s + LIT_GREEN], room[s + LIT_BLUE], room[s + FAR]),
    )


@lane_kernel
def _squared(u: Single, mark: Mark) -> Single:
    """Squared distance of a ray from a splat's center, from a form that is 1 at the rim."""
    one, inside = np.float32(1.0), max(np.float32(0.0), u)
    if mark.is_bent:
        return inside / (mark.flat + mark.bent * inside) if inside < one else one
    return min(one, inside)


@lane_kernel
def _two(
    is_far: Any, near: Single, next_near: Single, far: Single, next_far: Single, v: Single
) -> Single:
    """Two terms of the polynomial of the piece that a distance lies in."""
    return (far if is_far else near) + v * (next_far if is_far else next_near)


@lane_kernel
def _integral_of_pieces(squared: Single, pieces: Pieces) -> Single:
    """Line integral of the unit kernel."""
    zero, one = np.float32(0.0), np.float32(1.0)
    t = max(zero, one - squared)
    distance = math.sqrt(min(one, squared))
    p, q = pieces
    is_far = distance >= np.float32(0.5)
    v = distance - (np.float32(0.75) if is_far else np.float32(0.25))
    v2 = v * v
    v4 = v2 * v2
    low = _two(is_far, p[0], p[1], q[0], q[1], v) + v2 * _two(is_far, p[2], p[3], q[2], q[3], v)
    high = _two(is_far, p[4], p[5], q[4], q[5], v) + v2 * _two(is_far, p[6], p[7], q[6], q[7], v)
    high += v4 * _two(is_far, p[8], p[9], q[8], q[9], v)
    return max(zero, low + v4 * high) * math.sqrt(t)


@lane_kernel
def _lay(rows: Floats, k: np.uint64, integral: Single, mark: Mark, limits: Limits) -> None:
    """Composite a splat of this line integral behind what a sub-pixel holds."""
    x = max(np.float32(-1.0), integral * mark.per_integral)
    fall = x if mark.is_linear else fall_of(x, mark.is_thin)
    lay_behind(rows, k, fall, integral, mark.light, limits)


@lane_kernel
def _paint_smooth(
    rows: Floats,
    base: np.uint64,
    between: tuple[int, int],
    line: tuple[Single, Single, Single, Single, Single, Single],
    mark: Mark,
    profile: Profile,
    limits: Limits,
) -> None:
    """Like `_paint_eights`, of a kernel that one polynomial fits."""
    across, step, cross, cross_below, rest, rest_below = line
    for start in range(between[0], between[1], COLUMNS):
        first_k = base + np.uint64(2 * start)
        dx_start = across + np.float32(start) * step
        for lane in range(LANES):
            k = first_k + np.uint64(lane)
            dx = dx_start + np.float32(lane >> 1) * step
            is_below = lane & 1 != 0
            form = (mark.a * dx + (cross_below if is_below else cross)) * dx
            form += rest_below if is_below else rest
            squared = _squared(form * rows[k + RAY], mark)
            chord = rows[k + CHORD] * mark.amplitude
            integral = line_integral(squared, np.float32(1.0), chord, profile)
            _lay(rows, k, integral, mark, limits)


@lane_kernel
def _paint_eights(
    rows: Floats,
    base: np.uint64,
    between: tuple[int, int],
    line: tuple[Single, Single, Single, Single, Single, Single],
    mark: Mark,
    pieces: Pieces,
    limits: Limits,
) -> None:
    """Composite a splat on eight columns of two rows at a time."""
    across, step, cross, cross_below, rest, rest_below = line
    for start in range(between[0], between[1], COLUMNS):
        first_k = base + np.uint64(2 * start)
        dx_start = across + np.float32(start) * step
        for lane in range(LANES):
            k = first_k + np.uint64(lane)
            dx = dx_start + np.float32(lane >> 1) * step
            is_below = lane & 1 != 0
            form = (mark.a * dx + (cross_below if is_below else cross)) * dx
            form += rest_below if is_below else rest
            squared = _squared(form * rows[k + RAY], mark)
            integral = rows[k + CHORD] * mark.amplitude * _integral_of_pieces(squared, pieces)
            _lay(rows, k, integral, mark, limits)


@lane_kernel
def _paint_each(
    rows: Floats,
    base: np.uint64,
    between: tuple[int, int],
    line: tuple[Single, Single, Single, Single, Single, Single],
    mark: Mark,
    table: Floats,
    limits: Limits,
) -> None:
    """Composite a splat on columns of two rows, its line integrals from a table."""
    across, step, cross, cross_below, rest, rest_below = line
    for start in range(between[0], between[1]):
        dx = across + np.float32(start) * step
        for below in range(2):
            k = base + np.uint64(2 * start + below)
            form = (mark.a * dx + (cross_below if below == 1 else cross)) * dx
            form += rest_below if below == 1 else rest
            squared = _squared(form * rows[k + RAY], mark)
            integral = max(np.float32(0.0), unit_lookup(table, squared))
            _lay(rows, k, rows[k + CHORD] * mark.amplitude * integral, mark, limits)


@lane_kernel
def paint_models_on_rows(
    rows: Floats,
    open_groups: Groups,
    room: Floats,
    offset: Members,
    step: Single,
    mixture: Mixture,
    table: Floats,
    limits: Limits,
) -> tuple[int, int]:
    """Composite splats up to the first sample that is none, or is cut by a plane.

    Gives how many these are, and how many of those that were painted are at home in the tile. The
    parameters are those of `resample.engine.ellipsoids.rows.paint_splats_on_rows`.
    """
    zero, two, at_home = np.float32(0.0), np.float32(2.0), 0
    for n in range(offset.size):
        s = np.uint64(offset[n])
        if room[s + CUT] > zero:
            return n, at_home
        top, bottom = int(room[s + TOP]), int(room[s + BOTTOM])
        left, right = int(room[s + LEFT]), int(room[s + RIGHT])
        if left >= right or not is_open(open_groups, top, bottom, left, right):
            continue
        at_home += int(room[s + HOME])
        mark, b, c = mark_of(room, s, mixture), room[s + B], room[s + C]
        across, down = room[s + ACROSS], room[s + DOWN]
        under, whole = groups_between(left, right), (left, right)
        for pair in range(top >> 1, (bottom + 1) >> 1):
            if open_groups[pair] & under == np.uint32(0):
                continue
            dy = down + np.float32(2 * pair) * step
            below = down + np.float32(2 * pair + 1) * step
            between = whole
            if right - left > COLUMNS:
                rest = float(c) * dy * dy - limits.widest
                first = narrowed(mark.a, b * float(dy), rest, whole, across, step)
                rest = float(c) * below * below - limits.widest
                second = narrowed(mark.a, b * float(below), rest, whole, across, step)
                between = (min(first[0], second[0]), max(first[1], second[1]))
            base = np.uint64(pair * PAIR)
            line = (across, step, two * b * dy, two * b * below, c * dy * dy, c * below * below)
            if mixture.is_smooth:
                _paint_smooth(rows, base, between, line, mark, mixture.profile, limits)
            elif mixture.is_fitted:
                _paint_eights(rows, base, between, line, mark, mixture.pieces, limits)
            else:
                _paint_each(rows, base, between, line, mark, table, limits)
    return offset.size, at_home
