"""Add splats to the open slabs of a tile, sixteen sub-pixels at a time.

The contribution of a splat to a slab is the difference of its line integrals up to the slab's back
and up to its front. The setup of a ray serves all slabs that the splat lies in.
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
    Members,
    SplatLimits,
    bounds_at,
    groups_between,
    index_of,
    is_open,
    narrowed,
)
from resample.engine.ellipsoids.rows import WEIGHT as COVER
from resample.engine.ellipsoids.splats import clipped_span, cut_integral
from resample.engine.jit import kernel, lane_kernel, lane_step
from resample.engine.vectors import dot
from resample.types import Floats, Place, Single
from resample_comparisons.volume.kernels.slabs.blends import Blend, contribution_of, share_of
from resample_comparisons.volume.kernels.slabs.integrals import (
    ALONG,
    AMPLITUDE,
    BEFORE,
    HALF,
    SHIFT,
    Integral,
    record_ray,
    up_to,
    whole,
)
from resample_comparisons.volume.kernels.slabs.shapes import (
    Shape,
    inverse_square_of,
    is_point,
    middle_of,
    shape_of,
)
from resample_comparisons.volume.kernels.slabs.sums import (
    Canvas,
    Contribution,
    Dirty,
    Ring,
    SphereCut,
    add_contribution,
    stride_of,
    sum_at,
    touch,
)


class Slant(NamedTuple):
    """Offset along the view axis of the point nearest to a sample, on each pixel's ray.

    With (dx, dy) px from the projected center, the point is (p dx + q dy + z (xx dx² + 2 xy dx dy +
    yy dy²)) / |w|² scene units nearer to the eye, with p = z (x + xx X + xy Y), q = z (y + xy X +
    yy Y), and (X, Y) px from the principal point. Where rays are parallel p is x and q is y.
    """

    step: Single  # px between sub-pixels
    cx: Single  # px
    cy: Single
    x: Single
    y: Single
    xx: Single
    xy: Single
    yy: Single
    is_far: bool  # rays diverge from an eye


class OpenSlabs(NamedTuple):
    """The open slabs, and the extent of splats in depth."""

    front: int  # number of the first
    slot: int  # its slot in the ring
    ring: Ring
    thickness: float  # scene units
    reach: float  # half an ellipsoid's extent along the view axis, scene units


class RowSetup(NamedTuple):
    """Terms of a splat's quadratic form and of its offset that are the same along a row."""

    cross: Single
    rest: Single
    lean_cross: Single
    lean_rest: Single


class SplatLanes(NamedTuple):
    """Sixteen sub-pixels, and the terms of a splat on them."""

    k: np.uint64  # index of the first one in the first plane
    dx: Single  # px from the form's center to it
    step: Single  # px between sub-pixels
    lean: Single  # see `Leaning.xx`
    lines: tuple[RowSetup, RowSetup]


class Tools(NamedTuple):
    """Parameters for adding the splats of a tile."""

    slant: Slant
    limits: SplatLimits
    integral: Integral
    cutting: SphereCut
    cover: Single  # 1, or 0 where the coverage by points is known already


class Leaning(NamedTuple):
    """Coefficients of one splat's offset, see `Slant`."""

    p: Single
    q: Single
    xx: Single
    xy: Single
    yy: Single


@kernel
def slant_of(eye: Eye, shape: footprints.Shape, place: Place) -> Slant:
    """Terms of the offset that all splats share."""
    # Products of the rays' directions in the space of the unit sphere.
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
    """Coefficients of the offset for a splat at x and y px."""
    # Parallel rays have no quadratic terms.
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
def _line_of(b: Single, c: Single, lean: Leaning, shape: Shape, dy: Single) -> RowSetup:
    # Expand form and offset at this row, and leave the terms of dx to each sub-pixel.
    two, down = np.float32(2.0), dy + middle_of(shape)[1]
    return RowSetup(
        two * b * dy, c * dy * dy, lean.p + two * lean.xy * down, (lean.q + lean.yy * down) * down
    )


@lane_step
def _form_at(spot: SplatLanes, shape: Shape, n: int) -> tuple[Single, Single]:
    """Distance in px from the form's center to a sub-pixel, and the form's value there."""
    # Lanes alternate between the two rows of a pair.
    line, below = spot.lines
    dx, is_below = spot.dx + np.float32(n >> 1) * spot.step, n & 1 != 0
    form = (shape.a * dx + (below.cross if is_below else line.cross)) * dx
    return dx, form + (below.rest if is_below else line.rest)


@lane_step
def _record_rays(
    rows: Floats,
    along: Floats,
    work: Floats,
    spot: SplatLanes,
    shape: Shape,
    integral: Integral,
    limits: SplatLimits,
) -> None:
    """Set up the rays of sixteen sub-pixels in `work`, and add the splat to their coverage."""
    line, below = spot.lines
    zero, one = np.float32(0.0), np.float32(1.0)
    for n in range(LANES):
        lane = np.uint64(n)
        k = spot.k + lane
        # Evaluate the quadratic form and the offset in depth.
        dx, form = _form_at(spot, shape, n)
        is_below = n & 1 != 0
        aside = dx + middle_of(shape)[0]
        lean = (spot.lean * aside + (below.lean_cross if is_below else line.lean_cross)) * aside
        lean += below.lean_rest if is_below else line.lean_rest
        # Set up the line integral on the ray, from where `up_to` begins.
        ray, per_depth, amplitude = rows[k + RAY], along[k], chord_of(shape.bend, rows[k + CHORD])
        t = t_of(shape.bend, form, ray)
        before, integral_of_all = record_ray(integral, work, lane, t, np.sqrt(t))
        # Store what each slab's share of the integral is computed from.
        work[lane + ALONG] = per_depth
        work[lane + SHIFT] = lean * inverse_square_of(shape, ray, per_depth) * per_depth
        work[lane + AMPLITUDE] = amplitude
        work[lane + BEFORE] = before * amplitude
        # Add to the coverage of sub-pixels that are not opaque yet.
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
    contribution: Contribution,
) -> None:
    """Add to a slab what lies before its back, a depth from the splat's, and was not yet added."""
    for n in range(LANES):
        lane = np.uint64(n)
        # Position of the slab's back on the ray, clamped to the splat's chord.
        k, half = first + lane, work[lane + HALF]
        x = min(half, max(-half, back * work[lane + ALONG] + work[lane + SHIFT]))
        # Subtract what the slabs in front took.
        now = work[lane + AMPLITUDE] * up_to(integral, work, lane, x)
        part = now - work[lane + BEFORE]
        work[lane + BEFORE] = now
        add_contribution(sums, k, ring, part, contribution)


@lane_step
def _add_whole(
    rows: Floats,
    sums: Floats,
    place: tuple[np.uint64, Ring],
    spot: SplatLanes,
    shape: Shape,
    integral: Integral,
    contribution: Contribution,
    limits: SplatLimits,
) -> None:
    """Add a whole splat to one slab."""
    first, ring = place
    zero, full = np.float32(0.0), np.float32(1.0)
    for n in range(LANES):
        lane = np.uint64(n)
        k = spot.k + lane
        # Line integral through the whole splat.
        _, form = _form_at(spot, shape, n)
        t = t_of(shape.bend, form, rows[k + RAY])
        part = chord_of(shape.bend, rows[k + CHORD]) * whole(integral, t)
        # Add to the coverage of sub-pixels that are not opaque yet.
        is_seen = full - rows[k + ALPHA] > limits.opaque
        rows[k + COVER] += part * limits.per_layer if is_seen else zero
        add_contribution(sums, first + lane, ring, part, contribution)


@kernel
def _narrowed_pair(
    a: float,
    lines: tuple[RowSetup, RowSetup],
    bounds: tuple[int, int],
    across: float,
    step: float,
    widest: float,
) -> tuple[int, int]:
    """Range of columns of two rows that a wide splat may touch."""
    line, below = lines
    first, last = narrowed(a, 0.5 * line.cross, float(line.rest) - widest, bounds, across, step)
    other, end = narrowed(a, 0.5 * below.cross, float(below.rest) - widest, bounds, across, step)
    return min(first, other), max(last, end)


@kernel
def _add_cut(
    canvas: Canvas,
    room: Floats,
    s: np.uint64,
    span: OpenSlabs,
    last: int,
    contribution: Contribution,
    tools: Tools,
    is_cutting: bool,
) -> None:
    """Add the visible part of a sphere that a plane cuts; its form holds its center."""
    place, camera, ellipsoid, planes, partial = tools.cutting
    limits, rows, sums, n = tools.limits, canvas.rows, canvas.sums, place.subpixels
    stride, one = stride_of(span.ring), np.float32(1.0)
    # First and last slab that the sphere reaches.
    center, depth = (room[s + A], room[s + B], room[s + C]), float(room[s + DEPTH])
    top, bottom, left, right = bounds_at(room, s)
    first = math.floor((depth - span.reach) / span.thickness) if is_cutting else last
    # Loop over the sub-pixels that are not opaque yet.
    for row in range(top, bottom):
        y = (place.y + (row + 0.5) / n - camera.principal[1]) / camera.focal[1]
        for column in range(left, right):
            k = index_of(row, column)
            if one - rows[k + ALPHA] <= limits.opaque:
                continue
            # Clip the ray to the planes.
            x = (place.x + (column + 0.5) / n - camera.principal[0]) / camera.focal[0]
            start, end = clipped_span(x, y, camera, planes)
            # Integrate between the planes, and between the slab's front and back.
            for number in range(first, last + 1):
                front, back = start, end
                if is_cutting:
                    front = max(front, number * span.thickness)
                    back = min(back, (number + 1) * span.thickness)
                part = np.float32(
                    cut_integral(center, x, y, (front, back), camera, ellipsoid, partial)
                )
                # Add the integral to the coverage and to the slab's sums.
                if part > np.float32(0.0):
                    slot = (span.slot + number - span.front) % span.ring.slots
                    at = sum_at(span.ring, slot, row >> 1, column) + np.uint64(row & 1)
                    rows[k + COVER] += part * limits.per_layer
                    for amount in contribution:
                        sums[at] += part * amount
                        at += stride


@kernel
def _slabs_of(span: OpenSlabs, depth: float, is_cutting: bool) -> tuple[int, int]:
    """First and last slab that a splat lies in; the one open slab, unless slabs cut splats."""
    if not is_cutting:
        return span.front, span.front
    # Very far away, rounding may make more slabs of it than are open.
    first = math.floor((depth - span.reach) / span.thickness)
    last = math.floor((depth + span.reach) / span.thickness)
    return first, min(last, first + span.ring.slots - 1)


@kernel
def touch_slabs(
    dirty: Dirty,
    span: OpenSlabs,
    first: int,
    last: int,
    rows: tuple[int, int],
    columns: tuple[int, int],
) -> int:
    """Mark slabs first..last as dirty in a rectangle; return the first one's slot."""
    # Walk the ring from the first slab's slot.
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
    span: OpenSlabs,
    tools: Tools,
    blend: Blend,
    mixture: Mixture | None,
    is_cutting: bool,
) -> tuple[int, int, int]:
    """Add splats, up to the first that does not reach the first open slab or is a point.

    Return how many were taken, how many of those added are at home in the tile, and the last slab
    touched. Unless slabs cut splats, there is one slab, which takes them all.
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
        # Skip splats behind the eye, which no run's key accounts for; others are late by rounding.
        if first < span.front - 1:
            continue
        first = max(first, span.front)
        # Cull by the open groups of sub-pixels.
        top, bottom, left, right = bounds_at(room, s)
        if left >= right or not is_open(open_groups, top, bottom, left, right):
            continue
        at_home += int(room[s + HOME])
        behind = max(behind, last)
        # Compute the splat's contribution, and mark its slabs as dirty.
        shape = shape_of(mixture, room, s, place)
        share = share_of(blend, shape, room, s, rows, place, integral)
        contribution = contribution_of(blend, room, s, share)
        lanes = (left, min(right + COLUMNS - 1, canvas.width))
        first_slot = touch_slabs(dirty, span, first, last, (top, bottom), lanes)
        if room[s + CUT] > np.float32(0.0):
            _add_cut(canvas, room, s, span, last, contribution, tools, is_cutting)
            continue
        # Set up its quadratic form, then go through its pairs of rows.
        b, c, across, down = room[s + B], room[s + C], room[s + ACROSS], room[s + DOWN]
        lean = _leaning_of(slant, room[s + X], room[s + Y], room[s + DEPTH])
        under, columns = groups_between(left, right), (left, right)
        for pair in range(top >> 1, (bottom + 1) >> 1):
            if open_groups[pair] & under == np.uint32(0):
                continue
            dy = down + np.float32(2 * pair) * step
            lines = (_line_of(b, c, lean, shape, dy), _line_of(b, c, lean, shape, dy + step))
            # Narrow the columns of a wide splat to its ellipse.
            if right - left > COLUMNS:
                columns = _narrowed_pair(shape.a, lines, (left, right), across, step, limits.widest)
            for start in range(columns[0], columns[1], COLUMNS):
                first_k = np.uint64(pair * PAIR + 2 * start)
                spot = SplatLanes(first_k, across + np.float32(start) * step, step, lean.xx, lines)
                # Add sixteen sub-pixels: as a whole, or cut by each slab.
                if not is_cutting:
                    at = (sum_at(ring, span.slot, pair, start), ring)
                    _add_whole(rows, sums, at, spot, shape, integral, contribution, limits)
                    continue
                _record_rays(rows, along, work, spot, shape, integral, limits)
                slot = first_slot
                for number in range(first, last + 1):
                    k = sum_at(ring, slot, pair, start)
                    back = np.float32((number + 1) * span.thickness - depth)
                    _add_part(sums, work, k, ring, back, integral, contribution)
                    slot = slot + 1 if slot + 1 < slots else 0
    return offset.size, at_home, behind
