"""Slabs of a field: reconstructed values are classified and lit, or projected (Mueller 1999).

Mueller, Möller and Crawfis, Splatting without the Blur, 1999: a slab sums values and gradients, and
only their mean is classified. A slab's mean value is v = Σ w v / Σ w, and its opacity that of the
length Σ w. In a maximum or a surface a faint tail would count in full; there the value falls toward
the classifier's lowest one as samples cover less than half of the slab.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.compositing import VISIBLE
from resample.engine.ellipsoids.rows import ALPHA, BLUE, DEPTH, FIRST, GREEN, RED, index_of
from resample.engine.ellipsoids.splats import clipped_span
from resample.engine.jit import kernel
from resample.engine.lighting import classified, length_of, shaded_color
from resample.engine.subpixels import Home
from resample.engine.vectors import Vector
from resample.types import (
    ADDITIVE,
    FIRST_HIT,
    MAXIMUM,
    Floats,
    Place,
    View,
)
from resample_comparisons.volume.kernels.slabs.blends import Values
from resample_comparisons.volume.kernels.slabs.sums import (
    PLANES,
    Canvas,
    Ring,
    Slab,
    SphereCut,
    clean,
    stride_of,
    sum_at,
)

HALF = 0.5  # share of a slab that samples must cover for their mean to hold

# State of a sub-pixel's projection, and between which depths its ray is not clipped.
VALUE, AT_DEPTH, PRESENCE, SLOPE, SLAB, START, END, WAY = 0, 1, 2, 3, 6, 7, 8, 9
STATES = 10


class Sum(NamedTuple):
    """The sums of a slab on a sub-pixel."""

    weight: float
    x: float  # of the gradients; where the field is measured, depths
    y: float
    z: float
    value: float


@kernel
def new_state(height: int, width: int, cutting: SphereCut) -> Floats:
    """Allocate the state of a tile's rays: lengths per depth, and depths where they are clipped."""
    place, camera, _, planes, _ = cutting
    state, n = np.zeros((height + 1, width, STATES), np.float32), place.subpixels
    for row in range(height):
        for column in range(width):
            # Clip each ray to the planes.
            x = (place.x + (column + 0.5) / n - camera.principal[0]) / camera.focal[0]
            y = (place.y + (row + 0.5) / n - camera.principal[1]) / camera.focal[1]
            state[row, column, START], state[row, column, END] = clipped_span(x, y, camera, planes)
            # Length of the ray per unit of depth.
            way = math.sqrt(1.0 + x * x + y * y) if camera.perspective else 1.0
            state[row, column, WAY] = way
    return state


@kernel
def place_at(row: int, column: int, depth: float, place: Place, view: View) -> Vector:
    """Scene position of a sub-pixel's ray at a depth."""
    # Unproject the sub-pixel's center to camera axes.
    n = place.subpixels
    x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
    y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
    if view.perspective:
        x, y = depth * x, depth * y
    # Transform to scene axes.
    x -= view.translation[0]
    y -= view.translation[1]
    z = depth - view.translation[2]
    turn = view.rotation
    return (
        turn[0, 0] * x + turn[1, 0] * y + turn[2, 0] * z,
        turn[0, 1] * x + turn[1, 1] * y + turn[2, 1] * z,
        turn[0, 2] * x + turn[1, 2] * y + turn[2, 2] * z,
    )


@kernel
def _put_behind(rows: Floats, k: np.uint64, alpha: float, light: Vector, depth: float) -> float:
    """Composite a color under a sub-pixel; return the transmittance left."""
    share = (np.float32(1.0) - rows[k + ALPHA]) * np.float32(alpha)
    rows[k + RED] += share * np.float32(light[0])
    rows[k + GREEN] += share * np.float32(light[1])
    rows[k + BLUE] += share * np.float32(light[2])
    rows[k + ALPHA] += share
    rows[k + DEPTH] += share * np.float32(depth)
    # Note the depth where the sub-pixel first becomes visible.
    if rows[k + FIRST] == np.inf and rows[k + ALPHA] > np.float32(VISIBLE):
        rows[k + FIRST] = np.float32(depth)
    return float(np.float32(1.0) - rows[k + ALPHA])


@kernel
def take_in_values(
    blend: Values, canvas: Canvas, ring: Ring, slab: Slab, cutting: SphereCut, opaque: float
) -> None:
    """Classify or project a slab of a field on all its sub-pixels, and clear it."""
    # Visit only what was touched.
    rows, sums, state, zero = canvas.rows, canvas.sums, canvas.state, np.float32(0.0)
    stride = stride_of(ring)
    first, last, left, right = clean(canvas.dirty, slab.slot)
    for pair in range(first, last):
        for lane in range(2 * left, 2 * right):
            row, column = 2 * pair + (lane & 1), lane >> 1
            s = sum_at(ring, slab.slot, pair, column) + np.uint64(lane & 1)
            # Load the five sums.
            found = Sum(
                float(sums[s]),
                float(sums[s + stride]),
                float(sums[s + np.uint64(2) * stride]),
                float(sums[s + np.uint64(3) * stride]),
                float(sums[s + np.uint64(4) * stride]),
            )
            k = index_of(row, column)
            # Project them where there is something and the sub-pixel is not opaque yet.
            if found.weight > 0.0 and np.float32(1.0) - rows[k + ALPHA] > opaque:
                if blend.is_measured:
                    _measure(blend, state[row, column], found)
                else:
                    _classify_mean(blend, canvas, row, column, found, slab, cutting)
            # Clear the sums for the next slab of this slot.
            for number in range(PLANES):
                sums[s + np.uint64(number) * stride] = zero


@kernel
def _measure(blend: Values, state: Floats, found: Sum) -> None:
    """Note the sum of all values of a ray, or their mean."""
    state[VALUE] = found.value if blend.projection == ADDITIVE else found.value / found.weight
    state[AT_DEPTH] = found.x / found.weight
    state[PRESENCE] = found.weight


@kernel
def _classify_mean(
    blend: Values,
    canvas: Canvas,
    row: int,
    column: int,
    found: Sum,
    slab: Slab,
    cutting: SphereCut,
) -> None:
    """Classify a slab's mean, or update the maximum or the search for a surface by it."""
    # Clip the slab to the visible part of the ray.
    rows, state, classifier = canvas.rows, canvas.state, blend.classifier
    weight, k = found.weight, index_of(row, column)
    front = max(slab.front, float(state[row, column, START]))
    back = min(slab.back, float(state[row, column, END]))
    # For a maximum or a surface, faint tails count for less.
    covered, middle = weight, 0.5 * (front + back)
    if blend.projection in (MAXIMUM, FIRST_HIT):
        covered = max(weight, HALF * (back - front) * state[row, column, WAY])
    value = found.value / covered
    # Keep the maximum.
    if blend.projection == MAXIMUM:
        if state[row, column, PRESENCE] == 0.0 or value > state[row, column, VALUE]:
            state[row, column, VALUE] = value
            state[row, column, AT_DEPTH] = middle
        state[row, column, PRESENCE] += weight
        return
    # Search for a surface.
    slope = (found.x / weight, found.y / weight, found.z / weight)
    if blend.projection == FIRST_HIT:
        _find_hit(blend, canvas, (row, column), value, slope, (middle, front), slab, cutting)
        return
    # Composite: classify the mean value and gradient, shade, and convert length to opacity.
    red, green, blue, extinction = classified(classifier, value, length_of(slope))
    if extinction > 0.0:
        at = place_at(row, column, middle, cutting.place, cutting.camera)
        light = shaded_color((red, green, blue), slope, at, middle, classifier)
        alpha = -math.expm1(-extinction * weight)
        if blend.is_linear:
            of_layer = -math.expm1(-extinction * blend.layer)
            alpha = min(1.0, of_layer * weight / blend.layer)
        _put_behind(rows, k, alpha, light, middle)


@kernel
def _find_hit(
    blend: Values,
    canvas: Canvas,
    pixel: tuple[int, int],
    value: float,
    slope: Vector,
    depths: tuple[float, float],
    slab: Slab,
    cutting: SphereCut,
) -> None:
    """Paint the surface where the field crosses the wanted value between two slabs.

    A ray that enters the field at or above the value, at a clip plane, hits the surface there. The
    depths are those of the slab's middle and front on the ray.
    """
    # Compare with the slab just in front, if the ray has met it.
    (row, column), (middle, front) = pixel, depths
    state, classifier, number = canvas.state[row, column], blend.classifier, np.float32(slab.number)
    before, at_depth, share = 0.0, front, 1.0
    is_next = state[PRESENCE] > 0.0 and state[SLAB] == number - np.float32(1.0)
    if is_next:
        before = float(state[VALUE])
    # On a crossing, interpolate depth and gradient linearly between the slabs.
    if (before < blend.iso) != (value < blend.iso):
        if is_next:
            share = (blend.iso - before) / (value - before)
            at_depth = state[AT_DEPTH] + share * (middle - state[AT_DEPTH])
            slope = (
                state[SLOPE] * (1.0 - share) + slope[0] * share,
                state[SLOPE + 1] * (1.0 - share) + slope[1] * share,
                state[SLOPE + 2] * (1.0 - share) + slope[2] * share,
            )
        # Shade the hit, and paint it opaque.
        red, green, blue, _ = classified(classifier, blend.iso, length_of(slope))
        at = place_at(row, column, at_depth, cutting.place, cutting.camera)
        light = shaded_color((red, green, blue), slope, at, at_depth, classifier)
        _put_behind(canvas.rows, index_of(row, column), 1.0, light, at_depth)
        return
    # Else keep this slab's values for the next one.
    state[VALUE], state[AT_DEPTH] = value, middle
    state[PRESENCE], state[SLAB] = 1.0, number
    for axis in range(3):
        state[SLOPE + axis] = slope[axis]


@kernel
def develop(blend: Values, canvas: Canvas) -> None:
    """Color what the projection has measured, and scale values to data units.

    Colors are as opaque as a voxel of that value, where the field is at least a voxel long.
    """
    classifier, voxel = blend.classifier, blend.voxel
    span = classifier.high - classifier.low
    for row in range(canvas.height):
        for column in range(canvas.width):
            state = canvas.state[row, column]
            presence = float(state[PRESENCE])
            # Skip rays that met nothing.
            if presence <= 0.0:
                continue
            alpha, seen = min(1.0, presence / voxel), 1.0
            value, depth = float(state[VALUE]), float(state[AT_DEPTH])
            # An integral keeps its value, without a color.
            if blend.projection == ADDITIVE:
                state[VALUE] = classifier.low * presence + span * value
                light = (0.0, 0.0, 0.0)
            else:
                # Others are classified, and as opaque as one voxel.
                red, green, blue, extinction = classified(classifier, value, 0.0)
                seen = -math.expm1(-extinction * voxel)
                light = (red, green, blue)
                state[VALUE] = classifier.low + span * value
            # Composite the color by the length of the field on the ray.
            state[PRESENCE] = alpha
            _put_behind(canvas.rows, index_of(row, column), alpha * seen, light, depth)


@kernel
def resolve_value(
    state: Floats, n: int, weight: Floats, home: Home, additive: bool, value: Floats
) -> None:
    """Filter sub-pixels' values to pixels of `value` (H, W), left as they are where none is."""
    # Convolve with the pixel filter, weighed by presence unless values are integrals.
    for row in range(home.top, min(home.top + home.size, value.shape[0])):
        for column in range(home.left, min(home.left + home.size, value.shape[1])):
            total = share = 0.0
            for down in range(weight.size):
                r = (row - home.top) * n + down
                for right in range(weight.size):
                    c = (column - home.left) * n + right
                    part = float(weight[down] * weight[right])
                    if not additive:
                        part *= state[r, c, PRESENCE]
                    total += part * state[r, c, VALUE]
                    share += part
            # Normalize means by their weights.
            if additive:
                value[row, column] = total
            elif share > 0.0:
                value[row, column] = total / share
