"""Footprints of a mixture: splats by any model, or points.

They replace the exact footprints of `form_batch` of `resample.engine.ellipsoids.outlines`. With q
the quadratic form of a pixel's offset, the squared distance of its ray from the sample's center is
u / (flat + bent u), u = q × the pixel's own `RAY`: exact and affine footprints have flat 1 and bent
0; discs 1 and -sin² α; the paper's index correction (section 4.2) is d = sin(arctan(i tan α)) /
sin α, hence d² = i² / (cos² α + i² sin² α): cos² α and sin² α.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.footprints import Eye, Shape, in_camera, linear_part, major_of
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
    EVERYWHERE,
    EXTINCTION,
    FLAT,
    GREEN,
    LEFT,
    OPACITY,
    RED,
    RIGHT,
    SCRATCH_SIZE,
    SPACING,
    TOP,
    A,
    B,
    C,
    OutlineSetup,
    Window,
    X,
    Y,
)
from resample.engine.jit import kernel, lane_step
from resample.engine.lookup import absorbed
from resample.engine.points.adding import MOST_TAPS
from resample.engine.roles import making_role, plays
from resample.engine.subpixels import point_width
from resample.engine.vectors import (
    Matrix,
    Vector,
    column,
    combine,
    cross,
    dot,
    multiply,
    scaled,
    vector_at,
)
from resample.types import (
    CORRECTED,
    DISC,
    EXACT,
    SMALL_ANGLE,
    Floats,
    Style,
)

SPLAT, CUT_SPLAT, POINT = 0.0, 1.0, 2.0  # values of the column CUT

OnScreen = tuple[float, float]  # px
Rim = tuple[OnScreen, OnScreen, OnScreen]  # center of an ellipse, and conjugate half diameters


class MidPoint(NamedTuple):
    """The paper's ellipse, centered at the midpoint of its axis; camera constants."""

    focal: OnScreen
    principal: OnScreen


class SmallAngle(NamedTuple):
    """The paper's ellipse, centered at the sample's center, for small angles."""

    focal: OnScreen
    principal: OnScreen


@kernel
def form_models(
    room: Floats,
    position: Floats,
    count: int,
    sight: OutlineSetup,
    window: Window,
    style: Style,
    are_measured: bool,
) -> None:
    """Give `count` samples footprints by the style's model; and spacings, if `are_measured`."""
    # Spacings choose points, and how much splats are inflated.
    eye, shape, _ = sight.optics
    if are_measured or style.inflated > 0.0:
        measure_batch(room, position, count, eye, shape)
    # Exact footprints stay, with amplitudes that all are 1.
    if style.model == EXACT:
        _straighten(room, count)
        for n in range(count):
            room[np.uint64(n) + AMPLITUDE] = np.float32(1.0)
    elif style.model == DISC:
        # Discs keep their exact form, and are bent.
        form_discs(room, position, count, eye, shape)
    elif eye.perspective and style.model == CORRECTED:
        # The paper's ellipses exist in perspective only.
        way = MidPoint((eye.fx, eye.fy), (eye.cx, eye.cy))
        form_outlines(room, position, count, sight, window, way)
    elif eye.perspective and style.model == SMALL_ANGLE:
        small = SmallAngle((eye.fx, eye.fy), (eye.cx, eye.cy))
        form_outlines(room, position, count, sight, window, small)
    else:
        # What is left is affine: parallel rays included.
        form_affine(room, position, count, sight, window, style)
        _straighten(room, count)


@kernel
def _straighten(room: Floats, count: int) -> None:
    """No index correction: squared distances are the values of the quadratic forms."""
    for n in range(count):
        k = np.uint64(n)
        room[k + FLAT], room[k + BENT] = np.float32(1.0), np.float32(0.0)


@kernel
def measure_batch(room: Floats, position: Floats, count: int, eye: Eye, shape: Shape) -> None:
    """Spacing and area of samples, and the slant of their rays, which is left in `OPACITY`."""
    per_radius = 1.0 / shape.radius
    for n in range(count):
        k = np.uint64(n)
        center = in_camera(eye, vector_at(position, k))
        # Linearize the projection at the sample's center.
        x, y, fx, fy, xx, yy, xy = linear_part(center, eye, shape)
        # A ray at an angle passes a longer stretch of a layer of thickness 1.
        oblique = math.sqrt(1.0 + x * x + y * y)
        room[k + SPACING] = np.float32(major_of(xx, yy, xy) * per_radius)
        # `choose_points` divides the area by a layer's thickness.
        room[k + AREA] = np.float32(shape.volume * fx * fy)
        room[k + OPACITY] = np.float32(oblique)


@kernel
def form_discs(room: Floats, position: Floats, count: int, eye: Eye, shape: Shape) -> None:
    """Bend splats of exact form into discs that face the eye."""
    t, far = shape.to_unit, eye.perspective
    parallel = _squared_chord(t, (0.0, 0.0, 1.0))
    for n in range(count):
        k = np.uint64(n)
        # Scale line integrals by the central ray, and bend by sin² α.
        center = in_camera(eye, vector_at(position, k))
        unit = multiply(t, center)
        per_squared = 1.0 / dot(unit, unit)
        along = dot(center, center) * per_squared if far else parallel
        room[k + AMPLITUDE] = np.float32(shape.scale * math.sqrt(along))
        room[k + FLAT] = np.float32(1.0)
        room[k + BENT] = np.float32(-min(1.0, per_squared) if far else 0.0)


@kernel
def _squared_chord(to_unit: Matrix, along: Vector) -> float:
    """Squared length along a direction per unit of length in unit space."""
    unit = multiply(to_unit, along)
    return dot(along, along) / dot(unit, unit)


@lane_step
def _bound(
    room: Floats,
    k: np.uint64,
    middle: tuple[float, float],
    half: tuple[float, float],
    window: Window,
) -> None:
    """Write first sub-pixels and one past the last of a rectangle around a center, px."""
    place, rows, columns = window.place, float(window.height), float(window.width)
    per_px, is_cut = float(place.subpixels), room[k + CUT] > np.float32(0.0)
    # Round to sub-pixels whose centers lie inside.
    left = np.ceil((middle[0] - half[0] - place.x) * per_px - 0.5)
    right = np.floor((middle[0] + half[0] - place.x) * per_px - 0.5) + 1.0
    top = np.ceil((middle[1] - half[1] - place.y) * per_px - 0.5)
    bottom = np.floor((middle[1] + half[1] - place.y) * per_px - 0.5) + 1.0
    # NaN bounds become an empty rectangle: left = right.
    left, right = max(0.0, min(columns, left)), max(0.0, min(columns, right))
    top, bottom = max(0.0, min(rows, top)), max(0.0, min(rows, bottom))
    # Samples that a plane cuts keep their bounds; select without a branch.
    room[k + LEFT] = room[k + LEFT] if is_cut else np.float32(left)
    room[k + RIGHT] = room[k + RIGHT] if is_cut else np.float32(right)
    room[k + TOP] = room[k + TOP] if is_cut else np.float32(top)
    room[k + BOTTOM] = room[k + BOTTOM] if is_cut else np.float32(bottom)


@lane_step
def _write_form(
    room: Floats,
    k: np.uint64,
    form: Vector,
    extent: tuple[float, float],
    window: Window,
) -> None:
    """Write a quadratic form a, b, c and the bounds of the ellipse on which it is 1."""
    (a, b, c), place = form, window.place
    # Recover the form's center from its offset to the first sub-pixel.
    half = 0.5 / place.subpixels
    is_cut = room[k + CUT] > np.float32(0.0)
    middle_x = place.x + half - float(room[k + ACROSS])
    middle_y = place.y + half - float(room[k + DOWN])
    _bound(room, k, (middle_x, middle_y), extent, window)
    room[k + A] = room[k + A] if is_cut else np.float32(a)
    room[k + B] = room[k + B] if is_cut else np.float32(b)
    room[k + C] = room[k + C] if is_cut else np.float32(c)


@kernel
def form_affine(
    room: Floats,
    position: Floats,
    count: int,
    sight: OutlineSetup,
    window: Window,
    style: Style,
) -> None:
    """Affine footprints: the projection's linear part, optionally widened where it is narrow.

    Swan et al. 1997 enlarge the whole kernel until its neighbours are a pixel apart; Zwicker et al.
    2001 add the pixel filter's covariance to the footprint's own.
    """
    eye, shape, _ = sight.optics
    # Constants of all samples.
    t, far = shape.to_unit, eye.perspective
    is_inflated, blurred = style.inflated > 0.0, style.blurred
    per_inflated = 1.0 / style.inflated if is_inflated else 0.0
    parallel = _squared_chord(t, (0.0, 0.0, 1.0))
    for n in range(count):
        k = np.uint64(n)
        center = in_camera(eye, vector_at(position, k))
        unit = multiply(t, center)
        # Covariance of the ellipse on the screen.
        _, _, _, _, xx, yy, xy = linear_part(center, eye, shape)
        before = xx * yy - xy * xy
        # Enlarge the kernel by one rule, add the pixel filter's covariance by the other.
        grown = min(1.0, float(room[k + SPACING]) * per_inflated) if is_inflated else 1.0
        wider = 1.0 / (grown * grown)
        xx, yy, xy = wider * xx + blurred, wider * yy + blurred, wider * xy
        # Invert to the form, and scale the amplitude so that the mass is kept.
        scale = 1.0 / (xx * yy - xy * xy)
        along = dot(center, center) / dot(unit, unit) if far else parallel
        room[k + AMPLITUDE] = np.float32(shape.scale * math.sqrt(along * before * scale))
        form, extent = (yy * scale, -xy * scale, xx * scale), (math.sqrt(xx), math.sqrt(yy))
        _write_form(room, k, form, extent, window)


@lane_step
def _outline_of(
    unit: Vector, to_unit: Matrix, back: Matrix
) -> tuple[Vector, Vector, Vector, float]:
    """Half diameters AB and EF of the circle in which the cone touches the sphere, and its middle.

    All in camera axes; and 1 / |unit|², which is sin² α.
    """
    per_squared = 1.0 / dot(unit, unit)
    # EF is parallel to the screen; on the axis any diameter will do.
    parallel, other = cross(unit, back[2]), cross(unit, column(to_unit, 0))
    is_on_axis = dot(parallel, parallel) * per_squared < 1e-18 * dot(back[2], back[2])
    parallel = (
        other[0] if is_on_axis else parallel[0],
        other[1] if is_on_axis else parallel[1],
        other[2] if is_on_axis else parallel[2],
    )
    # Scale both to the circle's radius; AB has the right length, as it is perpendicular to EF.
    rim = (1.0 - per_squared) / dot(parallel, parallel)
    parallel = scaled(math.sqrt(max(0.0, rim)), parallel)
    axis = scaled(math.sqrt(per_squared), cross(parallel, unit))
    middle = scaled(1.0 - per_squared, unit)
    return multiply(back, axis), multiply(back, parallel), multiply(back, middle), per_squared


@lane_step
def _write_outline(
    room: Floats,
    k: np.uint64,
    middle: OnScreen,
    first: OnScreen,
    second: OnScreen,
    window: Window,
) -> None:
    """Write the ellipse around a center, px, with these conjugate half diameters, px."""
    (first_x, first_y), (second_x, second_y) = first, second
    # Quadratic form and half extents of the ellipse.
    half, determinant = 0.5 / window.place.subpixels, first_x * second_y - first_y * second_x
    scale = 1.0 / (determinant * determinant)
    xx, yy = first_x * first_x + second_x * second_x, first_y * first_y + second_y * second_y
    xy = first_x * first_y + second_x * second_y
    # Offset from the ellipse's center to the tile's first sub-pixel.
    room[k + ACROSS] = np.float32(window.place.x + half - middle[0])
    room[k + DOWN] = np.float32(window.place.y + half - middle[1])
    form, extent = (scale * yy, -scale * xy, scale * xx), (math.sqrt(xx), math.sqrt(yy))
    _write_form(room, k, form, extent, window)


@making_role
def projected_outline(
    way: MidPoint | SmallAngle, start: Vector, end: Vector, touched: Vector, chord: Vector
) -> Rim:
    """Project the circle with diameter AB to an ellipse; `start` and `end` are A and B."""
    raise NotImplementedError


@plays(projected_outline, MidPoint)
def _by_mid_point(way, start, end, touched, chord):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Give the midpoint of A'B', and the chord parallel to EF that projects through it.

    Its depth is √(1 - skew²) times the harmonic mean of A's and B's, which is their geometric mean.
    """
    (fx, fy), (cx, cy) = way.focal, way.principal
    # Divide once for both depths.
    both = 1.0 / (start[2] * end[2])
    ax, ay = start[0] * (both * end[2]), start[1] * (both * end[2])
    bx, by = end[0] * (both * start[2]), end[1] * (both * start[2])
    shrink = math.sqrt(max(0.0, both))
    middle = (fx * (0.5 * (ax + bx)) + cx, fy * (0.5 * (ay + by)) + cy)
    first = (fx * (0.5 * (bx - ax)), fy * (0.5 * (by - ay)))
    return middle, first, (fx * shrink * chord[0], fy * shrink * chord[1])


@plays(projected_outline, SmallAngle)
def _by_small_angle(way, start, end, touched, chord):  # type: ignore[no-untyped-def]
    """Give C', C'B' and C'F'."""
    (fx, fy), (cx, cy) = way.focal, way.principal
    # Project A and B, and take the one farther from the principal point.
    ax, ay, bx, by = start[0] / start[2], start[1] / start[2], end[0] / end[2], end[1] / end[2]
    is_farther, shrink = ax * ax + ay * ay > bx * bx + by * by, 1.0 / touched[2]
    mid_x, mid_y = touched[0] * shrink, touched[1] * shrink
    first = (fx * ((ax if is_farther else bx) - mid_x), fy * ((ay if is_farther else by) - mid_y))
    second = (fx * shrink * chord[0], fy * shrink * chord[1])
    return (fx * mid_x + cx, fy * mid_y + cy), first, second


@kernel
def form_outlines(
    room: Floats,
    position: Floats,
    count: int,
    sight: OutlineSetup,
    window: Window,
    way: MidPoint | SmallAngle,
) -> None:
    """Footprints by the paper's appendix A; see `resample.engine.ellipsoids.footprints`."""
    eye, shape, _ = sight.optics
    t, back = shape.to_unit, shape.from_unit
    for n in range(count):
        k = np.uint64(n)
        center = in_camera(eye, vector_at(position, k))
        # Touching circle, its projection, and the quadratic form of that ellipse.
        axis, chord, touched, sine = _outline_of(multiply(t, center), t, back)
        start, end = combine(touched, -1.0, axis), combine(touched, 1.0, axis)
        middle, first, second = projected_outline(way, start, end, touched, chord)
        _write_outline(room, k, middle, first, second, window)
        # Amplitude at the center, and the index correction.
        amplitude = shape.scale * math.sqrt(dot(center, center) * sine)
        room[k + AMPLITUDE] = np.float32(amplitude)
        room[k + BENT] = np.float32(min(1.0, sine))
        room[k + FLAT] = np.float32(1.0) - room[k + BENT]


@kernel
def choose_points(room: Floats, count: int, window: Window, style: Style) -> None:
    """Turn samples that lie close enough into points."""
    place, layer = window.place, style.layer
    n_side = place.subpixels
    for n in range(count):
        k = np.uint64(n)
        spacing = room[k + SPACING] * np.float32(n_side)
        if spacing <= style.threshold and room[k + CUT] == 0.0:
            room[k + CUT] = POINT
            # Opacity along the slanted path through a layer, times the area in sub-pixels.
            path = float(room[k + OPACITY]) * layer
            area = float(room[k + AREA]) / layer * (n_side * n_side)
            room[k + AREA] = area
            room[k + OPACITY] = np.float32(area) * absorbed(room[k + EXTINCTION] * path)
            # Width of the point's filter, and its bounds around the projected center.
            width = point_width(spacing, style.variance)
            half = (min(width * style.point_extent, 0.5 * MOST_TAPS) + 0.5) / n_side
            middle = (float(room[k + X]), float(room[k + Y]))
            # Bounds are written for splats only; samples that a plane hides keep none.
            room[k + CUT] = SPLAT
            if room[k + LEFT] < EVERYWHERE:
                _bound(room, k, middle, (half, half), window)
            room[k + CUT] = POINT


@kernel
def tint_splats(room: Floats, count: int, style: Style) -> None:
    """Give splats, batch after batch, the marker's color; points keep their own."""
    for n in range(count):
        k = np.uint64(n // BATCH * SCRATCH_SIZE + n % BATCH)
        if room[k + CUT] != POINT:
            # Keep the brightness.
            brightest = max(room[k + RED], room[k + GREEN], room[k + BLUE])
            room[k + RED] = brightest * style.tint_red
            room[k + GREEN] = brightest * style.tint_green
            room[k + BLUE] = brightest * style.tint_blue
