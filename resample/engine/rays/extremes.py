"""The greatest or least value along a ray; blocks with lower bounds are skipped.

Bounds have two levels. The leaf of the greatest bound, in the block of the greatest, is sampled
first; then all leaves with bounds above the result so far (Mora and Ebert, Low-Complexity
Maximum Intensity Projection, 2005). From block to block a ray walks by its distances from their
walls (Amanatides and Woo, A Fast Voxel Traversal Algorithm for Ray Tracing, 1987).
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step, plays
from resample.engine.rays.coefficients import samples_around, value_at
from resample.engine.rays.integrators import NOTHING, Result, integrate, measured
from resample.engine.rays.media import Medium, Ray, depth_at, is_known, place_at
from resample.engine.vectors import Vector, combine, scaled
from resample.types import Flags

BLOCK = 4  # a block has 2^BLOCK cells per side
ALONG = 1e-12  # cells per step of a ray along a wall
PAST = 1e-6  # steps by which a part reaches past the last end of a step


class Blocks(NamedTuple):
    """Upper bounds of signed values in blocks of cells, of 8 bits."""

    most: Flags  # (N,) x fastest
    across: int  # blocks along x
    down: int  # blocks along y
    shift: int  # a block has 2^shift cells per side


class Extreme(NamedTuple):
    """The largest or the least value along the ray."""

    voxel: float  # scene units
    is_least: bool
    is_within: bool  # clamp to the samples around a position, beyond which splines overshoot
    slack: float  # levels by which a value may fall short
    zero: float  # column of the signed values' level 0
    per_column: float  # levels
    leaf: Blocks
    block: Blocks


class Walk(NamedTuple):
    """A ray through blocks of one size; distances are in steps."""

    apart: Vector  # from wall to wall along each axis
    stride: tuple[int, int, int]  # from a block to the next along each axis


class Stop(NamedTuple):
    """A block on the way."""

    block: int
    wall: Vector  # where the ray leaves it along each axis


Best = tuple[float, int]  # a signed value, and its step


@inner_step
def _walk(blocks: Blocks, way: Vector) -> Walk:
    """Walk of a ray, given its cells per step."""
    size, row, plane = float(1 << blocks.shift), blocks.across, blocks.across * blocks.down
    return Walk(
        (
            size / max(abs(way[0]), ALONG),
            size / max(abs(way[1]), ALONG),
            size / max(abs(way[2]), ALONG),
        ),
        (
            1 if way[0] > 0.0 else -1,
            row if way[1] > 0.0 else -row,
            plane if way[2] > 0.0 else -plane,
        ),
    )


@inner_step
def _wall(place: float, way: float, apart: float, shift: int) -> float:
    """Steps from a position to the wall ahead along one axis."""
    within = place / (1 << shift) - (int(place) >> shift)
    return apart * (1.0 - within if way > 0.0 else within)


@inner_step
def _stop(blocks: Blocks, walk: Walk, place: Vector, way: Vector, step: float) -> Stop:
    """The block of a position after some steps."""
    shift, apart = blocks.shift, walk.apart
    i, j, k = int(place[0]) >> shift, int(place[1]) >> shift, int(place[2]) >> shift
    return Stop(
        (k * blocks.down + j) * blocks.across + i,
        (
            step + _wall(place[0], way[0], apart[0], shift),
            step + _wall(place[1], way[1], apart[1], shift),
            step + _wall(place[2], way[2], apart[2], shift),
        ),
    )


@inner_step
def _next(walk: Walk, stop: Stop) -> tuple[float, Stop]:
    """Steps until a ray leaves a block, and the next block."""
    (x, y, z), apart, stride = stop.wall, walk.apart, walk.stride
    if x < y and x < z:
        return x, Stop(stop.block + stride[0], (x + apart[0], y, z))
    if y < z:
        return y, Stop(stop.block + stride[1], (x, y + apart[1], z))
    return z, Stop(stop.block + stride[2], (x, y, z + apart[2]))


@inner_step
def _promising(
    blocks: Blocks, ray: Ray, way: Vector, part: tuple[float, float]
) -> tuple[float, float]:
    """Segment of a part of a ray, in steps, in the block of the greatest bound."""
    walk, begin, most, found = _walk(blocks, way), part[0], -1, part
    stop = _stop(blocks, walk, place_at(ray, begin), way, begin)
    while begin < part[1]:
        bound = int(blocks.most[np.uint64(stop.block)])
        end, stop = _next(walk, stop)
        end = min(end, part[1])
        if bound > most:
            most, found = bound, (begin, end)
        begin = end
    return found


@inner_step
def _level(way: Extreme, best: float) -> float:
    """Level that a bound exceeds if it may beat the best value so far."""
    return (best - way.zero) * way.per_column + way.slack


@inner_step
def _signed(way: Extreme, medium: Medium, place: Vector, best: float) -> float:
    """Value at a position, negated for minima; clamped to the samples around if it beats `best`."""
    # Gather the eight samples around only for a new best, which is rare.
    spline = medium.spline
    value = value_at(spline, place)
    if way.is_within and (-value if way.is_least else value) > best:
        least, greatest = samples_around(spline, place)
        value = min(max(value, least), greatest)
    return -value if way.is_least else value


@inner_step
def _signed_if_known(way: Extreme, medium: Medium, place: Vector, best: float) -> float:
    """As `_signed`; -inf where the sample is missing."""
    return _signed(way, medium, place, best) if is_known(medium, place) else -math.inf


@inner_step
def _sampled(way: Extreme, ray: Ray, medium: Medium, best: Best, part: tuple[float, float]) -> Best:
    """The best value so far, after the steps in a part of a ray."""
    step, (most, at) = math.ceil(part[0]), best
    while step < part[1]:
        value = _signed_if_known(way, medium, place_at(ray, step), most)
        if value > most:
            most, at = value, step
        step += 1
    return most, at


@inner_step
def _raised(
    way: Extreme, ray: Ray, medium: Medium, best: Best, toward: Vector, part: tuple[float, float]
) -> Best:
    """As `_sampled`, skipping leaves with lower bounds."""
    walk, begin = _walk(way.leaf, toward), part[0]
    stop = _stop(way.leaf, walk, place_at(ray, begin), toward, begin)
    while begin < part[1]:
        bound = float(way.leaf.most[np.uint64(stop.block)])
        end, stop = _next(walk, stop)
        end = min(end, part[1])
        if bound > _level(way, best[0]):
            best = _sampled(way, ray, medium, best, (begin, end))
        begin = end
    return best


@inner_step
def _peak(way: Extreme, ray: Ray, medium: Medium, best: Best) -> float:
    """Peak of the parabola through the best step and half a step before and after it."""
    most, at = best
    before, after = max(0.0, at - 0.5), min(float(ray.steps), at + 0.5)
    one = _signed_if_known(way, medium, place_at(ray, before), most)
    two = _signed_if_known(way, medium, place_at(ray, after), most)
    # Take the value at the parabola's peak if it peaks between them.
    bend, peak = one - 2.0 * most + two, max(most, one, two)
    if -math.inf < bend < 0.0 and after - before == 1.0:
        away = max(-1.0, min(1.0, 0.5 * (one - two) / bend))
        peak = max(peak, _signed(way, medium, place_at(ray, at + 0.5 * away), peak))
    return peak


@plays(integrate, of=Extreme)
def _(way: Extreme, ray: Ray, medium: Medium) -> Result:
    # Start where the ray beside found its value, or in the leaf of the greatest bound.
    first, last = place_at(ray, 0.0), place_at(ray, float(ray.steps))
    toward = scaled(1.0 / ray.steps, combine(last, -1.0, first))
    part, hint = (0.0, ray.steps + PAST), (ray.hint - ray.enter) * ray.per_thickness + 0.5
    best = (-math.inf, 0)
    if 0.5 <= hint < ray.steps:
        best = (_signed_if_known(way, medium, place_at(ray, int(hint)), -math.inf), int(hint))
    else:
        leaf = _promising(way.leaf, ray, toward, _promising(way.block, ray, toward, part))
        best = _sampled(way, ray, medium, best, leaf)
    # Then all leaves with better bounds, block by block.
    walk, begin = _walk(way.block, toward), 0.0
    stop = _stop(way.block, walk, first, toward, 0.0)
    while begin < part[1]:
        bound = float(way.block.most[np.uint64(stop.block)])
        end, stop = _next(walk, stop)
        end = min(end, part[1])
        if bound > _level(way, best[0]):
            best = _raised(way, ray, medium, best, toward, (begin, end))
        begin = end
    if best[0] == -math.inf:
        return NOTHING
    most = _peak(way, ray, medium, best)
    # Undo the sign and classify.
    value = -most if way.is_least else most
    return measured(ray, medium, value, depth_at(ray, best[1]), way.voxel)
