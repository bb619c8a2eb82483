"""Ray setup and marching: clipping to the field, even steps, and skipping of empty bricks.

Positions along a ray are depths. Steps end at whole multiples of one length, so that neighbouring
steps share the value at the end between them.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step
from resample.engine.rays.coefficients import BRICK
from resample.engine.vectors import Vector, combine, dot, matrix_of, multiply
from resample.types import Doubles, Floats, View

SHIFT, LAST = int(math.log2(BRICK)), BRICK - 1

LEAST = 1e-30  # positions per depth, of a ray that is parallel to a wall

Emptiness = NDArray[np.uint8]
Bits = NDArray[np.uint64]


class SampleSpace(NamedTuple):
    """The field's placement in front of a camera."""

    start: Doubles  # (3,) position of the eye, samples
    turn: Doubles  # (3, 3) from camera axes to samples
    cells: Doubles  # (3,) along x, y and z; positions range from ½ to cells − ½
    step: float  # samples, longest step of a ray
    planes: Doubles  # (M, 5) as in `Screen`


class BrickBounds(NamedTuple):
    """Bounds of each brick of a field, and distances to the next visible one."""

    empty: Emptiness  # (N,) bricks to the next visible one along any axis, at least; 0: visible
    least: Floats  # (N,) data units
    greatest: Floats  # (N,) data units
    cells: Bits  # (N,) whether cells are visible, a bit each, x fastest; or (0,): all are
    across: int  # bricks along x
    down: int  # bricks along y
    deep: int  # bricks along z


class Ray(NamedTuple):
    """The part of a viewing ray that lies in a field."""

    start: Vector  # position at depth 0
    way: Vector  # positions per depth
    per_way: Vector  # depth per position
    per_thickness: float  # steps per depth
    enter: float  # depth
    steps: int
    thickness: float  # depth of a step
    length: float  # scene units per depth
    hint: float  # depth at which a ray beside it met what it shows; inf: unknown


@inner_step
def _cut(part: tuple[float, float], here: float, slope: float) -> tuple[float, float]:
    """Clip an interval of depths to where here + slope × depth is at least 0."""
    enter, leave = part
    if slope > 0.0:
        return max(enter, -here / slope), leave
    if slope < 0.0:
        return enter, min(leave, -here / slope)
    return (enter, leave) if here >= 0.0 else (enter, -math.inf)


@inner_step
def _inverse(way: float) -> float:
    """Reciprocal of a direction; finite for a ray that is parallel to a wall."""
    return 1.0 / way if abs(way) > LEAST else 1.0 / LEAST


@inner_step
def _is_within(place: Vector, space: SampleSpace) -> bool:
    """Whether a position lies in a cell of the field."""
    return bool(
        0.0 <= place[0] < space.cells[0]
        and 0.0 <= place[1] < space.cells[1]
        and 0.0 <= place[2] < space.cells[2]
    )


@inner_step
def ray_at(
    x: float, y: float, space: SampleSpace, view: View, between: tuple[float, float], hint: float
) -> Ray:
    """Set up the ray through a screen point, px, between two depths; no steps if it misses."""
    # Viewing ray in camera axes.
    across, down = (x - view.principal[0]) / view.focal[0], (y - view.principal[1]) / view.focal[1]
    here, toward = (0.0, 0.0, 0.0), (across, down, 1.0)
    if not view.perspective:
        here, toward = (across, down, 0.0), (0.0, 0.0, 1.0)
    # Clip to the near and far depths and to the planes.
    part = (between[0], between[1])
    for n in range(len(space.planes)):
        normal = (space.planes[n, 0], space.planes[n, 1], space.planes[n, 2])
        part = _cut(part, dot(normal, here) + space.planes[n, 3], dot(normal, toward))
    # Transform to sample coordinates, and clip to the field's box.
    turn = matrix_of(space.turn)
    eye = (space.start[0], space.start[1], space.start[2])
    start, way = combine(eye, 1.0, multiply(turn, here)), multiply(turn, toward)
    part = _cut(_cut(part, start[0] - 0.5, way[0]), space.cells[0] - 0.5 - start[0], -way[0])
    part = _cut(_cut(part, start[1] - 0.5, way[1]), space.cells[1] - 0.5 - start[1], -way[1])
    part = _cut(_cut(part, start[2] - 0.5, way[2]), space.cells[2] - 0.5 - start[2], -way[2])
    enter, leave = part
    # Very far from the eye, rounding may put the ends outside the field: nothing is seen then.
    is_sound = _is_within(combine(start, enter, way), space)
    is_sound &= _is_within(combine(start, leave, way), space)
    if not (leave > enter and is_sound):
        return Ray(start, way, way, 0.0, 0.0, 0, 0.0, 0.0, hint)
    # Divide what is left into even steps.
    steps = max(1, math.ceil((leave - enter) * math.sqrt(dot(way, way)) / space.step))
    length = math.sqrt(dot(toward, toward))
    thickness = (leave - enter) / steps
    per_way = (_inverse(way[0]), _inverse(way[1]), _inverse(way[2]))
    return Ray(start, way, per_way, 1.0 / thickness, enter, steps, thickness, length, hint)


@inner_step
def depth_at(ray: Ray, step: float) -> float:
    """Depth of a position given in steps."""
    return ray.enter + step * ray.thickness


@inner_step
def place_at(ray: Ray, step: float) -> Vector:
    """Sample position given in steps along the ray."""
    return combine(ray.start, depth_at(ray, step), ray.way)


@inner_step
def brick_at(bricks: BrickBounds, place: Vector) -> int:
    """Index of the brick that a position lies in."""
    i, j, k = int(place[0]) >> SHIFT, int(place[1]) >> SHIFT, int(place[2]) >> SHIFT
    return (k * bricks.down + j) * bricks.across + i


@inner_step
def _exit(start: float, per_way: float, place: float, apart: int) -> float:
    """Depth where a ray leaves, along one axis, the bricks less than `apart` from its own."""
    brick = int(place) >> SHIFT
    # The wall ahead depends on the sign of the direction.
    wall = (brick + apart) << SHIFT if per_way > 0.0 else (brick - apart + 1) << SHIFT
    return (wall - start) * per_way


@inner_step
def steps_out(ray: Ray, place: Vector, apart: int) -> float:
    """Steps at which a ray leaves all bricks less than `apart` from that of a position."""
    start, per_way = ray.start, ray.per_way
    # Take the nearest exit of the three axes.
    leave = min(
        _exit(start[0], per_way[0], place[0], apart),
        _exit(start[1], per_way[1], place[1], apart),
        _exit(start[2], per_way[2], place[2], apart),
    )
    return min((leave - ray.enter) * ray.per_thickness, float(ray.steps))


@inner_step
def _is_seen(bricks: BrickBounds, brick: int, place: Vector) -> bool:
    """Whether the cell of a position is visible, in a brick that is."""
    if bricks.cells.size == 0:
        return True
    i, j, k = int(place[0]) & LAST, int(place[1]) & LAST, int(place[2]) & LAST
    bit = np.uint64((((k << SHIFT) | j) << SHIFT) | i)
    return bool((bricks.cells[np.uint64(brick)] >> bit) & np.uint64(1))


@inner_step
def next_step(ray: Ray, step: int, bricks: BrickBounds) -> int:
    """First step, from this one on, whose middle is in a visible cell."""
    while step < ray.steps:
        place = place_at(ray, step + 0.5)
        brick = brick_at(bricks, place)
        # Leap over empty bricks, by how far the next visible one is at least.
        apart = int(bricks.empty[np.uint64(brick)])
        if apart > 0:
            step = max(step + 1, int(steps_out(ray, place, apart) + 0.5))
        elif _is_seen(bricks, brick, place):
            break
        else:
            step += 1
    return step
