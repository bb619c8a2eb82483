"""Add splats to the open slabs of a tile, sixteen sub-pixels at a time.

A splat's part in a slab is the difference of its line integral up to the slab's back and up to its
front. What is known of its rays serves all slabs that it lies in.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids import footprints
from resample.engine.ellipsoids.footprints import Eye
from resample.engine.ellipsoids.lanes import chord_of, t_of
from resample.engine.ellipsoids.mixed import Mixture
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    CUT,
    DEPTH,
    DOWN,
    HOME,
    A,
    B,
    C,
    X,
    Y,
)
from resample.engine.ellipsoids.rows import (
    ALPHA,
    CHORD,
    COLUMNS,
    LANES,
    PAIR,
    RAY,
    Limits,
    Members,
    bounds_at,
    groups_between,
    index_of,
    is_open,
    narrowed,
)
from resample.engine.ellipsoids.rows import WEIGHT as COVER
from resample.engine.ellipsoids.splats import cut_integral, seen_span
from resample.engine.jit import kernel, lane_kernel, lane_step
from resample.engine.slabs.blends import Blend, matter_of, share_of
from resample.engine.slabs.integrals import (
    ALONG,
    AMPLITUDE,
    BEFORE,
    HALF,
    SHIFT,
    Integral,
    seen,
    up_to,
    whole,
)
from resample.engine.slabs.shapes import (
    Shape,
    inverse_square_of,
    is_point,
    middle_of,
    shape_of,
)
from resample.engine.slabs.sums import (
    Canvas,
    Cutting,
    Dirty,
    Matter,
    Ring,
    add_matter,
    stride_of,
    sum_at,
    touch,
)
from resample.engine.vectors import dot
from resample.types import Floats, Place, Single


class Slant(NamedTuple):
    """How far from a sample's own depth its nearest point on a pixel's ray lies.

    With (dx, dy) px from the projected center, it is (p dx + q dy + z (xx dx² + 2 xy dx dy + yy
    dy²)) / |w|² scene units nearer to the eye, with p = z (x + xx X + xy Y), q = z (y + xy X + yy
    Y), and (X, Y) px from the principal point. Where rays are parallel p is x and q is y.
    """

    step: Single  # px between sub-pixels
    cx: Single  # px
    cy: Single
    x: Single
    y: Single
    xx: Single
    xy: Single
    yy: Single
    is_far: bool  # rays come from an eye


class Span(NamedTuple):
    """Which slabs are open, and how deep splats are."""

    front: int  # number of the first
    slot: int  # its place in the ring
    ring: Ring
    thickness: float  # scene units
    reach: float  # half an ellipsoid's extent along the view axis, scene units


class Line(NamedTuple):
    """What the sub-pixels of a row share: of the splat's form, and of its rays' nearest points."""

    cross: Single
    rest: Single
    lean_cross: Single
    lean_rest: Single


class Spot(NamedTuple):
    """Sixteen sub-pixels, and what a splat is on them."""

    k: np.uint64  # where the first numbers of the first one are
    dx: Single  # px from the form's middle to it
    step: Single  # px between sub-pixels
    lean: Single  # see `Leaning.xx`
    lines: tuple[Line, Line]


class Tools(NamedTuple):
    """What splats of a tile are added with."""

    slant: Slant
    limits: Limits
    integral: Integral
    cutting: Cutting
    cover: Single  # 1, or 0 where what points cover is known


class Leaning(NamedTuple):
    """Of a splat: coefficients of its nearest points."""

    p: Single
    q: Single
    xx: Single
    xy: Single
    yy: Single


@kernel
def slant_of(eye: Eye, shape: footprints.Shape, place: Place) -> Slant:
    """What is the same for all splats."""
    unit = shape.to_unit
    ahead = (unit[0][2], unit[1][2], unit[2][2])
    return Slant(
        np.float32(1.0 / place.subpixels),
        np.float32(eye.cx),
        np.float32(eye.cy),
        np.float32(dot(shape.across, ahead)),
        np.float32(dot(shape.down, ahead)),
        np.float32(dot(shape.across, shape.across)),
        np.float32(dot(shape.across, shape.down)),
        np.float32(dot(shape.down, shape.down)),
        eye.perspective,
    )


@kernel
def _leaning_of(slant: Slant, x: Single, y: Single, depth: Single) -> Leaning:
    """How the nearest points of a splat at x and y px lie."""
    if not slant.is_far:
        zero = np.float32(0.0)
        return Leaning(slant.x, slant.y, zero, zero, zero)
    right, below = x - slant.cx, y - slant.cy
    return Leaning(
        depth * (slant.x + right * slant.xx + below * slant.xy),
        depth * (slant.y + right * slant.xy + below * slant.yy),
        depth * slant.xx,
        depth * slant.xy,
        depth * slant.yy,
    )


@kernel
def _line_of(b: Single, c: Single, lean: Leaning, shape: Shape, dy: Single) -> Line:
    two, down = np.float32(2.0), dy + middle_of(shape)[1]
    return Line(
        two * b * dy, c * dy * dy, lean.p + two * lean.xy * down, (lean.q + lean.yy * down) * down
    )


@lane_step
def _form_at(spot: Spot, shape: Shape, n: int) -> tuple[Single, Single]:
    """Px from the form's middle to one of a spot's sub-pixels, and the form there."""
    line, below = spot.lines
    dx, is_below = spot.dx + np.float32(n >> 1) * spot.step, n & 1 != 0
    form = (shape.a * dx + (below.cross if is_below else line.cross)) * dx
    return dx, form + (below.rest if is_below else line.rest)


@lane_step
def _see(
    rows: Floats,
    along: Floats,
    work: Floats,
    spot: Spot,
    shape: Shape,
    integral: Integral,
    limits: Limits,
) -> None:
    """Write down what is known of the rays of some sub-pixels, and what covers these."""
    line, below = spot.lines
    zero, one = np.float32(0.0), np.float32(1.0)
    for n in range(LANES):
        lane = np.uint64(n)
        k = spot.k + lane
        dx, form = _form_at(spot, shape, n)
        is_below = n & 1 != 0
        aside = dx + middle_of(shape)[0]
        lean = (spot.lean * aside + (below.lean_cross if is_below else line.lean_cross)) * aside
        lean += below.lean_rest if is_below else line.lean_rest
        ray, per_depth, amplitude = rows[k + RAY], along[k], chord_of(shape.bend, rows[k + CHORD])
        t = t_of(shape.bend, form, ray)
        before, integral_of_all = seen(integral, work, lane, t, np.sqrt(t))
        work[lane + ALONG] = per_depth
        work[lane + SHIFT] = lean * inverse_square_of(shape, ray, per_depth) * per_depth
        work[lane + AMPLITUDE] = amplitude
        work[lane + BEFORE] = before * amplitude
        is_seen = one - rows[k + ALPHA] > limits.opaque
        cover = integral_of_all * amplitude * limits.per_layer
        rows[k + COVER] += cover if is_seen else zero


@lane_step
def _add_part(
    sums: Floats,
    work: Floats,
    first: np.uint64,
    ring: Ring,
    back: Single,
    integral: Integral,
    matter: Matter,
) -> None:
    """Add what lies before a depth, from the splat's own on, and was not yet added."""
    for n in range(LANES):
        lane = np.uint64(n)
        k, half = first + lane, work[lane + HALF]
        x = min(half, max(-half, back * work[lane + ALONG] + work[lane + SHIFT]))
        now = work[lane + AMPLITUDE] * up_to(integral, work, lane, x)
        part = now - work[lane + BEFORE]
        work[lane + BEFORE] = now
        add_matter(sums, k, ring, part, matter)


@lane_step
def _add_whole(
    rows: Floats,
    sums: Floats,
    place: tuple[np.uint64, Ring],
    spot: Spot,
    shape: Shape,
    integral: Integral,
    matter: Matter,
    limits: Limits,
) -> None:
    """Add all of a splat."""
    first, ring = place
    zero, full = np.float32(0.0), np.float32(1.0)
    for n in range(LANES):
        lane = np.uint64(n)
        k = spot.k + lane
        _, form = _form_at(spot, shape, n)
        t = t_of(shape.bend, form, rows[k + RAY])
        part = chord_of(shape.bend, rows[k + CHORD]) * whole(integral, t)
        is_seen = full - rows[k + ALPHA] > limits.opaque
        rows[k + COVER] += part * limits.per_layer if is_seen else zero
        add_matter(sums, first + lane, ring, part, matter)


@kernel
def _narrowed_pair(
    a: float,
    lines: tuple[Line, Line],
    bounds: tuple[int, int],
    across: float,
    step: float,
    widest: float,
) -> tuple[int, int]:
    """Columns of two rows that a wide splat may touch."""
    line, below = lines
    first, last = narrowed(a, 0.5 * line.cross, float(line.rest) - widest, bounds, across, step)
    other, end = narrowed(a, 0.5 * below.cross, float(below.rest) - widest, bounds, across, step)
    return min(first, other), max(last, end)


@kernel
def _add_cut(
    canvas: Canvas,
    room: Floats,
    s: np.uint64,
    span: Span,
    last: int,
    matter: Matter,
    tools: Tools,
    is_cutting: bool,
) -> None:
    """Add what is seen of a sphere that a plane cuts; its form is its center."""
    place, camera, ellipsoid, planes, partial = tools.cutting
    limits, rows, sums, n = tools.limits, canvas.rows, canvas.sums, place.subpixels
    stride, one = stride_of(span.ring), np.float32(1.0)
    center, depth = (room[s + A], room[s + B], room[s + C]), float(room[s + DEPTH])
    top, bottom, left, right = bounds_at(room, s)
    first = math.floor((depth - span.reach) / span.thickness) if is_cutting else last
    for row in range(top, bottom):
        y = (place.y + (row + 0.5) / n - camera.principal[1]) / camera.focal[1]
        for column in range(left, right):
            k = index_of(row, column)
            if one - rows[k + ALPHA] <= limits.opaque:
                continue
            x = (place.x + (column + 0.5) / n - camera.principal[0]) / camera.focal[0]
            start, end = seen_span(x, y, camera, planes)
            for number in range(first, last + 1):
                front, back = start, end
                if is_cutting:
                    front = max(front, number * span.thickness)
                    back = min(back, (number + 1) * span.thickness)
                part = np.float32(
                    cut_integral(center, x, y, (front, back), camera, ellipsoid, partial)
                )
                if part > np.float32(0.0):
                    slot = (span.slot + number - span.front) % span.ring.slots
                    at = sum_at(span.ring, slot, row >> 1, column) + np.uint64(row & 1)
                    rows[k + COVER] += part * limits.per_layer
                    for amount in matter:
                        sums[at] += part * amount
                        at += stride


@kernel
def _slabs_of(span: Span, depth: float, is_cutting: bool) -> tuple[int, int]:
    """First and last slab that a splat lies in; the one open slab, unless slabs cut splats."""
    if not is_cutting:
        return span.front, span.front
    first = math.floor((depth - span.reach) / span.thickness)
    last = math.floor((depth + span.reach) / span.thickness)
    return first, min(last, first + span.ring.slots - 1)  # far away numbers lie apart


@kernel
def touch_slabs(
    dirty: Dirty,
    span: Span,
    first: int,
    last: int,
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> int:
    """Note that slabs between two numbers were touched; gives the first one's place in the ring."""
    slots = span.ring.slots
    first_slot = span.slot + first - span.front
    first_slot -= slots if first_slot >= slots else 0
    slot = first_slot
    for _ in range(first, last + 1):
        touch(dirty, slot, rows[0], rows[1], columns[0], columns[1])
        slot = slot + 1 if slot + 1 < slots else 0
    return first_slot


@lane_kernel
def add_splats(
    canvas: Canvas,
    room: Floats,
    offset: Members,
    span: Span,
    tools: Tools,
    blend: Blend,
    mixture: Mixture | None,
    is_cutting: bool,
) -> tuple[int, int, int]:
    """Add splats up to the first one that does not reach the first open slab, or is a point.

    Gives how many these are, how many of those that were added are at home in the tile, and the
    last slab that was touched. Unless slabs cut splats, there is one, which all of them are in.
    """
    rows, open_groups, along, sums = canvas.rows, canvas.open_groups, canvas.along, canvas.sums
    dirty, work, at_home, behind = canvas.dirty, canvas.work, 0, span.front - 1
    ring, slots, place, step = span.ring, span.ring.slots, tools.cutting.place, tools.slant.step
    slant, limits, integral = tools.slant, tools.limits, tools.integral
    for n in range(offset.size):
        s = np.uint64(offset[n])
        if is_point(mixture, room[s + CUT]):
            return n, at_home, behind
        depth = float(room[s + DEPTH])
        first, last = _slabs_of(span, depth, is_cutting)
        if first > span.front:
            return n, at_home, behind
        if first < span.front - 1:  # behind the eye: no key of a run knows of it
            continue
        first = max(first, span.front)  # depths may round otherwise than keys
        top, bottom, left, right = bounds_at(room, s)
        if left >= right or not is_open(open_groups, top, bottom, left, right):
            continue
        at_home += int(room[s + HOME])
        behind = max(behind, last)
        shape = shape_of(mixture, room, s, place)
        share = share_of(blend, shape, room, s, rows, place, integral)
        matter = matter_of(blend, room, s, share)
        lanes = (left, min(right + COLUMNS - 1, canvas.width))
        first_slot = touch_slabs(dirty, span, first, last, (top, bottom), lanes)
        if room[s + CUT] > np.float32(0.0):
            _add_cut(canvas, room, s, span, last, matter, tools, is_cutting)
            continue
        b, c, across, down = room[s + B], room[s + C], room[s + ACROSS], room[s + DOWN]
        lean = _leaning_of(slant, room[s + X], room[s + Y], room[s + DEPTH])
        under, columns = groups_between(left, right), (left, right)
        for pair in range(top >> 1, (bottom + 1) >> 1):
            if open_groups[pair] & under == np.uint32(0):
                continue
            dy = down + np.float32(2 * pair) * step
            lines = (_line_of(b, c, lean, shape, dy), _line_of(b, c, lean, shape, dy + step))
            if right - left > COLUMNS:
                columns = _narrowed_pair(shape.a, lines, (left, right), across, step, limits.widest)
            for start in range(columns[0], columns[1], COLUMNS):
                first_k = np.uint64(pair * PAIR + 2 * start)
                spot = Spot(first_k, across + np.float32(start) * step, step, lean.xx, lines)
                if not is_cutting:
                    at = (sum_at(ring, span.slot, pair, start), ring)
                    _add_whole(rows, sums, at, spot, shape, integral, matter, limits)
                    continue
                _see(rows, along, work, spot, shape, integral, limits)
                slot = first_slot
                for number in range(first, last + 1):
                    k = sum_at(ring, slot, pair, start)
                    back = np.float32((number + 1) * span.thickness - depth)
                    _add_part(sums, work, k, ring, back, integral, matter)
                    slot = slot + 1 if slot + 1 < slots else 0
    return offset.size, at_home, behind
