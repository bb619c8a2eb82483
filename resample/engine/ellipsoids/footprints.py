"""Project ellipsoids to the screen: bounds, and the quadratic form of each footprint.

All is computed in the ellipsoid's own space, where it is the unit sphere: there the paper's
appendix A holds word for word, with an oblique image plane. The half axes of a sphere's ellipse
become conjugate half diameters, from which the quadratic form follows.

The models of the footprint:

EXACT
    The squared distance of the pixel's ray from the center, in radii: |c × w|² / |w|². For w at a
    screen offset (dx, dy) from the projected center, c × w = dx (c × w₀) + dy (c × w₁), so the
    numerator is a quadratic form of the offset and nothing cancels.
CORRECTED, SMALL_ANGLE
    The paper's ellipse (section 4.2, appendix A): its axis in the plane of P and Q ends at the
    cone's rim, its center is the midpoint of these ends; SMALL_ANGLE keeps the projected center.
AFFINE
    The projection's linear part at the center (EWA, Zwicker et al. 2001).
DISC
    The sphere becomes a disc perpendicular to the ray through its center, which other rays meet
    (Mueller and Yagel 1996): with the exact index d and 1 / |c| = sin α, d / √(1 - d² sin² α).
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.subpixels import grid, is_surely_point, point_width
from resample.engine.vectors import (
    Matrix,
    Vector,
    column,
    combine,
    cross,
    dot,
    matrix_of,
    multiply,
    scaled,
)
from resample.types import (
    AFFINE,
    DISC,
    EXACT,
    SMALL_ANGLE,
    Doubles,
    Ellipsoid,
    Record,
    Records,
    Samples,
    Screen,
    Stage,
    Style,
    View,
)

CHUNK = 4096  # samples per task

Side = tuple[float, float, float, float]


class Eye(NamedTuple):
    """A `View` as numbers."""

    rotation: Matrix
    shift: Vector
    fx: float
    fy: float
    cx: float
    cy: float
    near: float
    perspective: bool


class Shape(NamedTuple):
    """An `Ellipsoid` as numbers."""

    to_unit: Matrix
    from_unit: Matrix
    covariance: Matrix
    across: Vector  # a step of 1 px to the right at depth 1, in the ellipsoid's space
    down: Vector  # a step of 1 px down
    volume: float
    scale: float
    radius: float


class Viewport(NamedTuple):
    """A `Screen` as numbers."""

    width: int
    height: int
    margin: float
    sides: tuple[Side, Side, Side, Side]


class Optics(NamedTuple):
    """Camera, ellipsoid and screen, as numbers."""

    eye: Eye
    shape: Shape
    area: Viewport


@kernel
def eye_of(view: View) -> Eye:
    """Unpack a camera, so that kernels keep it in registers."""
    shift, focal, principal = view.translation, view.focal, view.principal
    return Eye(
        matrix_of(view.rotation),
        (shift[0], shift[1], shift[2]),
        focal[0],
        focal[1],
        principal[0],
        principal[1],
        view.near,
        view.perspective,
    )


@kernel
def in_camera(eye: Eye, world: Vector) -> Vector:
    """Transform a scene position to camera axes."""
    return combine(eye.shift, 1.0, multiply(eye.rotation, world))


@kernel
def shape_of(ellipsoid: Ellipsoid) -> Shape:
    """Unpack an ellipsoid."""
    step = ellipsoid.pixel_to_unit
    return Shape(
        matrix_of(ellipsoid.to_unit),
        matrix_of(ellipsoid.from_unit),
        matrix_of(ellipsoid.covariance),
        (step[0, 0], step[1, 0], step[2, 0]),
        (step[0, 1], step[1, 1], step[2, 1]),
        ellipsoid.volume,
        ellipsoid.scale,
        ellipsoid.radius,
    )


@kernel
def _side_of(sides: Doubles, side: int) -> Side:
    return (sides[side, 0], sides[side, 1], sides[side, 2], sides[side, 3])


@kernel
def area_of(screen: Screen) -> Viewport:
    """Unpack a screen."""
    s = screen.sides
    sides = (_side_of(s, 0), _side_of(s, 1), _side_of(s, 2), _side_of(s, 3))
    return Viewport(screen.width, screen.height, screen.margin, sides)


@kernel
def optics_of(stage: Stage) -> Optics:
    """Unpack camera, ellipsoid and screen."""
    return Optics(eye_of(stage.camera), shape_of(stage.ellipsoid), area_of(stage.screen))


@kernel
def project_sample(
    record: Record, center: Vector, eye: Eye, shape: Shape, area: Viewport, style: Style
) -> None:
    """Project one sample, given its center in camera axes, into a record; colors are not set."""
    # Cull in front of the near plane; a sphere that the plane cuts has no ellipse.
    reach = math.sqrt(shape.covariance[2][2])
    if center[2] + reach <= eye.near:
        _hide(record)
    elif center[2] - reach <= eye.near or (eye.perspective and center[2] <= reach):
        if _is_beside(center, area.sides):
            _hide(record)
        else:
            _across_near(record, center, eye, shape, area)
    else:
        # Project by the linear part, which tells how densely samples lie.
        _place(record, center, eye, shape)
        _linear_form(record, center, eye, shape)
        # Points need no form on a grid on which they surely are points.
        if record["spacing"] <= style.threshold:
            if is_surely_point(record["spacing"], style):
                record["left"], record["right"] = record["x"], record["x"]
                record["top"], record["bottom"] = record["y"], record["y"]
            else:
                _splat(record, center, eye, shape, style.model)
            # The point filter may reach into the frame where the ellipse does not: cull after it is
            # added.
            _grow_bounds(record, style)
            if _is_outside(record, area):
                _hide(record)
        elif style.inflated > 0.0 or style.blurred > 0.0:
            # Widened splats are culled after they are widened.
            _splat(record, center, eye, shape, style.model)
            _widen(record, style)
            if _is_outside(record, area):
                _hide(record)
        elif _is_beside(center, area.sides):
            # All others are culled by the sides of the frame, before the form is computed.
            _hide(record)
        else:
            _splat(record, center, eye, shape, style.model)


@kernel
def _widen(record: Record, style: Style) -> None:
    """Widen an affine footprint where it is narrow, and make it fainter, by one of two rules.

    Swan et al. 1997 enlarge the whole kernel until its neighbours are a pixel apart; Zwicker et al.
    2001 add the pixel filter's covariance to the footprint's own.
    """
    # Enlarge the kernel (Swan et al.).
    a, b, c = float(record["a"]), float(record["b"]), float(record["c"])
    before = a * c - b * b
    grown = min(1.0, record["spacing"] / style.inflated) if style.inflated > 0.0 else 1.0
    a, b, c = grown * grown * a, grown * grown * b, grown * grown * c
    # Convolve with the pixel filter: invert the form, add, and invert again (Zwicker et al.).
    if style.blurred > 0.0:
        determinant = a * c - b * b
        xx, yy, xy = (
            c / determinant + style.blurred,
            a / determinant + style.blurred,
            b / determinant,
        )
        wider = xx * yy - xy * xy
        a, b, c = yy / wider, xy / wider, xx / wider
    # Keep the footprint's mass.
    record["a"], record["b"], record["c"] = a, b, c
    record["amplitude"] *= math.sqrt((a * c - b * b) / before)
    _bounds_of_form(record)


@kernel
def _clip(record: Record, center: Vector, planes: Doubles, to_unit: Matrix, style: Style) -> None:
    """Hide samples beyond a clipping plane (M, 5), and mark splats that a plane cuts.

    Points are as small as sub-pixels: their centers decide.
    """
    nearest = np.inf
    for n in range(planes.shape[0]):
        # Signed distance from the plane.
        inside = (
            planes[n, 0] * center[0]
            + planes[n, 1] * center[1]
            + planes[n, 2] * center[2]
            + planes[n, 3]
        )
        reach = 0.0 if is_surely_point(record["spacing"], style) else planes[n, 4]
        if inside <= -reach:
            _hide(record)
            return
        nearest = min(nearest, inside - reach)
    # A cut sphere holds its center in place of a form.
    if nearest < 0.0:
        record["cone"] = -1.0
        record["a"], record["b"], record["c"] = multiply(to_unit, center)


@kernel
def _hide(record: Record) -> None:
    # Empty bounds, and behind all others.
    record["left"], record["right"] = 1.0, 0.0
    record["top"], record["bottom"] = 1.0, 0.0
    record["depth"] = np.inf


@kernel
def _is_beside(center: Vector, sides: tuple[Side, Side, Side, Side]) -> bool:
    """Whether the ellipsoid around `center` lies outside a side of the frame."""
    for side in sides:
        if side[0] * center[0] + side[1] * center[1] + side[2] * center[2] + side[3] > 0.0:
            return True
    return False


@kernel
def _is_outside(record: Record, area: Viewport) -> bool:
    """Whether the bounds miss the frame and its margin."""
    return bool(
        record["right"] < -area.margin
        or record["left"] > area.width + area.margin
        or record["bottom"] < -area.margin
        or record["top"] > area.height + area.margin
    )


@kernel
def _across_near(record: Record, center: Vector, eye: Eye, shape: Shape, area: Viewport) -> None:
    """Bound a sphere that the near plane cuts; behind the eye it may cover any pixel."""
    # By default, it covers the whole frame.
    record["x"], record["y"] = 0.5 * area.width, 0.5 * area.height
    record["left"], record["right"] = -area.margin, area.width + area.margin
    record["top"], record["bottom"] = -area.margin, area.height + area.margin
    # Narrow the bounds where a projection exists.
    if not eye.perspective:
        _place(record, center, eye, shape)
        _linear_form(record, center, eye, shape)
        _bounds_of_form(record)
    elif center[2] > math.sqrt(shape.covariance[2][2]):
        _place(record, center, eye, shape)
        _bounds_in_perspective(record, center, eye, shape)
    # Hold its center in place of a form; it is integrated ray by ray.
    record["cone"] = -1.0
    record["a"], record["b"], record["c"] = multiply(shape.to_unit, center)
    record["depth"] = center[2]
    record["spacing"] = np.inf
    record["mass"], record["obliquity"], record["amplitude"] = 0.0, 1.0, 0.0


@kernel
def _place(record: Record, center: Vector, eye: Eye, shape: Shape) -> None:
    """Screen position, depth and mass, which points and all models share."""
    x, y, z = center
    mass = shape.volume * eye.fx * eye.fy
    record["cone"] = 0.0
    record["obliquity"] = 1.0
    # Perspective shrinks areas by depth², and slanted rays pass more of a layer.
    if eye.perspective:
        per_z = 1.0 / z
        x, y = x * per_z, y * per_z
        obliquity = math.sqrt(1.0 + x * x + y * y)
        record["obliquity"] = obliquity
        mass *= obliquity * per_z * per_z
    record["x"] = eye.fx * x + eye.cx
    record["y"] = eye.fy * y + eye.cy
    record["form_x"], record["form_y"] = record["x"], record["y"]
    record["depth"] = z
    record["mass"] = mass
    record["amplitude"] = 0.0


@kernel
def _splat(record: Record, center: Vector, eye: Eye, shape: Shape, model: int) -> None:
    """Quadratic form, bounds, cone and amplitude by the model; the linear form must be there."""
    if model == AFFINE or not eye.perspective:
        _bounds_of_form(record)
    if model != AFFINE:
        _better_form(record, center, eye, shape, model)
    if model != EXACT:
        record["amplitude"] = _amplitude(center, eye, shape)


@kernel
def _amplitude(center: Vector, eye: Eye, shape: Shape) -> float:
    """Factor of line integrals at the center; exact footprints have one per pixel instead."""
    # The central ray's direction in the ellipsoid's space, per unit of length.
    ray = column(shape.to_unit, 2)
    if eye.perspective:
        ray = scaled(1.0 / math.sqrt(dot(center, center)), multiply(shape.to_unit, center))
    return shape.scale / math.sqrt(dot(ray, ray))


@kernel
def linear_part(
    center: Vector, eye: Eye, shape: Shape
) -> tuple[float, float, float, float, float, float, float]:
    """Linearize the projection at a center, and map the ellipsoid by it.

    Returns the center at depth 1 (0 where rays are parallel), px per length at the center's depth,
    and the covariance xx, yy, xy of the ellipse, px².
    """
    # Direction to the center, and px per scene unit there.
    v, far = shape.covariance, eye.perspective
    per_z = 1.0 / center[2] if far else 1.0
    x, y = (center[0] * per_z, center[1] * per_z) if far else (0.0, 0.0)
    fx, fy = eye.fx * per_z, eye.fy * per_z
    # Covariance of the ellipse on the screen: J V Jᵀ.
    xx = fx * fx * (v[0][0] - 2.0 * x * v[0][2] + x * x * v[2][2])
    yy = fy * fy * (v[1][1] - 2.0 * y * v[1][2] + y * y * v[2][2])
    xy = fx * fy * (v[0][1] - x * v[1][2] - y * v[0][2] + x * y * v[2][2])
    return x, y, fx, fy, xx, yy, xy


@kernel
def major_of(xx: float, yy: float, xy: float) -> float:
    """Semi-major axis of an ellipse of this covariance."""
    # Root of the larger eigenvalue.
    mean, determinant = 0.5 * (xx + yy), xx * yy - xy * xy
    return math.sqrt(mean + math.sqrt(max(0.0, mean * mean - determinant)))


@kernel
def _linear_form(record: Record, center: Vector, eye: Eye, shape: Shape) -> None:
    """Quadratic form of the linearized footprint, and the spacing that follows from it."""
    # The form is the inverse of the covariance.
    _, _, _, _, xx, yy, xy = linear_part(center, eye, shape)
    scale = 1.0 / (xx * yy - xy * xy)
    record["a"], record["b"], record["c"] = yy * scale, -xy * scale, xx * scale
    record["spacing"] = major_of(xx, yy, xy) / shape.radius


@kernel
def _bounds_of_form(record: Record) -> None:
    """Bounding box of the ellipse on which the quadratic form is 1."""
    # The half extents are roots of the inverse's diagonal.
    a, b, c = float(record["a"]), float(record["b"]), float(record["c"])
    determinant = a * c - b * b
    width, height = math.sqrt(c / determinant), math.sqrt(a / determinant)
    record["left"], record["right"] = record["form_x"] - width, record["form_x"] + width
    record["top"], record["bottom"] = record["form_y"] - height, record["form_y"] + height


@kernel
def _better_form(record: Record, center: Vector, eye: Eye, shape: Shape, model: int) -> None:
    """Replace the linear form, and its bounds, by the exact or the paper's one."""
    # Parallel rays: the linear form is exact up to the ray's own factor.
    if not eye.perspective:
        if model in (EXACT, DISC):
            _exact_form(record, column(shape.to_unit, 2), shape)
        return
    # Cone of the sphere: sin α = 1 / |c|.
    unit = multiply(shape.to_unit, center)
    if model != EXACT:
        record["cone"] = math.asin(min(1.0, 1.0 / math.sqrt(dot(unit, unit))))
    # Exact forms have exact bounds; the paper's ellipse has those of its form.
    if model in (EXACT, DISC):
        _exact_form(record, unit, shape)
        _bounds_in_perspective(record, center, eye, shape)
    else:
        _outline_form(record, unit, eye, shape, model == SMALL_ANGLE)
        _bounds_of_form(record)


@kernel
def _exact_form(record: Record, unit: Vector, shape: Shape) -> None:
    """Squared length of c × w over the offset in px; `unit` is c, or the ray where parallel."""
    across = cross(unit, shape.across)
    down = cross(unit, shape.down)
    record["a"] = dot(across, across)
    record["b"] = dot(across, down)
    record["c"] = dot(down, down)


@kernel
def _bounds_in_perspective(record: Record, center: Vector, eye: Eye, shape: Shape) -> None:
    """Bounding box of an ellipsoid in front of the eye: planes through the eye that touch it."""
    # Each axis has a quadratic equation for x / z, whose leading coefficient is `in_front`.
    v, z = shape.covariance, center[2]
    in_front = z * z - v[2][2]
    per_front = 1.0 / in_front
    middle = center[0] * z - v[0][2]
    reach = _reach(middle, in_front, center[0] * center[0] - v[0][0])
    record["left"] = eye.fx * ((middle - reach) * per_front) + eye.cx
    record["right"] = eye.fx * ((middle + reach) * per_front) + eye.cx
    middle = center[1] * z - v[1][2]
    reach = _reach(middle, in_front, center[1] * center[1] - v[1][1])
    record["top"] = eye.fy * ((middle - reach) * per_front) + eye.cy
    record["bottom"] = eye.fy * ((middle + reach) * per_front) + eye.cy


@kernel
def _reach(middle: float, in_front: float, rest: float) -> float:
    """Half the distance between the roots of in_front x² - 2 middle x + rest, times in_front."""
    return math.sqrt(max(0.0, middle * middle - in_front * rest))


@kernel
def _outline_form(record: Record, unit: Vector, eye: Eye, shape: Shape, small_angle: bool) -> None:
    """Ellipse of the tangent cone by appendix A, in the space where the ellipsoid is a sphere."""
    # Circle in which the cone touches the sphere, and its perpendicular diameters AB and EF.
    squared = dot(unit, unit)
    rim = math.sqrt(1.0 - 1.0 / squared)  # radius of the circle in which the cone touches
    middle = scaled(1.0 - 1.0 / squared, unit)  # C
    depth_of = shape.from_unit[2]  # P: its product with a point is the point's depth
    parallel = cross(unit, depth_of)  # EF: across the plane of P and Q, parallel to the screen
    if dot(parallel, parallel) < 1e-18 * squared * dot(depth_of, depth_of):
        parallel = cross(unit, column(shape.to_unit, 0))  # on the axis any diameter will do
    parallel = scaled(rim / math.sqrt(dot(parallel, parallel)), parallel)
    axis = cross(parallel, unit)  # AB: in the plane of P and Q, perpendicular to Q
    axis = scaled(rim / math.sqrt(dot(axis, axis)), axis)

    # Project the ends A and B of the axis.
    back = shape.from_unit
    start = multiply(back, combine(middle, -1.0, axis))
    end = multiply(back, combine(middle, 1.0, axis))
    chord = multiply(back, parallel)
    ax, ay, bx, by = start[0] / start[2], start[1] / start[2], end[0] / end[2], end[1] / end[2]
    if small_angle:  # C', C'B', C'F'
        touched = multiply(back, middle)
        x, y, depth = touched[0] / touched[2], touched[1] / touched[2], touched[2]
        if ax * ax + ay * ay > bx * bx + by * by:
            bx, by = ax, ay
        first_x, first_y, shrink = bx - x, by - y, 1.0 / depth
    else:  # the midpoint of A'B', and the chord parallel to EF whose projection goes through it
        x, y = 0.5 * (ax + bx), 0.5 * (ay + by)
        first_x, first_y = 0.5 * (bx - ax), 0.5 * (by - ay)
        skew = (start[2] - end[2]) / (start[2] + end[2])  # where on AB that chord lies
        depth = 2.0 * start[2] * end[2] / (start[2] + end[2])
        shrink = math.sqrt(1.0 - skew * skew) / depth
    # Scale to px.
    fx, fy = eye.fx, eye.fy
    record["form_x"], record["form_y"] = fx * x + eye.cx, fy * y + eye.cy
    first_x, first_y = fx * first_x, fy * first_y
    second_x, second_y = fx * shrink * chord[0], fy * shrink * chord[1]
    # Quadratic form of the ellipse with these conjugate half diameters.
    determinant = first_x * second_y - first_y * second_x
    scale = 1.0 / (determinant * determinant)
    record["a"] = scale * (first_y * first_y + second_y * second_y)
    record["b"] = -scale * (first_x * first_y + second_x * second_y)
    record["c"] = scale * (first_x * first_x + second_x * second_x)


@kernel
def _grow_bounds(record: Record, style: Style) -> None:
    """Extend the bounds by the point filter."""
    # A tile may have a finer grid, on which the filter is narrower.
    coarsest = grid(record["spacing"], style)  # a tile's is this fine at least
    width = point_width(record["spacing"] * coarsest, style.variance)
    pad = style.point_extent * width / coarsest
    record["left"] = min(record["left"], record["x"] - pad)
    record["right"] = max(record["right"], record["x"] + pad)
    record["top"] = min(record["top"], record["y"] - pad)
    record["bottom"] = max(record["bottom"], record["y"] + pad)


@kernel
def _project_chunk(
    footprints: Records,
    samples: Samples,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    chunk: int,
) -> None:
    eye, shape, area = eye_of(view), shape_of(ellipsoid), area_of(screen)
    position, color, extinction = samples.position, samples.color, samples.extinction
    planes = screen.planes
    for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, footprints.size)):
        # Transform the sample to camera axes.
        world = (float(position[n, 0]), float(position[n, 1]), float(position[n, 2]))
        center = in_camera(eye, world)
        record = footprints[n]
        # Project it, clip it by planes, or leave it out if it is too faint.
        if extinction[n] > style.faintest:
            project_sample(record, center, eye, shape, area, style)
            if planes.shape[0] > 0 and record["left"] <= record["right"]:
                _clip(record, center, planes, shape.to_unit, style)
        else:
            _hide(record)
        # Copy its color.
        record["red"] = color[n, 0]
        record["green"] = color[n, 1]
        record["blue"] = color[n, 2]
        record["extinction"] = extinction[n]


@parallel_kernel
def project(
    counter: Counter,
    footprints: Records,
    samples: Samples,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
) -> None:
    """Project all samples to footprints (N,)."""
    for chunk in tasks(counter, (footprints.size + CHUNK - 1) // CHUNK):
        _project_chunk(footprints, samples, view, ellipsoid, screen, style, chunk)
