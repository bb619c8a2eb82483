"""Runs of neighbouring samples: their bounds on the screen, nearest key and spacings."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.footprints import Eye, Shape, Side, in_camera
from resample.engine.ellipsoids.outlines import (
    BOTTOM,
    KEY,
    LEFT,
    NO_REACH,
    RIGHT,
    SCRATCH_SIZE,
    SLACK,
    SPACING,
    TOP,
    OutlineSetup,
    clip_batch,
    outline_batch,
    outline_setup,
    pad_of,
    reach_of,
)
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.vectors import Vector, dot
from resample.types import Floats, Layers, Record, Records, Samples, Stage

# Upper bounds of rounding errors, as `SLACK`
ROUNDED = 1e-6  # share of a spacing
BORDER = 1e-3  # px
CHUNKS = 64  # fixed, so that runs never depend on the number of threads

Indices = NDArray[np.int64]
Integers = NDArray[np.int32]


@kernel
def _ordered(bits: np.int32) -> np.int32:
    """Map the bits of a float32 to an integer of the same order; its own inverse."""
    return np.int32(bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF)))


@kernel
def box_of(bits: Integers, low: Floats, high: Floats) -> None:
    """Least and greatest x, y and z (3,) of positions, given as the bits (3 n,) of their floats.

    They are compared as integers: free of NaN rules, so that the compiler vectorizes.
    """
    # Reduce along each axis.
    most, least = np.int32(0x7FFFFFFF), np.int32(-0x80000000)
    x_low = y_low = z_low = most
    x_high = y_high = z_high = least
    for n in range(bits.size // 3):
        k = np.uint64(3) * np.uint64(n)
        x, y, z = (
            _ordered(bits[k]),
            _ordered(bits[k + np.uint64(1)]),
            _ordered(bits[k + np.uint64(2)]),
        )
        x_low, x_high = min(x_low, x), max(x_high, x)
        y_low, y_high = min(y_low, y), max(y_high, y)
        z_low, z_high = min(z_low, z), max(z_high, z)
    # Map back, and store as floats.
    lows, highs = low.view(np.int32), high.view(np.int32)
    lows[0], lows[1], lows[2] = _ordered(x_low), _ordered(y_low), _ordered(z_low)
    highs[0], highs[1], highs[2] = _ordered(x_high), _ordered(y_high), _ordered(z_high)


@kernel
def _end_of_run(position: Floats, extent: float, first: int, last: int) -> int:
    """First sample too far from one between it and the first; `last` if there is none."""
    # Grow the box sample by sample, until it is too large.
    x_low = x_high = position[3 * first]
    y_low = y_high = position[3 * first + 1]
    z_low = z_high = position[3 * first + 2]
    for n in range(first + 1, last):
        x, y, z = position[3 * n], position[3 * n + 1], position[3 * n + 2]
        x_low, x_high = min(x_low, x), max(x_high, x)
        y_low, y_high = min(y_low, y), max(y_high, y)
        z_low, z_high = min(z_low, z), max(z_high, z)
        if max(x_high - x_low, y_high - y_low, z_high - z_low) > extent:
            return n
    return last


@parallel_kernel
def break_runs(
    counter: Counter, position: Floats, extent: float, most: int, start: Indices, count: Indices
) -> None:
    """Split samples into runs of at most `most` samples that lie within `extent` scene units.

    Positions are flat (3 N,). Chunk n of the samples writes `count` (CHUNKS,)[n] beginnings to
    `start` (N,), from the index of its own first sample on.
    """
    samples, bits = position.size // 3, position.view(np.int32)
    low, high = np.empty(3, np.float32), np.empty(3, np.float32)
    for chunk in tasks(counter, CHUNKS):
        first, last = samples * chunk // CHUNKS, samples * (chunk + 1) // CHUNKS
        # Take as many samples as a run may hold, and cut it where its box gets too large.
        runs, n = 0, first
        while n < last:
            start[first + runs] = n
            runs += 1
            behind = min(n + most, last)
            box_of(bits[3 * n : 3 * behind], low, high)
            if max(high[0] - low[0], high[1] - low[1], high[2] - low[2]) > extent:
                behind = _end_of_run(position, extent, n, behind)
            n = behind
        count[chunk] = runs


@kernel
def _write(run: Record, bounds: Side, key: float, spacings: tuple[float, float], seen: int) -> None:
    """Fill in the record of a run; bounds are left, top, right and bottom."""
    run["left"], run["top"], run["right"], run["bottom"] = bounds
    run["key"], run["seen"] = key, seen
    run["least_spacing"], run["most_spacing"] = spacings


@kernel
def sum_up(run: Record, room: Floats, first: int, last: int) -> None:
    """Reduce visible samples of a batch to bounds, nearest key and spacings of their run."""
    left = top = key = least = np.float32(np.inf)
    right = bottom = most = np.float32(-np.inf)
    seen = 0
    # Samples that are not visible have left > right.
    for n in range(first, last):
        k = np.uint64(n)
        if room[k + LEFT] <= room[k + RIGHT]:
            left, right = min(left, room[k + LEFT]), max(right, room[k + RIGHT])
            top, bottom = min(top, room[k + TOP]), max(bottom, room[k + BOTTOM])
            key = min(key, room[k + KEY])
            # Samples that a plane cuts have no spacing.
            if room[k + SPACING] < np.inf:
                least, most = min(least, room[k + SPACING]), max(most, room[k + SPACING])
            seen += 1
    bounds = (float(left), float(top), float(right), float(bottom))
    _write(run, bounds, float(key), (float(least), float(most)), seen)


@kernel
def _spread(of: Vector, half: Vector) -> float:
    """Half the width of a box along a vector, times the vector's length."""
    return abs(of[0]) * half[0] + abs(of[1]) * half[1] + abs(of[2]) * half[2]


@kernel
def _least_key(
    layers: Layers, middle: Vector, world: Vector, center: Vector, half: Vector
) -> float:
    """Lower bound of the keys of samples in a box, given in scene and camera axes."""
    # Around the eye: the distance to the nearest point of the box.
    if layers.is_around:
        x = max(0.0, abs(center[0]) - half[0])
        y = max(0.0, abs(center[1]) - half[1])
        z = max(0.0, abs(center[2]) - half[2])
        return math.sqrt(x * x + y * y + z * z)
    # Along an axis: the place of the center, less half the box's width and rounding.
    along, place = _spread(layers.axis, world), layers.offset + dot(layers.axis, middle)
    far = (abs(middle[0]), abs(middle[1]), abs(middle[2]))
    along += SLACK * (_spread(layers.axis, far) + along + abs(layers.offset))
    # On both sides of the eye's place: the distance from it.
    if layers.eye == -np.inf:
        return place - along
    return max(0.0, abs(place - layers.eye) - along - SLACK * abs(layers.eye))


@kernel
def _interval(x: float, half: float, near: float, far: float) -> tuple[float, float]:
    """Range of x / z, where x is within `half` of a center and z between `near` and `far`."""
    low, high = x - half, x + half
    return low / (near if low < 0.0 else far), high / (far if high < 0.0 else near)


@kernel
def _spacings_of(center: Vector, half: Vector, eye: Eye, shape: Shape) -> tuple[float, float]:
    """Bounds of the spacing of samples in a box in camera axes, all of it in front of the eye.

    The spacing is 1 / z times the largest singular value of a matrix, which changes by at most as
    much as the matrix does (Weyl's inequality).
    """
    # Spacing of a sample at the box's center, at depth 1.
    v, (cx, cy, cz) = shape.covariance, center
    x, y = (cx / cz, cy / cz) if eye.perspective else (0.0, 0.0)
    xx = eye.fx * eye.fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
    yy = eye.fy * eye.fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
    xy = eye.fx * eye.fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
    mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
    largest = math.sqrt(mean + math.sqrt(max(0.0, mean * mean - determinant))) / shape.radius
    # Parallel rays see the same spacing everywhere.
    if not eye.perspective:
        return (1.0 - ROUNDED) * largest, (1.0 + ROUNDED) * largest
    # Else the direction of the ray varies over the box, and so does the depth.
    near, far = cz - half[2], cz + half[2]
    turn = math.hypot(half[0] + abs(x) * half[2], half[1] + abs(y) * half[2]) / near
    change = max(eye.fx, eye.fy) * turn * math.sqrt(v[2][2]) / shape.radius
    return (1.0 - ROUNDED) * (largest - change) / far, (1.0 + ROUNDED) * (largest + change) / near


@kernel
def _bounds_of_box(
    center: Vector,
    half: Vector,
    depths: tuple[float, float],
    eye: Eye,
    shape: Shape,
    mirrored: bool,
) -> Side:
    """Bounds in px of ellipsoids centered in a box that reach over these depths."""
    # Grow the box by the half extents of an ellipsoid, and project it.
    v, (near, far) = shape.covariance, depths
    wide, high = math.sqrt(v[0][0]), math.sqrt(v[1][1])
    left, right = _interval(center[0], half[0] + wide, near, far)
    top, bottom = _interval(center[1], half[1] + high, near, far)
    # Symmetric footprints reach as far from the center as their farther edge does.
    if mirrored:
        deep = math.sqrt(v[2][2])
        nearest = center[2] - half[2] if eye.perspective else 1.0
        first, last = _interval(center[0], half[0], near, far)
        aside = (wide + max(abs(left), abs(right)) * deep) / nearest
        left, right = min(left, first - aside), max(right, last + aside)
        first, last = _interval(center[1], half[1], near, far)
        aside = (high + max(abs(top), abs(bottom)) * deep) / nearest
        top, bottom = min(top, first - aside), max(bottom, last + aside)
    # Convert to px, with a margin for rounding.
    return (
        eye.fx * left + eye.cx - BORDER,
        eye.fy * top + eye.cy - BORDER,
        eye.fx * right + eye.cx + BORDER,
        eye.fy * bottom + eye.cy + BORDER,
    )


@kernel
def _is_outlined_by_box(
    run: Record,
    low: Floats,
    high: Floats,
    seen: int,
    sight: OutlineSetup,
) -> bool:
    """Fill in a run from its box alone, if that suffices; `seen` samples are not too faint.

    It suffices where all samples or none are in the frame, and the near plane cuts none.
    """
    (eye, shape, area), layers, beyond, _ = sight
    # Transform the box to camera axes, with a margin for rounding.
    middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    world = (high[0] - middle[0], high[1] - middle[1], high[2] - middle[2])
    center, r, v = in_camera(eye, middle), eye.rotation, shape.covariance
    half = (_spread(r[0], world), _spread(r[1], world), _spread(r[2], world))
    unit = (1.0, 1.0, 1.0)
    slack = SLACK * (_spread(center, unit) + _spread(eye.shift, unit))
    half = (half[0] + slack, half[1] + slack, half[2] + slack)
    # Its depths, which must be in front of the near plane.
    reach = (math.sqrt(v[0][0]), math.sqrt(v[1][1]), math.sqrt(v[2][2]))
    near, far = center[2] - half[2] - reach[2], center[2] + half[2] + reach[2]
    if near <= eye.near or (eye.perspective and near <= 0.0):
        return False
    # Margin of points and widened splats.
    spacings = _spacings_of(center, half, eye, shape)
    pad = 0.0
    if spacings[0] <= beyond.threshold or beyond.beyond > 0.0:
        pad = float(pad_of(np.float32(min(spacings[1], beyond.threshold)), beyond))
    # Compare with the sides of the frame: all outside, all inside, or undecided.
    is_inside = True
    for side in area.sides:
        normal = (side[0], side[1], side[2])
        beside, spread = dot(normal, center) + side[3], _spread(normal, half)
        if beside > spread and pad == 0.0 and not beyond.mirrored:
            seen = 0
        elif beside > -spread and seen > 0:
            is_inside = False
    # Project the box, and cull it by the frame's edges.
    depths = (near, far) if eye.perspective else (1.0, 1.0)
    bounds = _bounds_of_box(center, half, depths, eye, shape, beyond.mirrored)
    bounds = (bounds[0] - pad, bounds[1] - pad, bounds[2] + pad, bounds[3] + pad)
    if bounds[2] < -area.margin or bounds[0] > area.width + area.margin:
        seen = 0
    if bounds[3] < -area.margin or bounds[1] > area.height + area.margin:
        seen = 0
    # No sample is visible: write an empty record.
    if seen == 0:
        far = np.inf
        _write(run, (far, far, -far, -far), far, (far, -far), 0)
        return True
    # Undecided: samples must be projected.
    if not is_inside:
        return False
    # All are visible: write bounds.
    key = _least_key(layers, middle, world, center, half)
    _write(run, bounds, key, spacings, seen)
    return True


@parallel_kernel
def outline_runs(
    counter: Counter,
    known: Records,
    start: Indices,
    samples: Samples,
    stage: Stage,
    are_mixed: bool,
    by_boxes: bool,
) -> None:
    """Fill in runs (R,) of at most BATCH samples each, which begin at `start` (R + 1,).

    `are_mixed`: samples may be painted beyond their outlines, as points and by some models of
    footprints. `by_boxes`: where the box around a run tells how many of its samples are visible,
    the record is filled in from the box, and no sample is projected; not with clipping planes, nor
    where samples have sizes.
    """
    beyond = reach_of(stage.style, stage.ellipsoid.radius) if are_mixed else NO_REACH
    sight, planes = outline_setup(stage, beyond), stage.screen.planes
    position, extinction, scale = samples.position.reshape(-1), samples.extinction, samples.scale
    bits = position.view(np.int32)
    room, low, high = (
        np.empty(SCRATCH_SIZE, np.float32),
        np.empty(3, np.float32),
        np.empty(3, np.float32),
    )
    for chunk in tasks(counter, CHUNKS):
        for run in range(known.size * chunk // CHUNKS, known.size * (chunk + 1) // CHUNKS):
            begin, count = start[run], start[run + 1] - start[run]
            # Try the box around the run first.
            if by_boxes:
                seen = 0
                for n in range(begin, begin + count):
                    seen += extinction[np.uint64(n)] > sight.faintest
                box_of(bits[3 * begin : 3 * (begin + count)], low, high)
                if _is_outlined_by_box(known[run], low, high, seen, sight):
                    continue
            # Else project its samples, and reduce them to a record.
            outline_batch(room, position, extinction, scale, begin, count, sight)
            if planes.shape[0] > 0:
                clip_batch(room, position, scale, begin, count, sight, planes)
            sum_up(known[run], room, 0, count)
