"""Samples as what is painted of them: splats by any model of their footprint, or points.

`form_batch` of `resample.engine.ellipsoids.outlines` has given them exact footprints, which are
replaced. With q the quadratic form of a pixel's offset, the squared distance of its ray from the
sample's center is u / (flat + bent u), u = q × the pixel's own `RAY`: exact and affine footprints
have flat 1 and bent 0; discs 1 and -sin² α; the paper's index correction (section 4.2) is d =
sin(arctan(i tan α)) / sin α, hence d² = i² / (cos² α + i² sin² α): cos² α and sin² α.
"""

import math

import numpy as np

from resample.engine.ellipsoids.footprints import Eye, Shape
from resample.engine.ellipsoids.outlines import (
    ACROSS,
    AMPLITUDE,
    AREA,
    BATCH,
    BENT,
    BLUE,
    BOTTOM,
    CUT,
    DOWN,
    EXTINCTION,
    FLAT,
    GREEN,
    LEFT,
    OPACITY,
    RED,
    RIGHT,
    ROOM,
    SPACING,
    TOP,
    A,
    B,
    C,
    Sight,
    Window,
    X,
    Y,
)
from resample.engine.grid import point_width
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed
from resample.engine.points.adding import MOST_TAPS
from resample.engine.vectors import Vector, column, combine, cross, dot, multiply, scaled
from resample.types import (
    CORRECTED,
    DISC,
    EXACT,
    SMALL_ANGLE,
    Floats,
    Style,
)

SPLAT, CUT_SPLAT, POINT = 0.0, 1.0, 2.0  # what stands in the column CUT


@kernel
def form_models(
    room: Floats,
    position: Floats,
    count: int,
    sight: Sight,
    window: Window,
    style: Style,
    are_measured: bool,
) -> None:
    """Give `count` samples footprints by the style's model; `are_measured`: and spacings."""
    eye, shape, _ = sight.optics
    if style.model != EXACT or are_measured:
        measure_batch(room, position, count, eye, shape)
    is_curved = eye.perspective and style.model in (CORRECTED, SMALL_ANGLE)
    if is_curved:
        form_rims(room, position, count, sight, window, style.model == SMALL_ANGLE)
    elif style.model not in (EXACT, DISC):
        form_affine(room, position, count, sight, window, style)
    if style.model in (CORRECTED, SMALL_ANGLE):
        for n in range(count):
            k = np.uint64(n)
            sine = room[k + BENT] if is_curved else np.float32(0.0)
            room[k + FLAT], room[k + BENT] = np.float32(1.0) - sine, sine
    else:
        is_disc = style.model == DISC and eye.perspective
        for n in range(count):
            k = np.uint64(n)
            bent = -room[k + BENT] if is_disc else np.float32(0.0)
            room[k + FLAT], room[k + BENT] = np.float32(1.0), bent
    if style.model == EXACT:
        for n in range(count):
            room[np.uint64(n) + AMPLITUDE] = np.float32(1.0)


@kernel
def measure_batch(room: Floats, position: Floats, count: int, eye: Eye, shape: Shape) -> None:
    """Spacing, amplitude and sin² α of samples, the last as `BENT`; what points add as `AREA`."""
    t, v = shape.to_unit, shape.covariance
    far, per_radius = eye.perspective, 1.0 / shape.radius
    for n in range(count):
        k = np.uint64(n)
        x = float(position[np.uint64(3) * k])
        y = float(position[np.uint64(3) * k + np.uint64(1)])
        z = float(position[np.uint64(3) * k + np.uint64(2)])
        center = combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z)))
        per_z = 1.0 / center[2] if far else 1.0
        x, y = (center[0] * per_z, center[1] * per_z) if far else (0.0, 0.0)
        fx, fy = eye.fx * per_z, eye.fy * per_z
        xx = fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
        yy = fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
        xy = fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
        mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
        major = math.sqrt(mean + math.sqrt(max(0.0, mean * mean - determinant)))
        unit = multiply(t, center)
        squared = dot(unit, unit)
        along = math.sqrt(dot(center, center) / squared)
        parallel = 1.0 / math.sqrt(t[0][2] * t[0][2] + t[1][2] * t[1][2] + t[2][2] * t[2][2])
        # A layer of thickness 1, seen at an angle, is as many times as thick along the ray.
        oblique = math.sqrt(1.0 + x * x + y * y)
        room[k + SPACING] = np.float32(major * per_radius)
        room[k + AMPLITUDE] = np.float32(shape.scale * (along if far else parallel))
        room[k + BENT] = np.float32(min(1.0, 1.0 / squared) if far else 0.0)
        room[k + AREA] = np.float32(shape.volume * fx * fy)  # to be shared by a layer's thickness
        room[k + OPACITY] = np.float32(oblique)


@kernel
def _bound(
    room: Floats,
    k: np.uint64,
    middle: tuple[float, float],
    half: tuple[float, float],
    window: Window,
) -> None:
    """Write first sub-pixels and those behind the last of what lies around a middle, px."""
    place, last_row, last_column = window.place, window.height - 1.0, window.width - 1.0
    per_px, is_cut = float(place.subpixels), room[k + CUT] > np.float32(0.0)
    left = max(0.0, np.ceil((middle[0] - half[0] - place.x) * per_px - 0.5))
    right = min(last_column, np.floor((middle[0] + half[0] - place.x) * per_px - 0.5))
    top = max(0.0, np.ceil((middle[1] - half[1] - place.y) * per_px - 0.5))
    bottom = min(last_row, np.floor((middle[1] + half[1] - place.y) * per_px - 0.5))
    room[k + LEFT] = room[k + LEFT] if is_cut else np.float32(left)
    room[k + RIGHT] = room[k + RIGHT] if is_cut else np.float32(right + 1.0)
    room[k + TOP] = room[k + TOP] if is_cut else np.float32(top)
    room[k + BOTTOM] = room[k + BOTTOM] if is_cut else np.float32(bottom + 1.0)


@kernel
def _write_form(
    room: Floats,
    k: np.uint64,
    form: Vector,
    window: Window,
) -> None:
    """Write a quadratic form a, b, c and the bounds of the ellipse on which it is 1."""
    (a, b, c), place = form, window.place
    half, determinant = 0.5 / place.subpixels, a * c - b * b
    is_cut = room[k + CUT] > np.float32(0.0)
    middle_x = place.x + half - float(room[k + ACROSS])
    middle_y = place.y + half - float(room[k + DOWN])
    extent = (math.sqrt(c / determinant), math.sqrt(a / determinant))
    _bound(room, k, (middle_x, middle_y), extent, window)
    room[k + A] = room[k + A] if is_cut else np.float32(a)
    room[k + B] = room[k + B] if is_cut else np.float32(b)
    room[k + C] = room[k + C] if is_cut else np.float32(c)


@kernel
def form_affine(
    room: Floats,
    position: Floats,
    count: int,
    sight: Sight,
    window: Window,
    style: Style,
) -> None:
    """Footprints by the projection's linear part, made wider where they are narrow, if at all.

    Swan et al. 1997 enlarge the whole kernel until its neighbours are a pixel apart; Zwicker et al.
    2001 add the pixel filter's covariance to the footprint's own.
    """
    eye, shape, _ = sight.optics
    v, far = shape.covariance, eye.perspective
    per_inflated = 1.0 / style.inflated if style.inflated > 0.0 else np.inf
    blurred = style.blurred
    for n in range(count):
        k = np.uint64(n)
        x = float(position[np.uint64(3) * k])
        y = float(position[np.uint64(3) * k + np.uint64(1)])
        z = float(position[np.uint64(3) * k + np.uint64(2)])
        center = combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z)))
        per_z = 1.0 / center[2] if far else 1.0
        x, y = (center[0] * per_z, center[1] * per_z) if far else (0.0, 0.0)
        fx, fy = eye.fx * per_z, eye.fy * per_z
        xx = fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
        yy = fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
        xy = fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
        before = xx * yy - xy * xy
        grown = min(1.0, float(room[k + SPACING]) * per_inflated)
        wider = 1.0 / (grown * grown)
        xx, yy, xy = wider * xx + blurred, wider * yy + blurred, wider * xy
        scale = 1.0 / (xx * yy - xy * xy)
        room[k + AMPLITUDE] *= np.float32(math.sqrt(before * scale))
        _write_form(room, k, (yy * scale, -xy * scale, xx * scale), window)


@kernel
def form_rims(
    room: Floats,
    position: Floats,
    count: int,
    sight: Sight,
    window: Window,
    small_angle: bool,
) -> None:
    """Footprints by the paper's appendix A; see `resample.engine.ellipsoids.footprints`."""
    (eye, shape, _), place = sight.optics, window.place
    t, back, fx, fy = shape.to_unit, shape.from_unit, eye.fx, eye.fy
    half = 0.5 / place.subpixels
    for n in range(count):
        k = np.uint64(n)
        x = float(position[np.uint64(3) * k])
        y = float(position[np.uint64(3) * k + np.uint64(1)])
        z = float(position[np.uint64(3) * k + np.uint64(2)])
        unit = multiply(t, combine(eye.shift, 1.0, multiply(eye.rotation, (x, y, z))))
        squared = dot(unit, unit)
        # The circle in which the cone touches, and its diameters AB and EF
        rim = math.sqrt(1.0 - 1.0 / squared)
        middle = scaled(1.0 - 1.0 / squared, unit)
        parallel, other = cross(unit, back[2]), cross(unit, column(t, 0))
        is_on_axis = dot(parallel, parallel) < 1e-18 * squared * dot(back[2], back[2])
        parallel = (
            other[0] if is_on_axis else parallel[0],
            other[1] if is_on_axis else parallel[1],
            other[2] if is_on_axis else parallel[2],
        )
        parallel = scaled(rim / math.sqrt(dot(parallel, parallel)), parallel)
        axis = cross(parallel, unit)
        axis = scaled(rim / math.sqrt(dot(axis, axis)), axis)
        start = multiply(back, combine(middle, -1.0, axis))
        end = multiply(back, combine(middle, 1.0, axis))
        chord, touched = multiply(back, parallel), multiply(back, middle)
        ax, ay, bx, by = start[0] / start[2], start[1] / start[2], end[0] / end[2], end[1] / end[2]
        # By small angles C', C'B' and C'F'
        is_farther = ax * ax + ay * ay > bx * bx + by * by
        mid_x, mid_y = touched[0] / touched[2], touched[1] / touched[2]
        first_x, first_y = (ax if is_farther else bx) - mid_x, (ay if is_farther else by) - mid_y
        shrink = 1.0 / touched[2]
        # else the midpoint of A'B', and the chord parallel to EF whose projection goes through it
        skew = (start[2] - end[2]) / (start[2] + end[2])
        depth = 2.0 * start[2] * end[2] / (start[2] + end[2])
        mid_x, mid_y = (
            mid_x if small_angle else 0.5 * (ax + bx),
            mid_y if small_angle else 0.5 * (ay + by),
        )
        first_x = fx * (first_x if small_angle else 0.5 * (bx - ax))
        first_y = fy * (first_y if small_angle else 0.5 * (by - ay))
        shrink = shrink if small_angle else math.sqrt(max(0.0, 1.0 - skew * skew)) / depth
        second_x, second_y = fx * shrink * chord[0], fy * shrink * chord[1]
        determinant = first_x * second_y - first_y * second_x
        scale = 1.0 / (determinant * determinant)
        room[k + ACROSS] = np.float32(place.x + half - (fx * mid_x + eye.cx))
        room[k + DOWN] = np.float32(place.y + half - (fy * mid_y + eye.cy))
        form = (
            scale * (first_y * first_y + second_y * second_y),
            -scale * (first_x * first_y + second_x * second_y),
            scale * (first_x * first_x + second_x * second_x),
        )
        _write_form(room, k, form, window)


@kernel
def choose_points(room: Floats, count: int, window: Window, style: Style) -> None:
    """Make points of samples that are close enough."""
    place, layer = window.place, style.layer
    n_side = place.subpixels
    for n in range(count):
        k = np.uint64(n)
        spacing = room[k + SPACING] * np.float32(n_side)
        if spacing <= style.threshold and room[k + CUT] == 0.0:
            room[k + CUT] = POINT
            path = float(room[k + OPACITY]) * layer
            area = float(room[k + AREA]) / layer * (n_side * n_side)
            room[k + AREA] = area
            room[k + OPACITY] = np.float32(area) * absorbed(room[k + EXTINCTION] * path)
            width = float(n_side)
            if style.variance > 0.0:
                width = point_width(spacing, style.variance)
            half = (min(width * style.point_extent, 0.5 * MOST_TAPS) + 0.5) / n_side
            middle = (float(room[k + X]), float(room[k + Y]))
            room[k + CUT] = SPLAT
            if room[k + LEFT] < np.inf:
                _bound(room, k, middle, (half, half), window)
            room[k + CUT] = POINT


@kernel
def tint_splats(room: Floats, count: int, style: Style) -> None:
    """Give the splats of batch after batch the marker's color."""
    for n in range(count):
        k = np.uint64(n // BATCH * ROOM + n % BATCH)
        if room[k + CUT] != POINT:
            brightest = max(room[k + RED], room[k + GREEN], room[k + BLUE])
            room[k + RED] = brightest * style.tint_red
            room[k + GREEN] = brightest * style.tint_green
            room[k + BLUE] = brightest * style.tint_blue
