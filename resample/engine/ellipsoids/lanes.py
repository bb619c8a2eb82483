"""Composite splats on rows of sub-pixels, sixteen sub-pixels at a time.

Three roles, chosen when the loops are compiled, tell splats apart: the distance of a ray from the
center (exact, or by another model of the footprint), the line integral of the kernel at it (a
polynomial, two of them, or a table), and the opacity that results.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from resample.engine.compositing import VISIBLE, Light
from resample.engine.ellipsoids.mixed import Bend, Mixture, bend_of
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    CUT,
    DOWN,
    EXTINCTION,
    HOME,
    A,
    B,
    C,
)
from resample.engine.ellipsoids.outlines import BLUE as LIT_BLUE
from resample.engine.ellipsoids.outlines import DEPTH as FAR
from resample.engine.ellipsoids.outlines import GREEN as LIT_GREEN
from resample.engine.ellipsoids.outlines import RED as LIT_RED
from resample.engine.ellipsoids.rows import (
    ALPHA,
    BLUE,
    CHORD,
    COLUMNS,
    DEPTH,
    E1,
    E2,
    E3,
    E4,
    E5,
    FIRST,
    GREEN,
    LANES,
    PAIR,
    PER_DEEPEST,
    RAY,
    RED,
    WEIGHT,
    Groups,
    Members,
    SplatLimits,
    bounds_at,
    groups_between,
    is_open,
    narrowed,
)
from resample.engine.jit import lane_kernel, lane_step
from resample.engine.lookup import absorbed, unit_lookup
from resample.engine.roles import lane_role, plays
from resample.types import (
    Absorbing,
    Floats,
    Formula,
    Linear,
    Pieces,
    Profile,
    Single,
    Tabulated,
)

Integral = Profile | Pieces | Tabulated
Opacity = Absorbing | Linear


class Mark(NamedTuple):
    """Terms of a splat that all its sub-pixels share."""

    per_integral: Single  # factor of a line integral that gives what `fall_of` takes
    is_thin: bool  # the optical depth is at most 1
    light: Light


@lane_role
def t_of(bend: Bend | None, form: Single, ray: Single) -> Single:
    """1 - squared distance of a ray from a splat's center, in radii; 0 beyond the rim."""
    raise NotImplementedError


@plays(t_of, type(None))
def _straight(bend, form, ray):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return max(np.float32(0.0), np.float32(1.0) - form * ray)


@plays(t_of, Bend)
def _bent(bend, form, ray):  # type: ignore[no-untyped-def]
    one = np.float32(1.0)
    # Apply the model's index correction.
    u = min(one, form * ray)
    inside = bend.flat + (bend.bent - one) * u
    return max(np.float32(0.0), inside / (bend.flat + bend.bent * u))


@lane_role
def chord_of(bend: Bend | None, chord: Single) -> Single:
    """Line integral through a splat's center, relative to the unit kernel's."""
    raise NotImplementedError


@plays(chord_of, type(None))
def _of_ray(bend, chord):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return chord


@plays(chord_of, Bend)
def _of_splat(bend, chord):  # type: ignore[no-untyped-def]
    return chord * bend.amplitude


@lane_role
def line_integral(integral: Integral, t: Single, chord: Single) -> Single:
    """Line integral of a splat's kernel along the ray of a sub-pixel."""
    raise NotImplementedError


@plays(line_integral, Profile)
def _of_profile(integral, t, chord):  # type: ignore[no-untyped-def]
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = integral
    # Estrin's scheme: short dependency chains keep the lanes busy.
    t2 = t * t
    t4 = t2 * t2
    shape = (p4 + t * p5) + t2 * (p6 + t * p7) + t4 * p8
    shape = (p0 + t * p1) + t2 * (p2 + t * p3) + t4 * shape
    return chord * shape * math.sqrt(t)


@lane_kernel
def _two(
    is_far: Any, near: Single, next_near: Single, far: Single, next_far: Single, v: Single
) -> Single:
    """Two terms of the polynomial for the piece that a distance lies in."""
    return (far if is_far else near) + v * (next_far if is_far else next_near)


@plays(line_integral, Pieces)
def _of_pieces(integral, t, chord):  # type: ignore[no-untyped-def]
    zero, one = np.float32(0.0), np.float32(1.0)
    # Distance from the middle of the piece; the two pieces meet at half the radius.
    distance = math.sqrt(max(zero, one - t))
    p, q = integral
    is_far = distance >= np.float32(0.5)
    v = distance - (np.float32(0.75) if is_far else np.float32(0.25))
    # Estrin's scheme, each coefficient selected by the piece.
    v2 = v * v
    v4 = v2 * v2
    low = _two(is_far, p[0], p[1], q[0], q[1], v) + v2 * _two(is_far, p[2], p[3], q[2], q[3], v)
    high = _two(is_far, p[4], p[5], q[4], q[5], v) + v2 * _two(is_far, p[6], p[7], q[6], q[7], v)
    high += v4 * _two(is_far, p[8], p[9], q[8], q[9], v)
    return chord * max(zero, low + v4 * high) * math.sqrt(t)


@plays(line_integral, Tabulated)
def _of_table(integral, t, chord):  # type: ignore[no-untyped-def]
    # Interpolate in the table; its kernel may have negative lobes.
    squared = max(np.float32(0.0), np.float32(1.0) - t)
    return chord * max(np.float32(0.0), unit_lookup(integral.values, squared))


@lane_step
def expm1_of(x: Single) -> Single:
    """Compute expm1 of a number between -1 and 0."""
    one, x2 = np.float32(1.0), x * x
    return x * ((one + x * E1) + x2 * ((E2 + x * E3) + x2 * (E4 + x * E5)))


@lane_step
def of_16_times(fall: Single) -> Single:
    """Compute expm1(16 x) from expm1(x): expm1(2x) = expm1(x) (expm1(x) + 2), four times."""
    two = np.float32(2.0)
    fall *= fall + two
    fall *= fall + two
    fall *= fall + two
    fall *= fall + two
    return fall


@lane_role
def per_integral_of(opacity: Opacity, extinction: Single) -> tuple[Single, bool]:
    """Factor of line integrals that gives what `fall_of` takes, and whether the splat is thin."""
    raise NotImplementedError


@lane_role
def fall_of(opacity: Opacity, x: Single, is_thin: bool) -> Single:
    """Relative change of the transmittance, between -1 and 0."""
    raise NotImplementedError


@plays(per_integral_of, Absorbing)
def _depth_per(opacity, extinction):  # type: ignore[no-untyped-def]
    # Thin splats take expm1 directly, others at a 16th of the depth, so that it stays within -1..0.
    is_thin = extinction * opacity.peak <= 1.0
    return -extinction * (np.float32(1.0) if is_thin else PER_DEEPEST), is_thin


@plays(fall_of, Absorbing)
def _absorbed(opacity, x, is_thin):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Compute expm1 of x, or of 16 x if the splat is not thin."""
    fall = expm1_of(x)
    if not is_thin:
        fall = of_16_times(fall)
    return fall


@plays(per_integral_of, Linear)
def _share_per(opacity, extinction):  # type: ignore[no-untyped-def]
    # The classic model: opacity of a layer, spread evenly over line integrals.
    layer = np.float32(opacity.layer)
    return -absorbed(extinction * layer) / layer, True


@plays(fall_of, Linear)
def _as_it_is(opacity, x, is_thin):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return x


@lane_kernel
def composite_under(
    rows: Floats, k: np.uint64, fall: Single, integral: Single, light: Light, limits: SplatLimits
) -> None:
    """Composite light under what a sub-pixel holds."""
    red, green, blue, depth = light
    zero, one = np.float32(0.0), np.float32(1.0)
    # Opaque sub-pixels take nothing; a select in place of a branch keeps the lanes.
    alpha = rows[k + ALPHA]
    behind = alpha - one
    is_open = behind < -limits.opaque
    share = fall * behind if is_open else zero
    # Accumulate premultiplied light, opacity, depth and coverage.
    after = alpha + share
    rows[k + RED] += share * red
    rows[k + GREEN] += share * green
    rows[k + BLUE] += share * blue
    rows[k + ALPHA] = after
    rows[k + DEPTH] += share * depth
    rows[k + WEIGHT] += integral * limits.per_layer if is_open else zero
    # Note the depth where the sub-pixel first becomes visible.
    first = rows[k + FIRST]
    rows[k + FIRST] = depth if (first == np.inf) & (after > np.float32(VISIBLE)) else first


@lane_step
def _lay(
    rows: Floats,
    k: np.uint64,
    form: Single,
    bend: Bend | None,
    mark: Mark,
    formula: Formula,
    limits: SplatLimits,
) -> None:
    """Composite a splat under a sub-pixel, where its quadratic form has this value."""
    # Distance, line integral, opacity, compositing.
    t, chord = t_of(bend, form, rows[k + RAY]), chord_of(bend, rows[k + CHORD])
    integral = line_integral(formula.integral, t, chord)
    x = max(np.float32(-1.0), integral * mark.per_integral)
    fall = fall_of(formula.opacity, x, mark.is_thin)
    composite_under(rows, k, fall, integral, mark.light, limits)


@lane_kernel
def paint_splats_on_rows(
    rows: Floats,
    open_groups: Groups,
    room: Floats,
    offset: Members,
    step: Single,
    formula: Formula,
    limits: SplatLimits,
    mixture: Mixture | None,
) -> tuple[int, int]:
    """Composite splats up to the first sample that is a point, or is cut by a plane.

    Return how many were taken, and how many of those painted are at home in the tile.

    `rows`, `open_groups`: the canvas, and which of its groups are not opaque. `room`, `offset`:
    columns as `form_batch` fills them, and where in the first column splats are. `step`: px between
    sub-pixels. `formula`: line integrals of the kernel, and opacities. `limits`: what all splats of
    a tile share. `mixture`: None: all footprints are exact.
    """
    zero, two, at_home = np.float32(0.0), np.float32(2.0), 0
    for n in range(offset.size):
        # Stop at a sample that is no whole splat.
        s = np.uint64(offset[n])
        if room[s + CUT] > zero:
            return n, at_home
        # Cull by the open groups of sub-pixels.
        top, bottom, left, right = bounds_at(room, s)
        if left >= right or not is_open(open_groups, top, bottom, left, right):
            continue
        at_home += int(room[s + HOME])
        # Load the form, the light and the model of the splat.
        a, b, c = room[s + A], room[s + B], room[s + C]
        per_integral, is_thin = per_integral_of(formula.opacity, room[s + EXTINCTION])
        light = (room[s + LIT_RED], room[s + LIT_GREEN], room[s + LIT_BLUE], room[s + FAR])
        mark, bend = Mark(per_integral, is_thin, light), bend_of(mixture, room, s)
        # Visit its pairs of rows, and skip those where all its groups are opaque.
        across, down = room[s + ACROSS], room[s + DOWN]
        under, whole = groups_between(left, right), (left, right)
        first_column, last_column = whole
        for pair in range(top >> 1, (bottom + 1) >> 1):
            if open_groups[pair] & under == np.uint32(0):
                continue
            # Expand the form at both rows, and leave the terms of dx to each sub-pixel.
            dy = down + np.float32(2 * pair) * step
            below = down + np.float32(2 * pair + 1) * step
            cross, cross_below = two * b * dy, two * b * below
            rest, rest_below = c * dy * dy, c * below * below
            # Narrow the columns of a wide splat to its ellipse.
            if right - left > COLUMNS:
                outside = float(c) * dy * dy - limits.widest
                first_column, last_column = narrowed(a, b * float(dy), outside, whole, across, step)
                outside = float(c) * below * below - limits.widest
                first, last = narrowed(a, b * float(below), outside, whole, across, step)
                first_column, last_column = min(first_column, first), max(last_column, last)
            base = np.uint64(pair * PAIR)
            # Two loops of constant counts with one body: as one function they are not vectorized.
            if right - left <= COLUMNS // 2:
                dx_start, first_k = across + np.float32(left) * step, base + np.uint64(2 * left)
                for lane in range(LANES // 2):
                    dx, is_below = dx_start + np.float32(lane >> 1) * step, lane & 1 != 0
                    form = (a * dx + (cross_below if is_below else cross)) * dx
                    form += rest_below if is_below else rest
                    _lay(rows, first_k + np.uint64(lane), form, bend, mark, formula, limits)
                continue
            # Eight columns of both rows at a time.
            for start in range(first_column, last_column, COLUMNS):
                dx_start, first_k = across + np.float32(start) * step, base + np.uint64(2 * start)
                for lane in range(LANES):
                    dx, is_below = dx_start + np.float32(lane >> 1) * step, lane & 1 != 0
                    form = (a * dx + (cross_below if is_below else cross)) * dx
                    form += rest_below if is_below else rest
                    _lay(rows, first_k + np.uint64(lane), form, bend, mark, formula, limits)
    return offset.size, at_home
