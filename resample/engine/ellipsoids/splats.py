"""Scan-convert one splat and composite it, by the model of its footprint."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import (
    absorbed,
    corrected_distance,
    partial_integral,
    unit_lookup,
)
from resample.engine.over import Light, behind
from resample.engine.vectors import Vector
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


@kernel
def first_inside(bound: float, origin: float, subpixels: int) -> int:
    """First sub-pixel whose center is not before `bound` px."""
    return max(0, math.ceil((bound - origin) * subpixels - 0.5))


@kernel
def last_inside(bound: float, origin: float, subpixels: int, count: int) -> int:
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
def light_of(record: Record, style: Style) -> Light:
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
    light, extinction = light_of(record, style), record["extinction"]
    a, b, c = record["a"], record["b"], record["c"]
    amplitude, cone = record["amplitude"], record["cone"]
    sine = np.float32(math.sin(cone))
    opaque, per_layer = np.float32(style.opaque), np.float32(1.0 / style.layer)
    left = first_inside(record["left"], place.x, n)
    right = last_inside(record["right"], place.x, n, pixel.shape[1])
    top = first_inside(record["top"], place.y, n)
    bottom = last_inside(record["bottom"], place.y, n, pixel.shape[0])
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
            elif model == DISC:
                squared *= ray[row, column, 0]
                squared /= np.float32(1.0) - squared * sine * sine
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
def seen_span(x: float, y: float, view: View, planes: Doubles) -> tuple[float, float]:
    """Depths between which a ray is seen: from the near plane on, between clipping planes (M, 5).

    x and y are the ray's place at depth 1, or at any depth where rays are parallel.
    """
    start, end = view.near, np.inf
    for n in range(planes.shape[0]):
        across = planes[n, 0] * x + planes[n, 1] * y
        rise, offset = planes[n, 2], planes[n, 3]
        if view.perspective:
            rise += across
        else:
            offset += across
        if rise > 0.0:
            start = max(start, -offset / rise)
        elif rise < 0.0:
            end = min(end, -offset / rise)
        elif offset < 0.0:
            end = -np.inf
    return start, end


@kernel
def cut_integral(
    center: Vector,
    x: float,
    y: float,
    span: tuple[float, float],
    view: View,
    ellipsoid: Ellipsoid,
    partial: Floats,
) -> float:
    """Line integral of a cut sphere along a ray, between two depths; x and y as in `seen_span`.

    Its center is in the space where the ellipsoid is the unit sphere.
    All models agree here: the ray's distance and the part of its chord that is seen are direct.
    """
    unit = ellipsoid.to_unit
    shift = x if view.perspective else 0.0
    drop = y if view.perspective else 0.0
    # The ray's direction, of depth 1, and the way from its origin to the center.
    wx = unit[0, 0] * shift + unit[0, 1] * drop + unit[0, 2]
    wy = unit[1, 0] * shift + unit[1, 1] * drop + unit[1, 2]
    wz = unit[2, 0] * shift + unit[2, 1] * drop + unit[2, 2]
    px = center[0] - unit[0, 0] * (x - shift) - unit[0, 1] * (y - drop)
    py = center[1] - unit[1, 0] * (x - shift) - unit[1, 1] * (y - drop)
    pz = center[2] - unit[2, 0] * (x - shift) - unit[2, 1] * (y - drop)
    squared_length = wx * wx + wy * wy + wz * wz
    foot = (px * wx + py * wy + pz * wz) / squared_length  # depth of the nearest point
    px, py, pz = px - foot * wx, py - foot * wy, pz - foot * wz
    length = math.sqrt(squared_length)
    share = partial_integral(
        partial,
        np.float32(px * px + py * py + pz * pz),
        np.float32((span[0] - foot) * length),
        np.float32((span[1] - foot) * length),
    )
    along = math.sqrt(1.0 + shift * shift + drop * drop) / length
    return float(ellipsoid.scale * along * share)


@kernel
def paint_cut_splat(
    pixel: Floats,
    place: Place,
    record: Record,
    view: View,
    ellipsoid: Ellipsoid,
    planes: Doubles,
    style: Style,
    partial: Floats,
) -> int:
    """Composite what is seen of a sphere that the near plane or a clipping plane cuts."""
    n, closed, center = place.subpixels, 0, (record["a"], record["b"], record["c"])
    light, extinction = light_of(record, style), record["extinction"]
    left = first_inside(record["left"], place.x, n)
    right = last_inside(record["right"], place.x, n, pixel.shape[1])
    top = first_inside(record["top"], place.y, n)
    bottom = last_inside(record["bottom"], place.y, n, pixel.shape[0])
    for row in range(top, bottom):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(left, right):
            if pixel[row, column, 3] <= style.opaque:
                continue
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            span = seen_span(x, y, view, planes)
            integral = np.float32(cut_integral(center, x, y, span, view, ellipsoid, partial))
            if integral <= np.float32(0.0):
                continue
            after = behind(pixel, row, column, opacity(integral, extinction, style), light)
            pixel[row, column, 5] += np.float32(integral / style.layer)
            if after <= style.opaque:
                closed += 1
    return closed
