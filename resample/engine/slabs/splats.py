"""Add splats to the open slabs of a tile, sixteen sub-pixels at a time.

A splat's part in a slab is the difference of its line integral up to the slab's back and up to its
front. What is known of its rays serves all slabs that it lies in.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.footprints import Eye, Shape
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    BOTTOM,
    CUT,
    DEPTH,
    DOWN,
    HOME,
    LEFT,
    RIGHT,
    TOP,
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
    groups_between,
    index_of,
    is_open,
    narrowed,
)
from resample.engine.ellipsoids.rows import WEIGHT as COVER
from resample.engine.ellipsoids.splats import cut_integral, seen_span
from resample.engine.jit import kernel, lane_kernel, lane_step
from resample.engine.slabs.blends import Blend, matter_of
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
from resample.engine.slabs.sums import Canvas, Cutting, Matter, Ring, stride_of, sum_at, touch
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


class Leaning(NamedTuple):
    """Of a splat: coefficients of its nearest points."""

    p: Single
    q: Single
    xx: Single
    xy: Single
    yy: Single


@kernel
def slant_of(eye: Eye, shape: Shape, place: Place) -> Slant:
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
def _line_of(b: Single, c: Single, lean: Leaning, dy: Single) -> Line:
    two = np.float32(2.0)
    return Line(
        two * b * dy, c * dy * dy, lean.p + two * lean.xy * dy, (lean.q + lean.yy * dy) * dy
    )


@lane_step
def _see(
    canvas_rows: Floats,
    along: Floats,
    work: Floats,
    first_k: np.uint64,
    dx_start: Single,
    forms: tuple[Single, Single, Single],
    lines: tuple[Line, Line],
    integral: Integral,
    limits: Limits,
) -> None:
    """Write down what is known of the rays of some sub-pixels, and what covers these."""
    a, lean_xx, step = forms
    line, below = lines
    zero, one = np.float32(0.0), np.float32(1.0)
    for n in range(LANES):
        lane = np.uint64(n)
        k = first_k + lane
        dx = dx_start + np.float32(n >> 1) * step
        is_below = n & 1 != 0
        form = (a * dx + (below.cross if is_below else line.cross)) * dx
        form += below.rest if is_below else line.rest
        lean = (lean_xx * dx + (below.lean_cross if is_below else line.lean_cross)) * dx
        lean += below.lean_rest if is_below else line.lean_rest
        ray, per_depth, amplitude = canvas_rows[k + RAY], along[k], canvas_rows[k + CHORD]
        t = max(zero, one - form * ray)
        before, integral_of_all = seen(integral, work, lane, t, np.sqrt(t))
        work[lane + ALONG] = per_depth
        work[lane + SHIFT] = lean * ray * per_depth
        work[lane + AMPLITUDE] = amplitude
        work[lane + BEFORE] = before * amplitude
        is_seen = one - canvas_rows[k + ALPHA] > limits.opaque
        cover = integral_of_all * amplitude * limits.per_layer
        canvas_rows[k + COVER] += cover if is_seen else zero


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
    weight, one, two, three, four = matter
    stride = stride_of(ring)
    for n in range(LANES):
        lane = np.uint64(n)
        k, half = first + lane, work[lane + HALF]
        x = min(half, max(-half, back * work[lane + ALONG] + work[lane + SHIFT]))
        now = work[lane + AMPLITUDE] * up_to(integral, work, lane, x)
        part = now - work[lane + BEFORE]
        work[lane + BEFORE] = now
        sums[k] += part * weight
        sums[k + stride] += part * one
        sums[k + np.uint64(2) * stride] += part * two
        sums[k + np.uint64(3) * stride] += part * three
        sums[k + np.uint64(4) * stride] += part * four


@lane_step
def _add_whole(
    rows: Floats,
    sums: Floats,
    first_k: np.uint64,
    first: np.uint64,
    ring: Ring,
    dx_start: Single,
    forms: tuple[Single, Single, Single],
    lines: tuple[Line, Line],
    integral: Integral,
    matter: Matter,
    limits: Limits,
) -> None:
    """Add all of a splat."""
    (a, _, step), (line, below) = forms, lines
    weight, one, two, three, four = matter
    zero, full, stride = np.float32(0.0), np.float32(1.0), stride_of(ring)
    for n in range(LANES):
        lane = np.uint64(n)
        k, s = first_k + lane, first + lane
        dx = dx_start + np.float32(n >> 1) * step
        is_below = n & 1 != 0
        form = (a * dx + (below.cross if is_below else line.cross)) * dx
        form += below.rest if is_below else line.rest
        t = max(zero, full - form * rows[k + RAY])
        part = rows[k + CHORD] * whole(integral, t)
        is_seen = full - rows[k + ALPHA] > limits.opaque
        rows[k + COVER] += part * limits.per_layer if is_seen else zero
        sums[s] += part * weight
        sums[s + stride] += part * one
        sums[s + np.uint64(2) * stride] += part * two
        sums[s + np.uint64(3) * stride] += part * three
        sums[s + np.uint64(4) * stride] += part * four


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
    limits: Limits,
    cutting: Cutting,
    is_cutting: bool,
) -> None:
    """Add what is seen of a sphere that a plane cuts; its form is its center."""
    place, camera, ellipsoid, planes, partial = cutting
    rows, sums, n, one = canvas.rows, canvas.sums, place.subpixels, np.float32(1.0)
    stride = stride_of(span.ring)
    center, depth = (room[s + A], room[s + B], room[s + C]), float(room[s + DEPTH])
    left, right = int(room[s + LEFT]), int(room[s + RIGHT])
    first = math.floor((depth - span.reach) / span.thickness) if is_cutting else last
    for row in range(int(room[s + TOP]), int(room[s + BOTTOM])):
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


@lane_kernel
def add_splats(
    canvas: Canvas,
    room: Floats,
    offset: Members,
    span: Span,
    slant: Slant,
    limits: Limits,
    integral: Integral,
    blend: Blend,
    cutting: Cutting,
    is_cutting: bool,
) -> tuple[int, int, int]:
    """Add splats up to the first one that does not reach the first open slab.

    Gives how many these are, how many of those that were added are at home in the tile, and the
    last slab that was touched. Unless slabs cut splats, there is one, which all of them are in.
    """
    rows, open_groups, along, sums = canvas.rows, canvas.open_groups, canvas.along, canvas.sums
    dirty, work, at_home, behind = canvas.dirty, canvas.work, 0, span.front - 1
    ring, slots = span.ring, span.ring.slots
    for n in range(offset.size):
        s = np.uint64(offset[n])
        depth = float(room[s + DEPTH])
        first, last = span.front, span.front
        if is_cutting:
            first = math.floor((depth - span.reach) / span.thickness)
            last = math.floor((depth + span.reach) / span.thickness)
            if first > span.front:
                return n, at_home, behind
            if first < span.front - 1:  # behind the eye: no key of a run knows of it
                continue
            first = max(first, span.front)  # depths may round otherwise than keys
        top, bottom = int(room[s + TOP]), int(room[s + BOTTOM])
        left, right = int(room[s + LEFT]), int(room[s + RIGHT])
        if left >= right or not is_open(open_groups, top, bottom, left, right):
            continue
        at_home += int(room[s + HOME])
        behind = max(behind, last)
        matter = matter_of(blend, room, s, cutting, integral)
        first_slot = span.slot + first - span.front
        first_slot -= slots if first_slot >= slots else 0
        slot, lanes_end = first_slot, min(right + COLUMNS - 1, canvas.width)
        for _ in range(first, last + 1):
            touch(dirty, slot, top, bottom, left, lanes_end)
            slot = slot + 1 if slot + 1 < slots else 0
        if room[s + CUT] > np.float32(0.0):
            _add_cut(canvas, room, s, span, last, matter, limits, cutting, is_cutting)
            continue
        a, b, c = room[s + A], room[s + B], room[s + C]
        across, down = room[s + ACROSS], room[s + DOWN]
        lean = _leaning_of(slant, room[s + X], room[s + Y], room[s + DEPTH])
        forms = (a, lean.xx, slant.step)
        under, first_column, last_column = groups_between(left, right), left, right
        for pair in range(top >> 1, (bottom + 1) >> 1):
            if open_groups[pair] & under == np.uint32(0):
                continue
            dy = down + np.float32(2 * pair) * slant.step
            lines = (_line_of(b, c, lean, dy), _line_of(b, c, lean, dy + slant.step))
            if right - left > COLUMNS:
                first_column, last_column = _narrowed_pair(
                    a, lines, (left, right), across, slant.step, limits.widest
                )
                if first_column >= last_column:
                    continue
            for start in range(first_column, last_column, COLUMNS):
                first_k = np.uint64(pair * PAIR + 2 * start)
                dx_start = across + np.float32(start) * slant.step
                if not is_cutting:
                    k = sum_at(ring, span.slot, pair, start)
                    _add_whole(
                        rows,
                        sums,
                        first_k,
                        k,
                        ring,
                        dx_start,
                        forms,
                        lines,
                        integral,
                        matter,
                        limits,
                    )
                    continue
                _see(rows, along, work, first_k, dx_start, forms, lines, integral, limits)
                slot = first_slot
                for number in range(first, last + 1):
                    k = sum_at(ring, slot, pair, start)
                    back = np.float32((number + 1) * span.thickness - depth)
                    _add_part(sums, work, k, ring, back, integral, matter)
                    slot = slot + 1 if slot + 1 < slots else 0
    return offset.size, at_home, behind
