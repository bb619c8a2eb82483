"""Sum what lies in a slab between two planes parallel to the screen, or in a whole sheet.

A slab holds, per sub-pixel, sums over its splats: of their weights, weighted red, green, blue and
depth, of their line integrals within the slab, and of the weighted fourth property, a field's
value. The weight is the optical depth of samples that have a look already, and the line integral
of those that have not.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.splats import (
    cut_integral,
    first_inside,
    last_inside,
    light_of,
    seen_span,
)
from resample.engine.jit import kernel
from resample.engine.lookup import absorbed, corrected_distance, partial_integral
from resample.engine.over import Light
from resample.engine.points.adding import box_of_point
from resample.engine.vectors import Vector, combine, dot, scaled
from resample.types import (
    AFFINE,
    DISC,
    EXACT,
    Doubles,
    Ellipsoid,
    Floats,
    Place,
    Record,
    Single,
    Style,
    View,
)

Corners = NDArray[np.int64]  # (4,) first and last row, first and last column


class Slab(NamedTuple):
    """Depths between which samples are summed, scene units."""

    front: float
    back: float


class Rays(NamedTuple):
    """A `View` seen from the ellipsoids' own space, as numbers."""

    across: Vector  # a px to the right
    down: Vector  # a px down
    ahead: Vector  # depth 1
    cx: float  # px
    cy: float
    perspective: bool


class Chord(NamedTuple):
    """How far from a sample's own depth its nearest point on a pixel's ray lies, scene units.

    With (dx, dy) px from the projected center, (p dx + q dy + aa dx² + 2 ab dx dy + bb dy²) / |w|²
    nearer to the eye.
    """

    p: Single
    q: Single
    aa: Single
    ab: Single
    bb: Single


@kernel
def rays_of(view: View, ellipsoid: Ellipsoid) -> Rays:
    """Take camera and ellipsoid apart."""
    step, unit = ellipsoid.pixel_to_unit, ellipsoid.to_unit
    return Rays(
        (step[0, 0], step[1, 0], step[2, 0]),
        (step[0, 1], step[1, 1], step[2, 1]),
        (unit[0, 2], unit[1, 2], unit[2, 2]),
        view.principal[0],
        view.principal[1],
        view.perspective,
    )


@kernel
def cast_slab_rays(
    ray: Floats, place: Place, view: View, ellipsoid: Ellipsoid, planes: Doubles
) -> None:
    """Per sub-pixel 1 / |w|², the amplitude of exact footprints, |w|, |v|, and the seen depths."""
    n, unit = place.subpixels, ellipsoid.to_unit
    for row in range(ray.shape[0]):
        for column in range(ray.shape[1]):
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
            start, end = seen_span(x, y, view, planes)
            if not view.perspective:
                x, y = 0.0, 0.0
            squared = 0.0
            for axis in range(3):
                along = unit[axis, 0] * x + unit[axis, 1] * y + unit[axis, 2]
                squared += along * along
            length = math.sqrt(1.0 + x * x + y * y)
            ray[row, column, 0] = 1.0 / squared
            ray[row, column, 1] = ellipsoid.scale * length / math.sqrt(squared)
            ray[row, column, 2] = math.sqrt(squared)
            ray[row, column, 3] = length
            ray[row, column, 4] = start
            ray[row, column, 5] = end


@kernel
def _chord(record: Record, rays: Rays) -> Chord:
    """Chords of all pixels' rays in one sample's sphere."""
    if not rays.perspective:
        p, q = dot(rays.across, rays.ahead), dot(rays.down, rays.ahead)
        zero = np.float32(0.0)
        return Chord(np.float32(p), np.float32(q), zero, zero, zero)
    depth = float(record["depth"])
    aside = combine(scaled(record["x"] - rays.cx, rays.across), record["y"] - rays.cy, rays.down)
    center = combine(aside, 1.0, rays.ahead)  # the ray through the sample's center
    return Chord(
        np.float32(depth * dot(center, rays.across)),
        np.float32(depth * dot(center, rays.down)),
        np.float32(depth * dot(rays.across, rays.across)),
        np.float32(depth * dot(rays.across, rays.down)),
        np.float32(depth * dot(rays.down, rays.down)),
    )


@kernel
def density_of(record: Record, style: Style, is_field: bool) -> Single:
    """Weight of a splat per unit of its line integral."""
    if is_field:
        return np.float32(1.0)
    if style.linear_opacity:
        layer = np.float32(style.layer)
        return absorbed(record["extinction"] * layer) / layer
    return record["extinction"]


@kernel
def _mark(dirty: Corners, top: int, bottom: int, left: int, right: int) -> None:
    """Let the touched part of a slab hold a box."""
    dirty[0], dirty[1] = min(dirty[0], top), max(dirty[1], bottom)
    dirty[2], dirty[3] = min(dirty[2], left), max(dirty[3], right)


@kernel
def _true_index(
    squared: Single, per_square: Single, model: int, cone: Single, correction: Floats
) -> Single:
    """Squared distance of the ray from the center by a model, radii², from its quadratic form."""
    one = np.float32(1.0)
    if model == AFFINE:
        return squared
    if model == EXACT:
        return squared * per_square
    if model == DISC:
        sine = np.float32(math.sin(cone))
        exact = squared * per_square
        return exact / (one - exact * sine * sine)
    distance = np.float32(corrected_distance(correction, math.sqrt(squared), cone))
    return distance * distance


@kernel
def _deposit(
    slab: Floats,
    row: int,
    column: int,
    integral: Single,
    density: Single,
    light: Light,
    value: Single,
) -> None:
    """Add a splat's part to the sums of a sub-pixel."""
    weight = integral * density
    slab[row, column, 0] += weight
    slab[row, column, 1] += weight * light[0]
    slab[row, column, 2] += weight * light[1]
    slab[row, column, 3] += weight * light[2]
    slab[row, column, 4] += weight * light[3]
    slab[row, column, 5] += integral
    slab[row, column, 6] += weight * value


@kernel
def add_splat(
    slab: Floats,
    dirty: Corners,
    pixel: Floats,
    ray: Floats,
    place: Place,
    record: Record,
    bounds: Slab,
    rays: Rays,
    density: Single,
    style: Style,
    partial: Floats,
    correction: Floats,
) -> None:
    """Add the part of a splat that lies in a slab, on sub-pixels that still let light pass."""
    n, model = place.subpixels, style.model
    left = first_inside(record["left"], place.x, n)
    right = last_inside(record["right"], place.x, n, pixel.shape[1])
    top = first_inside(record["top"], place.y, n)
    bottom = last_inside(record["bottom"], place.y, n, pixel.shape[0])
    if left >= right or top >= bottom:
        return
    _mark(dirty, top, bottom, left, right)
    chord = _chord(record, rays)
    a, b, c, cone = record["a"], record["b"], record["c"], record["cone"]
    light = light_of(record, style)
    depth, value, amplitude = light[3], record["extinction"], record["amplitude"]
    opaque, two, step = np.float32(style.opaque), np.float32(2.0), np.float32(1.0 / n)
    zero, one = np.float32(0.0), np.float32(1.0)
    front, back = np.float32(bounds.front - depth), np.float32(bounds.back - depth)
    form_start = np.float32(place.x + 0.5 / n - record["form_x"])
    start = np.float32(place.x + 0.5 / n - record["x"])
    for row in range(top, bottom):
        form_dy = np.float32(place.y + (row + 0.5) / n - record["form_y"])
        dy = np.float32(place.y + (row + 0.5) / n - record["y"])
        cross, rest = two * b * form_dy, c * form_dy * form_dy
        lean_cross = chord.p + two * chord.ab * dy
        lean_rest = (chord.q + chord.bb * dy) * dy
        for column in range(left, right):
            if pixel[row, column, 3] <= opaque:
                continue
            form_dx = form_start + np.float32(column) * step
            squared = max(zero, (a * form_dx + cross) * form_dx + rest)
            squared = _true_index(squared, ray[row, column, 0], model, cone, correction)
            if squared >= one:
                continue
            dx, along = start + np.float32(column) * step, ray[row, column, 2]
            lean = ((chord.aa * dx + lean_cross) * dx + lean_rest) * ray[row, column, 0]
            low = (max(front, ray[row, column, 4] - depth) + lean) * along
            high = (min(back, ray[row, column, 5] - depth) + lean) * along
            nearest = max(zero, low, -high)
            if nearest * nearest + squared >= one:  # the kernel lies beyond one of the planes
                continue
            if model == EXACT:
                amplitude = ray[row, column, 1]
            integral = amplitude * partial_integral(partial, squared, low, high)
            if integral <= zero:
                continue
            _deposit(slab, row, column, integral, density, light, value)


@kernel
def add_cut_splat(
    slab: Floats,
    dirty: Corners,
    pixel: Floats,
    ray: Floats,
    place: Place,
    record: Record,
    bounds: Slab,
    view: View,
    ellipsoid: Ellipsoid,
    density: Single,
    style: Style,
    partial: Floats,
) -> None:
    """Like `add_splat`, of a sphere that the near plane or a clipping plane cuts."""
    n, center = place.subpixels, (record["a"], record["b"], record["c"])
    left = first_inside(record["left"], place.x, n)
    right = last_inside(record["right"], place.x, n, pixel.shape[1])
    top = first_inside(record["top"], place.y, n)
    bottom = last_inside(record["bottom"], place.y, n, pixel.shape[0])
    if left >= right or top >= bottom:
        return
    _mark(dirty, top, bottom, left, right)
    light = light_of(record, style)
    for row in range(top, bottom):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(left, right):
            if pixel[row, column, 3] <= style.opaque:
                continue
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            span = (
                max(bounds.front, float(ray[row, column, 4])),
                min(bounds.back, float(ray[row, column, 5])),
            )
            integral = np.float32(cut_integral(center, x, y, span, view, ellipsoid, partial))
            if integral <= np.float32(0.0):
                continue
            _deposit(slab, row, column, integral, density, light, record["extinction"])


@kernel
def share_of_mass(
    record: Record,
    place: Place,
    rays: Rays,
    style: Style,
    scale: float,
    partial: Floats,
    correction: Floats,
) -> Single:
    """Factor by which the sub-pixels' line integrals along parallel rays sum to a splat's mass."""
    n = place.subpixels
    left = math.ceil((record["left"] - place.x) * n - 0.5)
    right = math.floor((record["right"] - place.x) * n - 0.5)
    top = math.ceil((record["top"] - place.y) * n - 0.5)
    bottom = math.floor((record["bottom"] - place.y) * n - 0.5)
    a, b, c, cone = record["a"], record["b"], record["c"], record["cone"]
    per_square = np.float32(1.0 / dot(rays.ahead, rays.ahead))
    amplitude = scale * math.sqrt(per_square)
    if style.model != EXACT:
        amplitude = record["amplitude"]
    total = 0.0
    for row in range(top, bottom + 1):
        dy = np.float32(place.y + (row + 0.5) / n - record["form_y"])
        for column in range(left, right + 1):
            dx = np.float32(place.x + (column + 0.5) / n - record["form_x"])
            squared = max(np.float32(0.0), (a * dx + np.float32(2.0) * b * dy) * dx + c * dy * dy)
            squared = _true_index(squared, per_square, style.model, cone, correction)
            total += partial_integral(partial, squared, np.float32(-1.0), np.float32(1.0))
    if not total > 0.0:
        return np.float32(0.0)
    return np.float32(record["mass"] * (n * n) / (amplitude * total))


@kernel
def add_thin_point(
    slab: Floats,
    dirty: Corners,
    place: Place,
    record: Record,
    density: Single,
    style: Style,
    profile: Floats,
    across: Floats,
    down: Floats,
) -> None:
    """Add a sample as a point whose line integrals are its mass, spread by the points' filter.

    That filter is as wide as the kernel's projection, so points add up as splats do, however thick
    a slab is. `across` and `down` are room to work in, as `add_point` takes them.
    """
    mass = np.float32(record["mass"] * (place.subpixels * place.subpixels))
    box = box_of_point(slab, place, record, style, profile, across, down)
    if box.top >= box.bottom or box.left >= box.right:
        return
    _mark(dirty, box.top, box.bottom, box.left, box.right)
    red, green, blue, depth = record["red"], record["green"], record["blue"], record["depth"]
    one, value, zero = np.float32(1.0), record["extinction"], np.float32(0.0)
    for row in range(box.top, box.bottom):
        seen = mass * down[row - box.first_row]
        for column in range(box.left, box.right):
            integral = seen * across[column - box.first_column]
            weight = integral * density
            slab[row, column, 0] += weight * one  # eight products: one instruction
            slab[row, column, 1] += weight * red
            slab[row, column, 2] += weight * green
            slab[row, column, 3] += weight * blue
            slab[row, column, 4] += weight * depth
            slab[row, column, 5] += integral * one
            slab[row, column, 6] += weight * value
            slab[row, column, 7] += weight * zero
