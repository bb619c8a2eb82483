"""Scan-convert one splat and composite it, by the model of its footprint."""

import math

import numpy as np

from resample.kernels.jit import kernel
from resample.kernels.lookup import absorbed, corrected_distance, radial, unit_lookup
from resample.kernels.over import Light, behind
from resample.types import (
    AFFINE,
    EXACT,
    Ellipsoid,
    Floats,
    Place,
    Record,
    Single,
    Style,
    View,
)

# Gauss-Legendre nodes for the few spheres that the near plane cuts.
NODE, WEIGHT = np.polynomial.legendre.leggauss(24)


@kernel
def _first(bound: float, origin: float, subpixels: int) -> int:
    """First sub-pixel whose center is not before `bound` px."""
    return max(0, math.ceil((bound - origin) * subpixels - 0.5))


@kernel
def _last(bound: float, origin: float, subpixels: int, count: int) -> int:
    """One past the last sub-pixel whose center is not after `bound` px."""
    return min(count, math.floor((bound - origin) * subpixels - 0.5) + 1)


@kernel
def opacity(integral: Single, extinction: Single, style: Style) -> Single:
    """Opacity of a line integral: exact, or the classic α × F, which is linear in it."""
    if style.linear_opacity:
        alpha = absorbed(extinction * np.float32(style.layer))
        return min(np.float32(1.0), alpha * integral / np.float32(style.layer))
    return absorbed(extinction * integral)


@kernel
def _light(record: Record, style: Style) -> Light:
    """Color and depth of a splat; its color is the marker's where splats are to be told apart."""
    red, green, blue = record["red"], record["green"], record["blue"]
    if style.tint_red >= 0.0:
        brightest = max(red, green, blue)
        red = np.float32(brightest * style.tint_red)
        green = np.float32(brightest * style.tint_green)
        blue = np.float32(brightest * style.tint_blue)
    return (red, green, blue, record["depth"])


@kernel
def paint_splat(
    pixel: Floats,
    ray: Floats,
    place: Place,
    record: Record,
    style: Style,
    table: Floats,
    correction: Floats,
) -> int:
    """Composite one splat onto the sub-pixels of its footprint; gives how many it made opaque."""
    n, model = place.subpixels, style.model
    light, extinction = _light(record, style), record["extinction"]
    a, b, c = record["a"], record["b"], record["c"]
    amplitude, cone = record["amplitude"], record["cone"]
    opaque, per_layer = np.float32(style.opaque), np.float32(1.0 / style.layer)
    left = _first(record["left"], place.x, n)
    right = _last(record["right"], place.x, n, pixel.shape[1])
    top = _first(record["top"], place.y, n)
    bottom = _last(record["bottom"], place.y, n, pixel.shape[0])
    step = np.float32(1.0 / n)
    start = np.float32(place.x + 0.5 / n - record["form_x"])
    closed = 0
    for row in range(top, bottom):
        dy = np.float32(place.y + (row + 0.5) / n - record["form_y"])
        cross, rest = np.float32(2.0) * b * dy, c * dy * dy
        for column in range(left, right):
            if pixel[row, column, 3] <= opaque:
                continue
            dx = start + np.float32(column) * step
            squared = max(np.float32(0.0), (a * dx + cross) * dx + rest)
            if model == EXACT:
                squared *= ray[row, column, 0]
                amplitude = ray[row, column, 1]
            elif model != AFFINE:
                distance = corrected_distance(correction, math.sqrt(squared), cone)
                squared = np.float32(distance * distance)
            integral = amplitude * unit_lookup(table, squared)
            if integral <= np.float32(0.0):
                continue
            after = behind(pixel, row, column, opacity(integral, extinction, style), light)
            pixel[row, column, 5] += integral * per_layer
            if after <= opaque:
                closed += 1
    return closed


@kernel
def integral_beyond(density: Floats, squared: float, start: float) -> float:
    """Integral of the unit kernel along a line from `start` radii past its nearest point on."""
    if squared >= 1.0:
        return 0.0
    half = math.sqrt(1.0 - squared)
    low = max(-half, start)
    if low >= half:
        return 0.0
    total = 0.0
    for node in range(NODE.size):
        along = 0.5 * (half - low) * NODE[node] + 0.5 * (half + low)
        total += WEIGHT[node] * radial(density, 1.0, squared + along * along)
    return 0.5 * (half - low) * total


@kernel
def paint_splat_across_near(
    pixel: Floats,
    place: Place,
    record: Record,
    view: View,
    ellipsoid: Ellipsoid,
    style: Style,
    density: Floats,
) -> int:
    """Composite what lies beyond the near plane of a sphere that the plane cuts.

    All models agree here: the ray's distance and the part of its chord that is seen are direct.
    """
    n, unit, closed = place.subpixels, ellipsoid.to_unit, 0
    light, extinction = _light(record, style), record["extinction"]
    a, b, c = float(record["a"]), float(record["b"]), float(record["c"])
    for row in range(pixel.shape[0]):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(pixel.shape[1]):
            if pixel[row, column, 3] <= style.opaque:
                continue
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            shift = x if view.perspective else 0.0
            drop = y if view.perspective else 0.0
            # The ray's direction, of depth 1, and the way from its origin to the center.
            wx = unit[0, 0] * shift + unit[0, 1] * drop + unit[0, 2]
            wy = unit[1, 0] * shift + unit[1, 1] * drop + unit[1, 2]
            wz = unit[2, 0] * shift + unit[2, 1] * drop + unit[2, 2]
            px = a - unit[0, 0] * (x - shift) - unit[0, 1] * (y - drop)
            py = b - unit[1, 0] * (x - shift) - unit[1, 1] * (y - drop)
            pz = c - unit[2, 0] * (x - shift) - unit[2, 1] * (y - drop)
            squared_length = wx * wx + wy * wy + wz * wz
            foot = (px * wx + py * wy + pz * wz) / squared_length  # depth of the nearest point
            px, py, pz = px - foot * wx, py - foot * wy, pz - foot * wz
            squared = px * px + py * py + pz * pz
            length = math.sqrt(squared_length)
            integral = integral_beyond(density, squared, (view.near - foot) * length)
            if integral <= 0.0:
                continue
            integral *= ellipsoid.scale * math.sqrt(1.0 + shift * shift + drop * drop) / length
            alpha = opacity(np.float32(integral), extinction, style)
            after = behind(pixel, row, column, alpha, light)
            pixel[row, column, 5] += np.float32(integral / style.layer)
            if after <= style.opaque:
                closed += 1
    return closed
