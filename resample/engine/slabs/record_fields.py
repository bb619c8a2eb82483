"""Slabs of a field that were summed from records; see `resample.engine.slabs.fields`."""

import math

import numpy as np

from resample.engine.jit import kernel
from resample.engine.over import behind
from resample.engine.slabs.fields import AT_DEPTH as DEPTH
from resample.engine.slabs.fields import (
    HALF,
    PRESENCE,
    SLAB,
    SLOPE,
    VALUE,
    length_of,
    looked_up,
    place_at,
    seen_color,
)
from resample.engine.slabs.slabs import Corners, Slab
from resample.engine.vectors import Vector
from resample.types import (
    ADDITIVE,
    COMPOSITE,
    FIRST_HIT,
    MAXIMUM,
    Classifier,
    Floats,
    Place,
    Style,
    View,
)


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
    look: Classifier,
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
                    red, green, blue, extinction = looked_up(look, value, length_of(slope))
                    if extinction > 0.0:
                        at = place_at(row, column, middle, place, view)
                        light = seen_color((red, green, blue), slope, at, middle, look)
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
    look: Classifier,
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
        red, green, blue, _ = looked_up(look, style.iso, length_of(slope))
        at = place_at(row, column, at_depth, place, view)
        light = seen_color((red, green, blue), slope, at, at_depth, look)
        _put_behind(pixel, row, column, 1.0, light, at_depth)
        return 1
    state[row, column, VALUE], state[row, column, DEPTH] = value, middle
    state[row, column, PRESENCE], state[row, column, SLAB] = 1.0, number
    for axis in range(3):
        state[row, column, SLOPE + axis] = slope[axis]
    return 0


@kernel
def develop(state: Floats, pixel: Floats, voxel: float, style: Style, look: Classifier) -> None:
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
