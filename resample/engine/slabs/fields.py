"""Slabs of a field: reconstructed values are classified and lit, or projected (Mueller 1999).

Mueller, Möller and Crawfis, Splatting without the Blur, 1999: what a slab sums are values and
gradients, and only the mean of them gets a color. A slab's mean value is v = Σ w v / Σ w, and its
opacity that of the length Σ w. Where a faint tail would count in full, in a maximum or as a
surface, the value falls toward the classifier's lowest one as samples cover less than half of the
slab.
"""

import math

import numpy as np

from resample.engine.canvas import Home
from resample.engine.jit import kernel
from resample.engine.over import behind
from resample.engine.slabs.lighting import lit
from resample.engine.slabs.slabs import Corners, Slab
from resample.engine.vectors import Vector
from resample.types import (
    ADDITIVE,
    COMPOSITE,
    FIRST_HIT,
    MAXIMUM,
    Floats,
    Lamp,
    Palette,
    Place,
    Style,
    View,
)

HALF = 0.5  # of a slab that samples must cover for their mean to stand as it is

# What the projection of a sub-pixel has seen so far (h, w, 8).
VALUE, DEPTH, PRESENCE, SLOPE, SLAB = 0, 1, 2, 3, 6


@kernel
def looked_up(look: Palette, value: float, gradient: float) -> tuple[float, float, float, float]:
    """Color and extinction at a value's position 0..1 between low and high, and a gradient."""
    table = look.table
    row = max(0.0, min(1.0, gradient / look.steep)) * (table.shape[0] - 1)
    column = max(0.0, min(1.0, value)) * (table.shape[1] - 1)
    r = min(int(row), max(0, table.shape[0] - 2))
    c = min(int(column), max(0, table.shape[1] - 2))
    down, right = row - r, column - c
    below, after = min(r + 1, table.shape[0] - 1), min(c + 1, table.shape[1] - 1)
    first = (1.0 - down) * (1.0 - right)
    second, third, fourth = (1.0 - down) * right, down * (1.0 - right), down * right
    return (
        first * table[r, c, 0]
        + second * table[r, after, 0]
        + third * table[below, c, 0]
        + fourth * table[below, after, 0],
        first * table[r, c, 1]
        + second * table[r, after, 1]
        + third * table[below, c, 1]
        + fourth * table[below, after, 1],
        first * table[r, c, 2]
        + second * table[r, after, 2]
        + third * table[below, c, 2]
        + fourth * table[below, after, 2],
        first * table[r, c, 3]
        + second * table[r, after, 3]
        + third * table[below, c, 3]
        + fourth * table[below, after, 3],
    )


@kernel
def _length(v: Vector) -> float:
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


@kernel
def _place_at(row: int, column: int, depth: float, place: Place, view: View) -> Vector:
    """Scene position of a sub-pixel's point at a depth."""
    n = place.subpixels
    x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
    y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
    if view.perspective:
        x, y = depth * x, depth * y
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
def _seen_color(
    color: Vector, slope: Vector, at: Vector, depth: float, look: Palette, lamp: Lamp
) -> Vector:
    """Light of a surface, dimmed by its depth."""
    light = lit(color, slope, at, lamp)
    far = max(0.0, min(1.0, (depth - look.near) / (look.far - look.near)))
    kept = 1.0 - look.dimmed * far
    return (kept * light[0], kept * light[1], kept * light[2])


@kernel
def take_in_slab(
    slab: Floats,
    state: Floats,
    dirty: Corners,
    pixel: Floats,
    ray: Floats,
    place: Place,
    bounds: Slab,
    number: int,
    view: View,
    style: Style,
    look: Palette,
    lamp: Lamp,
) -> int:
    """Let the projection see a slab of a field, and empty that; gives how many pixels it closed."""
    closed = 0
    first_row, last_row, first_column, last_column = dirty
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            weight = float(slab[row, column, 0])
            if weight > 0.0 and pixel[row, column, 3] > style.opaque:
                front = max(bounds.front, float(ray[row, column, 4]))
                back = min(bounds.back, float(ray[row, column, 5]))
                path = (back - front) * ray[row, column, 3]
                covered = weight
                if style.projection in (MAXIMUM, FIRST_HIT):
                    covered = max(weight, HALF * path)
                value = slab[row, column, 6] / covered
                slope = (
                    slab[row, column, 1] / weight,
                    slab[row, column, 2] / weight,
                    slab[row, column, 3] / weight,
                )
                depth = slab[row, column, 4] / weight
                middle = depth if math.isinf(path) else 0.5 * (front + back)
                pixel[row, column, 5] += np.float32(weight / style.layer)
                if style.projection == COMPOSITE:
                    red, green, blue, extinction = looked_up(look, value, _length(slope))
                    if extinction > 0.0:
                        at = _place_at(row, column, middle, place, view)
                        light = _seen_color((red, green, blue), slope, at, middle, look, lamp)
                        alpha = -math.expm1(-extinction * weight)
                        if style.linear_opacity:
                            of_layer = -math.expm1(-extinction * style.layer)
                            alpha = min(1.0, of_layer * weight / style.layer)
                        after = _put_behind(pixel, row, column, alpha, light, middle)
                        closed += 1 if after <= style.opaque else 0
                elif style.projection == FIRST_HIT:
                    closed += _look_for_hit(
                        state,
                        pixel,
                        row,
                        column,
                        value,
                        slope,
                        middle,
                        front,
                        number,
                        place,
                        view,
                        style,
                        look,
                        lamp,
                    )
                elif style.projection == MAXIMUM:
                    if state[row, column, PRESENCE] == 0.0 or value > state[row, column, VALUE]:
                        state[row, column, VALUE] = value
                        state[row, column, DEPTH] = middle
                    state[row, column, PRESENCE] += weight
                else:
                    if style.projection == ADDITIVE:
                        value = slab[row, column, 6]
                    state[row, column, VALUE] = value
                    state[row, column, DEPTH] = depth
                    state[row, column, PRESENCE] = weight
            for channel in range(8):
                slab[row, column, channel] = 0.0
    dirty[0], dirty[2] = slab.shape[0], slab.shape[1]
    dirty[1], dirty[3] = 0, 0
    return closed


@kernel
def _put_behind(
    pixel: Floats, row: int, column: int, alpha: float, light: Vector, depth: float
) -> float:
    color = (np.float32(light[0]), np.float32(light[1]), np.float32(light[2]), np.float32(depth))
    return float(behind(pixel, row, column, np.float32(alpha), color))


@kernel
def _look_for_hit(
    state: Floats,
    pixel: Floats,
    row: int,
    column: int,
    value: float,
    slope: Vector,
    middle: float,
    front: float,
    number: int,
    place: Place,
    view: View,
    style: Style,
    look: Palette,
    lamp: Lamp,
) -> int:
    """Paint where the field passes the wanted value between two slabs; gives 1 if it does.

    A ray that meets the field at or above the value, where a plane cuts it, hits it there.
    """
    before, at_depth, blend = 0.0, front, 1.0
    is_next = state[row, column, PRESENCE] > 0.0 and state[row, column, SLAB] == number - 1
    if is_next:
        before = float(state[row, column, VALUE])
    hit = (before < style.iso) != (value < style.iso)
    if hit:
        if is_next:
            blend = (style.iso - before) / (value - before)
            at_depth = state[row, column, DEPTH] + blend * (middle - state[row, column, DEPTH])
            slope = (
                state[row, column, SLOPE] * (1.0 - blend) + slope[0] * blend,
                state[row, column, SLOPE + 1] * (1.0 - blend) + slope[1] * blend,
                state[row, column, SLOPE + 2] * (1.0 - blend) + slope[2] * blend,
            )
        red, green, blue, _ = looked_up(look, style.iso, _length(slope))
        at = _place_at(row, column, at_depth, place, view)
        light = _seen_color((red, green, blue), slope, at, at_depth, look, lamp)
        _put_behind(pixel, row, column, 1.0, light, at_depth)
        return 1
    state[row, column, VALUE], state[row, column, DEPTH] = value, middle
    state[row, column, PRESENCE], state[row, column, SLAB] = 1.0, number
    for axis in range(3):
        state[row, column, SLOPE + axis] = slope[axis]
    return 0


@kernel
def develop(state: Floats, pixel: Floats, voxel: float, style: Style, look: Palette) -> None:
    """Give colors to what the projection has measured; its value is left in data units.

    Colors are as opaque as a `voxel` (scene units) of that value, where the field is that long.
    """
    span = look.high - look.low
    for row in range(state.shape[0]):
        for column in range(state.shape[1]):
            presence = float(state[row, column, PRESENCE])
            if presence <= 0.0:
                continue
            alpha, seen = min(1.0, presence / voxel), 1.0
            value, depth = float(state[row, column, VALUE]), float(state[row, column, DEPTH])
            if style.projection == ADDITIVE:
                state[row, column, VALUE] = look.low * presence + span * value
                light = (0.0, 0.0, 0.0)
            else:
                red, green, blue, extinction = looked_up(look, value, 0.0)
                seen = -math.expm1(-extinction * voxel)
                light = (red, green, blue)
                state[row, column, VALUE] = look.low + span * value
            state[row, column, PRESENCE] = alpha
            _put_behind(pixel, row, column, alpha * seen, light, depth)


@kernel
def resolve_value(
    state: Floats, n: int, weight: Floats, home: Home, additive: bool, value: Floats
) -> None:
    """Filter what sub-pixels have measured to pixels of `value` (H, W), NaN where nothing is."""
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
            if additive:
                value[row, column] = total
            elif share > 0.0:
                value[row, column] = total / share
