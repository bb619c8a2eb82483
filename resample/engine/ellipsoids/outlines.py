"""Where samples fall on the screen, many at once, and what runs of neighbours have in common.

The formulas are those of `resample.engine.ellipsoids.footprints` for exact footprints, without a
branch, so that a compiler works on eight samples at a time. What is found are columns of
numbers at fixed distances, for the same reason as in `resample.engine.ellipsoids.rows`.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.footprints import Area, Eye, Shape, Side, area_of, eye_of, shape_of
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.sorting import Pairs, bits_of, paired
from resample.engine.vectors import Vector, column, combine, cross, dot, multiply
from resample.types import (
    Doubles,
    Ellipsoid,
    Floats,
    Place,
    Record,
    Records,
    Samples,
    Screen,
    Single,
    View,
)

BATCH = 256  # samples
LEFT, TOP, RIGHT, BOTTOM, DEPTH, KEY, SPACING, CUT, X, Y, A, B, C = (
    np.uint64(number * BATCH) for number in range(13)
)
ACROSS, DOWN, HOME, EXTINCTION, RED, GREEN, BLUE = (
    np.uint64(number * BATCH) for number in range(13, 20)
)
ROOM = 20 * BATCH  # numbers of a batch
EVERYWHERE = 1e9  # px, bounds of what may be seen by any pixel
# What rounding may take away, at most
SLACK = 1e-9  # share of a half extent or a distance
ROUNDED = 1e-6  # share of a spacing
BORDER = 1e-3  # px
CHUNKS = 64  # fixed, so that runs never depend on the number of threads

Indices = NDArray[np.int64]
Integers = NDArray[np.int32]
Sides = tuple[Side, Side, Side, Side]
Bounds = tuple[Single, Single, Single, Single]  # px: left, right, top, bottom


@kernel
def _bounds_of(center: Vector, eye: Eye, shape: Shape) -> tuple[float, float, float, float]:
    """Left, top, right and bottom in px of an ellipsoid in front of the eye."""
    x, y, z = center
    v = shape.covariance
    in_front = z * z - v[2][2] if eye.perspective else 1.0
    per_front = 1.0 / in_front
    middle_x = x * z - v[0][2] if eye.perspective else x
    middle_y = y * z - v[1][2] if eye.perspective else y
    wide = math.sqrt(max(0.0, middle_x * middle_x - in_front * (x * x - v[0][0])))
    high = math.sqrt(max(0.0, middle_y * middle_y - in_front * (y * y - v[1][1])))
    return (
        eye.fx * ((middle_x - wide) * per_front) + eye.cx,
        eye.fy * ((middle_y - high) * per_front) + eye.cy,
        eye.fx * ((middle_x + wide) * per_front) + eye.cx,
        eye.fy * ((middle_y + high) * per_front) + eye.cy,
    )


@kernel
def outline_batch(
    room: Floats,
    position: Floats,
    extinction: Floats,
    begin: int,
    count: int,
    eye: Eye,
    shape: Shape,
    area: Area,
    faintest: float,
    by_distance: bool,
) -> None:
    """Bounds in px, key and spacing of `count` samples from `begin` on; left > right: not seen.

    Samples that the near plane cuts are marked, and have no spacing.
    """
    v = shape.covariance
    far, reach, per_radius = eye.perspective, math.sqrt(v[2][2]), 1.0 / shape.radius
    to_left, to_right, to_top, to_bottom = area.sides
    least = reach if far else -np.inf
    for n in range(count):
        k = np.uint64(n)
        sample = np.uint64(begin) + k
        x = float(position[np.uint64(3) * sample])
        y = float(position[np.uint64(3) * sample + np.uint64(1)])
        z = float(position[np.uint64(3) * sample + np.uint64(2)])
        center = combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z)))
        cx, cy, cz = center
        per_z = 1.0 / cz if far else 1.0
        x = cx * per_z if far else 0.0
        y = cy * per_z if far else 0.0
        fx, fy = eye.fx * per_z, eye.fy * per_z
        xx = fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
        yy = fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
        xy = fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
        mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
        major = math.sqrt(mean + math.sqrt(max(0.0, mean * mean - determinant)))
        left, top, right, bottom = _bounds_of(center, eye, shape)
        beside = max(
            to_left[0] * cx + to_left[1] * cy + to_left[2] * cz + to_left[3],
            to_right[0] * cx + to_right[1] * cy + to_right[2] * cz + to_right[3],
            to_top[0] * cx + to_top[1] * cy + to_top[2] * cz + to_top[3],
            to_bottom[0] * cx + to_bottom[1] * cy + to_bottom[2] * cz + to_bottom[3],
        )
        is_seen = (
            (beside <= 0.0) & (cz + reach > eye.near) & (extinction[sample] > np.float32(faintest))
        )
        is_cut = (cz - reach <= eye.near) | (cz <= least)
        is_around = cz <= least  # the sphere reaches behind the eye
        key = math.sqrt(cx * cx + cy * cy + cz * cz) if by_distance else cz
        left, right = (-EVERYWHERE, EVERYWHERE) if is_around else (left, right)
        top, bottom = (-EVERYWHERE, EVERYWHERE) if is_around else (top, bottom)
        room[k + LEFT] = np.float32(left) if is_seen else np.float32(np.inf)
        room[k + RIGHT] = np.float32(right) if is_seen else np.float32(-np.inf)
        room[k + TOP] = np.float32(top)
        room[k + BOTTOM] = np.float32(bottom)
        room[k + KEY] = np.float32(key)
        room[k + SPACING] = np.float32(np.inf) if is_cut else np.float32(major * per_radius)
        room[k + CUT] = np.float32(1.0) if is_cut else np.float32(0.0)


@kernel
def _side(normal: Vector, offset: float, eye: Eye, shape: Shape) -> Side:
    """Half space of centers of ellipsoids that reach where a product in camera axes is at most 0.

    In axes of the scene, and wider than it need be by more than rounding takes away.
    """
    reach = math.sqrt(dot(normal, multiply(shape.covariance, normal)))
    r = eye.rotation
    return (
        dot(column(r, 0), normal),
        dot(column(r, 1), normal),
        dot(column(r, 2), normal),
        dot(normal, eye.shift) + offset - (1.0 + SLACK) * reach,
    )


@kernel
def sides_of(eye: Eye, shape: Shape, place: Place, height: int, width: int) -> Sides:
    """Half spaces in which centers lie of samples that touch a canvas."""
    far, half = eye.perspective, 0.5 / place.subpixels
    left, right = place.x + half - eye.cx, place.x + width / place.subpixels - half - eye.cx
    top, bottom = place.y + half - eye.cy, place.y + height / place.subpixels - half - eye.cy
    along, beside = (1.0, 0.0) if far else (0.0, 1.0)
    return (
        _side((-eye.fx, 0.0, along * left), beside * left, eye, shape),
        _side((eye.fx, 0.0, -along * right), -beside * right, eye, shape),
        _side((0.0, -eye.fy, along * top), beside * top, eye, shape),
        _side((0.0, eye.fy, -along * bottom), -beside * bottom, eye, shape),
    )


@kernel
def meet_batch(
    pair: Pairs,
    position: Floats,
    extinction: Floats,
    begin: int,
    count: int,
    eye: Eye,
    reach: float,
    sides: Sides,
    faintest: Single,
    by_distance: bool,
) -> None:
    """Keys with numbers of `count` samples from `begin` on; 0 for those that touch no sub-pixel.

    `reach` is half an ellipsoid's extent along the view axis.
    """
    to_left, to_right, to_top, to_bottom = sides
    least = reach if eye.perspective else -np.inf
    for n in range(count):
        sample = np.uint64(begin) + np.uint64(n)
        x = float(position[np.uint64(3) * sample])
        y = float(position[np.uint64(3) * sample + np.uint64(1)])
        z = float(position[np.uint64(3) * sample + np.uint64(2)])
        beside = max(
            to_left[0] * x + to_left[1] * y + to_left[2] * z + to_left[3],
            to_right[0] * x + to_right[1] * y + to_right[2] * z + to_right[3],
            to_top[0] * x + to_top[1] * y + to_top[2] * z + to_top[3],
            to_bottom[0] * x + to_bottom[1] * y + to_bottom[2] * z + to_bottom[3],
        )
        cx, cy, cz = combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z)))
        key = math.sqrt(cx * cx + cy * cy + cz * cz) if by_distance else cz
        is_met = ((beside <= 0.0) | (cz <= least)) & (extinction[sample] > faintest)
        found = paired(bits_of(np.float32(key)), int(sample))
        pair[np.uint64(n)] = found if is_met else np.uint64(0)


@kernel
def form_batch(
    room: Floats,
    position: Floats,
    begin: int,
    count: int,
    eye: Eye,
    shape: Shape,
    place: Place,
    height: int,
    width: int,
    home: Bounds,
) -> None:
    """All that painting needs of `count` samples from `begin` on.

    Bounds are the first sub-pixels and those behind the last, as whole numbers, of a canvas with
    `height` rows and `width` columns. Samples that the near plane cuts have their centers in place
    of forms.
    """
    t, reach = shape.to_unit, math.sqrt(shape.covariance[2][2])
    far, per_px = eye.perspective, float(place.subpixels)
    least = reach if far else -np.inf
    last_column, last_row, half = width - 1.0, height - 1.0, 0.5 / place.subpixels
    first_x, last_x, first_y, last_y = home
    for n in range(count):
        k = np.uint64(n)
        sample = np.uint64(begin) + k
        x = float(position[np.uint64(3) * sample])
        y = float(position[np.uint64(3) * sample + np.uint64(1)])
        z = float(position[np.uint64(3) * sample + np.uint64(2)])
        center = combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z)))
        cx, cy, cz = center
        per_z = 1.0 / cz if far else 1.0
        left, top, right, bottom = _bounds_of(center, eye, shape)
        is_cut = (cz - reach <= eye.near) | (cz <= least)
        is_around = cz <= least
        unit = multiply(t, center)
        ray_x, ray_y = unit[0] if far else t[0][2], unit[1] if far else t[1][2]
        ray = (ray_x, ray_y, unit[2] if far else t[2][2])
        across, down = cross(ray, shape.across), cross(ray, shape.down)
        on_x = np.float32(eye.fx * (cx * per_z) + eye.cx)
        on_y = np.float32(eye.fy * (cy * per_z) + eye.cy)
        is_home = (on_x >= first_x) & (on_x < last_x) & (on_y >= first_y) & (on_y < last_y)
        left = max(0.0, np.ceil((left - place.x) * per_px - 0.5))
        right = min(last_column, np.floor((right - place.x) * per_px - 0.5))
        top = max(0.0, np.ceil((top - place.y) * per_px - 0.5))
        bottom = min(last_row, np.floor((bottom - place.y) * per_px - 0.5))
        left, right = (0.0, last_column) if is_around else (left, right)
        top, bottom = (0.0, last_row) if is_around else (top, bottom)
        room[k + LEFT] = np.float32(left)
        room[k + RIGHT] = np.float32(right + 1.0)
        room[k + TOP] = np.float32(top)
        room[k + BOTTOM] = np.float32(bottom + 1.0)
        room[k + DEPTH] = np.float32(cz)
        room[k + X] = on_x
        room[k + Y] = on_y
        room[k + ACROSS] = np.float32(place.x + half - on_x)
        room[k + DOWN] = np.float32(place.y + half - on_y)
        room[k + HOME] = np.float32(1.0) if is_home else np.float32(0.0)
        room[k + CUT] = np.float32(1.0) if is_cut else np.float32(0.0)
        room[k + A] = np.float32(unit[0] if is_cut else dot(across, across))
        room[k + B] = np.float32(unit[1] if is_cut else dot(across, down))
        room[k + C] = np.float32(unit[2] if is_cut else dot(down, down))


@kernel
def clip_batch(
    room: Floats,
    position: Floats,
    begin: int,
    count: int,
    eye: Eye,
    shape: Shape,
    planes: Doubles,
) -> None:
    """Hide what lies beyond a clipping plane (M, 5), and mark the samples that one cuts."""
    for n in range(count):
        k, first = np.uint64(n), 3 * (begin + n)
        world = (float(position[first]), float(position[first + 1]), float(position[first + 2]))
        center = combine(eye.shift, 1.0, multiply(eye.rotation, world))
        nearest = np.inf
        for m in range(planes.shape[0]):
            inside = planes[m, 0] * center[0] + planes[m, 1] * center[1]
            inside += planes[m, 2] * center[2] + planes[m, 3]
            if inside <= -planes[m, 4]:
                room[k + LEFT], room[k + RIGHT] = np.inf, -np.inf
            nearest = min(nearest, inside - planes[m, 4])
        if nearest < 0.0:
            unit = multiply(shape.to_unit, center)
            room[k + CUT] = 1.0
            room[k + A], room[k + B], room[k + C] = unit


@kernel
def _ordered(bits: np.int32) -> np.int32:
    """Integer that sorts as the float32 of these bits does, and back."""
    return np.int32(bits ^ ((bits >> np.int32(31)) & np.int32(0x7FFFFFFF)))


@kernel
def box_of(bits: Integers, low: Floats, high: Floats) -> None:
    """Least and greatest x, y and z (3,) of positions, whose bits are given, (3 n,).

    As integers, of which a compiler compares many at once, as none is not a number.
    """
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
    lows, highs = low.view(np.int32), high.view(np.int32)
    lows[0], lows[1], lows[2] = _ordered(x_low), _ordered(y_low), _ordered(z_low)
    highs[0], highs[1], highs[2] = _ordered(x_high), _ordered(y_high), _ordered(z_high)


@kernel
def _end_of_run(position: Floats, extent: float, first: int, last: int) -> int:
    """First sample that lies too far from one between it and the first; `last` if there is none."""
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
    """Where runs of at most `most` samples begin that lie within `extent` scene units.

    Positions are flat (3 N,). Each chunk n of the samples writes `count` (CHUNKS,)[n] numbers to
    `start` (N,) from its own first sample on.
    """
    samples, bits = position.size // 3, position.view(np.int32)
    low, high = np.empty(3, np.float32), np.empty(3, np.float32)
    for chunk in tasks(counter, CHUNKS):
        first, last = samples * chunk // CHUNKS, samples * (chunk + 1) // CHUNKS
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
    """Fill in a run, of bounds left, top, right and bottom."""
    run["left"], run["top"], run["right"], run["bottom"] = bounds
    run["key"], run["seen"] = key, seen
    run["least_spacing"], run["most_spacing"] = spacings


@kernel
def sum_up(run: Record, room: Floats, first: int, last: int) -> None:
    """What samples of a batch have in common."""
    left = top = key = least = np.float32(np.inf)
    right = bottom = most = np.float32(-np.inf)
    seen = 0
    for n in range(first, last):
        k = np.uint64(n)
        if room[k + LEFT] <= room[k + RIGHT]:
            left, right = min(left, room[k + LEFT]), max(right, room[k + RIGHT])
            top, bottom = min(top, room[k + TOP]), max(bottom, room[k + BOTTOM])
            key = min(key, room[k + KEY])
            if room[k + SPACING] < np.inf:
                least, most = min(least, room[k + SPACING]), max(most, room[k + SPACING])
            seen += 1
    bounds = (float(left), float(top), float(right), float(bottom))
    _write(run, bounds, float(key), (float(least), float(most)), seen)


@kernel
def _spread(of: Vector, half: Vector) -> float:
    """How far a product with a vector may be from that of a box's center."""
    return abs(of[0]) * half[0] + abs(of[1]) * half[1] + abs(of[2]) * half[2]


@kernel
def _interval(x: float, half: float, near: float, far: float) -> tuple[float, float]:
    """Least and greatest x / z, where x is within `half` and z between `near` and `far`."""
    low, high = x - half, x + half
    return low / (near if low < 0.0 else far), high / (far if high < 0.0 else near)


@kernel
def _spacings_of(center: Vector, half: Vector, eye: Eye, shape: Shape) -> tuple[float, float]:
    """Bounds of the spacing of samples in a box of camera axes, all of it in front of the eye.

    The spacing is 1 / z times the largest singular value of a matrix, which changes by no more than
    the matrix does.
    """
    v, (cx, cy, cz) = shape.covariance, center
    x, y = (cx / cz, cy / cz) if eye.perspective else (0.0, 0.0)
    xx = eye.fx * eye.fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
    yy = eye.fy * eye.fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
    xy = eye.fx * eye.fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
    mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
    largest = math.sqrt(mean + math.sqrt(max(0.0, mean * mean - determinant))) / shape.radius
    if not eye.perspective:
        return (1.0 - ROUNDED) * largest, (1.0 + ROUNDED) * largest
    near, far = cz - half[2], cz + half[2]
    turn = math.hypot(half[0] + abs(x) * half[2], half[1] + abs(y) * half[2]) / near
    change = max(eye.fx, eye.fy) * turn * math.sqrt(v[2][2]) / shape.radius
    return (1.0 - ROUNDED) * (largest - change) / far, (1.0 + ROUNDED) * (largest + change) / near


@kernel
def _is_outlined_by_box(
    run: Record,
    low: Floats,
    high: Floats,
    seen: int,
    eye: Eye,
    shape: Shape,
    sides: Sides,
    by_distance: bool,
) -> bool:
    """Fill in a run of which `seen` samples are not too faint, if their box says enough.

    That is where all of them are seen or none is, and no near plane cuts one.
    """
    middle = (0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), 0.5 * (low[2] + high[2]))
    world = (high[0] - middle[0], high[1] - middle[1], high[2] - middle[2])
    center, r, v = (
        combine(eye.shift, 1.0, multiply(eye.rotation, middle)),
        eye.rotation,
        shape.covariance,
    )
    half = (_spread(r[0], world), _spread(r[1], world), _spread(r[2], world))
    unit = (1.0, 1.0, 1.0)
    slack = SLACK * (_spread(center, unit) + _spread(eye.shift, unit))
    half = (half[0] + slack, half[1] + slack, half[2] + slack)
    reach = (math.sqrt(v[0][0]), math.sqrt(v[1][1]), math.sqrt(v[2][2]))
    near, far = center[2] - half[2] - reach[2], center[2] + half[2] + reach[2]
    if near <= eye.near or (eye.perspective and near <= 0.0):
        return False
    for side in sides:
        normal = (side[0], side[1], side[2])
        beside, spread = dot(normal, center) + side[3], _spread(normal, half)
        if beside > spread:
            seen = 0
        elif beside > -spread and seen > 0:
            return False
    if seen == 0:
        far = np.inf
        _write(run, (far, far, -far, -far), far, (far, -far), 0)
        return True
    near, far = (near, far) if eye.perspective else (1.0, 1.0)
    left, right = _interval(center[0], half[0] + reach[0], near, far)
    top, bottom = _interval(center[1], half[1] + reach[1], near, far)
    key = center[2] - half[2]
    if by_distance:
        x, y = max(0.0, abs(center[0]) - half[0]), max(0.0, abs(center[1]) - half[1])
        key = math.sqrt(x * x + y * y + key * key)
    bounds = (
        eye.fx * left + eye.cx - BORDER,
        eye.fy * top + eye.cy - BORDER,
        eye.fx * right + eye.cx + BORDER,
        eye.fy * bottom + eye.cy + BORDER,
    )
    _write(run, bounds, key, _spacings_of(center, half, eye, shape), seen)
    return True


@parallel_kernel
def outline_runs(
    counter: Counter,
    runs: Records,
    start: Indices,
    samples: Samples,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    faintest: float,
    by_distance: bool,
    by_boxes: bool,
) -> None:
    """Fill in runs (R,) of at most BATCH samples, from `start` (R + 1,)[n] to before the next.

    `by_boxes`: where the box around a run says how many of its samples are seen, the run has bounds
    of what would else be known of it, and no sample is projected. Not with clipping planes.
    """
    eye, shape, area = eye_of(view), shape_of(ellipsoid), area_of(screen)
    position, extinction = samples.position.reshape(-1), samples.extinction
    bits = position.view(np.int32)
    room, low, high = np.empty(ROOM, np.float32), np.empty(3, np.float32), np.empty(3, np.float32)
    for chunk in tasks(counter, CHUNKS):
        for run in range(runs.size * chunk // CHUNKS, runs.size * (chunk + 1) // CHUNKS):
            begin, count = start[run], start[run + 1] - start[run]
            if by_boxes:
                seen = 0
                for n in range(begin, begin + count):
                    seen += extinction[np.uint64(n)] > np.float32(faintest)
                box_of(bits[3 * begin : 3 * (begin + count)], low, high)
                if _is_outlined_by_box(
                    runs[run], low, high, seen, eye, shape, area.sides, by_distance
                ):
                    continue
            outline_batch(
                room, position, extinction, begin, count, eye, shape, area, faintest, by_distance
            )
            if screen.planes.shape[0] > 0:
                clip_batch(room, position, begin, count, eye, shape, screen.planes)
            sum_up(runs[run], room, 0, count)
