"""Emission and absorption of several fields on one ray.

Each field is marched by its own steps, as if it were alone, and a step becomes pieces of even
light. Where pieces of several fields overlap, their emission and their extinction add up (Max,
Optical Models for Direct Volume Rendering, 1995).
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.bundles import Words, loaded, rows_of, store
from resample.engine.jit import Counter, inner_kernel, inner_step, packed_kernel, plays, tasks
from resample.engine.rays.integrators import (
    MOST_PIECES,
    NOTHING,
    Composite,
    RayContext,
    RaySample,
    Result,
    finished,
    put,
    put_step,
    sample_at,
    step_after,
)
from resample.engine.rays.media import (
    Aims,
    Light,
    Medium,
    Ray,
    aims_at,
    depth_at,
    next_step,
    place_at,
    position,
    ray_at,
)
from resample.engine.rays.meshes import cast
from resample.engine.rays.painting import Output, paint_tile
from resample.types import Doubles, Indices, View

SAME = 1e-6  # of a step; depths that are closer count as one
# Columns of a piece: red, green and blue × extinction, extinction, and the depths of its ends.
EXTINCTION, FRONT, BACK = 3, 4, 5


class March(NamedTuple):
    """Progress of a field's march on a ray."""

    ray: Ray
    aims: Aims
    step: int  # the next visible one
    here: RaySample  # in its middle
    front: float  # value at its front


NOWHERE = (0.0, 0.0, 0.0)
MARCH = March(
    Ray(NOWHERE, NOWHERE, NOWHERE, 0.0, 0.0, 0, 0.0, 0.0, math.inf),
    Aims(NOWHERE, NOWHERE),
    0,
    RaySample(0.0, 0.0, NOWHERE),
    0.0,
)
STATE = rows_of([MARCH])[0].shape[1]  # words of a `March`


class Scratch(NamedTuple):
    """State of each of K fields on the current ray."""

    march: Words  # (K, W) rows of `March`
    piece: Doubles  # (K, MOST_PIECES, 6) of the step that is composited
    pieces: Indices  # (K,) their number; 0: the step has not been sampled
    at: Indices  # (K,) the current piece
    front: Doubles  # (K,) depth where that begins, or the step; inf: the field has ended


class Fields(NamedTuple):
    """K fields; their emission and absorption are composited front to back."""

    opaque: float  # transmittance that counts as none
    media: Words  # (K, W) rows of `Medium`
    is_lit: Indices  # (K,) flags
    has_regions: Indices  # (K,) flags: looks depend on gradients


class SeveralFields(NamedTuple):
    """Fields, and their state on a thread's ray."""

    fields: Fields
    scratch: Scratch


class Recorder(NamedTuple):
    """A field among others: its pieces are stored for joint compositing."""

    opaque: float
    is_lit: bool
    has_regions: bool
    per_length: float  # depth per scene unit
    piece: Doubles  # (MOST_PIECES, 6)
    pieces: Indices  # (1,) their number, so far


@inner_step
def _record(
    way: Recorder, light: Light, shine: tuple[float, float], length: float, depth: float
) -> None:
    """Store a piece of the step."""
    piece, half = way.piece[way.pieces[0]], 0.5 * length * way.per_length
    for channel in range(3):
        piece[channel] = shine[0] * light[channel] + shine[1] * light[3]
    piece[EXTINCTION], piece[FRONT], piece[BACK] = light[3], depth - half, depth + half
    way.pieces[0] += 1


@plays(put, of=Recorder)
def _(
    way: Recorder,
    result: Result,
    light: Light,
    shine: tuple[float, float],
    length: float,
    depth: float,
) -> Result:
    _record(way, light, shine, length, depth)
    return result


@inner_kernel
def _enter(
    way: SeveralFields,
    k: int,
    like: Medium,
    point: tuple[float, float],
    view: View,
    between: tuple[float, float],
) -> Ray:
    """Find a field's first visible step on the ray through a point of the screen, px."""
    medium, known = loaded(way.fields.media[k], like), way.scratch
    ray = ray_at(point[0], point[1], medium.space, view, between, math.inf)
    step = next_step(ray, 0, medium.bricks)
    known.pieces[k] = 0
    known.front[k] = depth_at(ray, step) if step < ray.steps else math.inf
    if step < ray.steps:
        aims = aims_at(position(medium, place_at(ray, ray.steps)), medium.classifier)
        here = sample_at(ray, step + 0.5, medium)
        store(known.march[k], March(ray, aims, step, here, here.value - 0.5 * here.rise))
    return ray


@inner_kernel
def _open(way: SeveralFields, k: int, like: Medium, result: Result) -> Result:
    """Sample a field's next visible step: its pieces, if any, and the position of the next."""
    medium, known = loaded(way.fields.media[k], like), way.scratch
    ray, aims, step, here, front = loaded(known.march[k], MARCH)
    following, ahead, back, begin = step_after(ray, step, here, medium)
    recorder = Recorder(
        way.fields.opaque,
        way.fields.is_lit[k] != 0,
        way.fields.has_regions[k] != 0,
        1.0 / ray.length,
        known.piece[k],
        known.pieces[k : k + 1],
    )
    ends, context = (front, here, back), RayContext(medium, aims)
    result = put_step(result, recorder, ray, step, ends, context)
    store(known.march[k], March(ray, aims, following, ahead, begin))
    known.at[k] = -1
    _advance(known, k)
    return result


@inner_step
def _advance(known: Scratch, k: int) -> None:
    """Advance to a field's next piece, or to its next visible step."""
    known.at[k] += 1
    if known.at[k] < known.pieces[k]:
        known.front[k] = known.piece[k, known.at[k], FRONT]
        return
    ray, _, step, _, _ = loaded(known.march[k], MARCH)
    known.pieces[k] = 0
    known.front[k] = depth_at(ray, step) if step < ray.steps else math.inf


@inner_step
def _nearest(known: Scratch) -> float:
    """Least depth of all fields' next visible steps."""
    least = math.inf
    for front in known.front:
        least = min(least, front)
    return least


@inner_step
def _sum_at(known: Scratch, here: float) -> tuple[Light, float]:
    """Emission and extinction of all fields at a depth, and the depth where they change."""
    red, green, blue, extinction, end = 0.0, 0.0, 0.0, 0.0, math.inf
    for k in range(len(known.front)):
        if known.front[k] > here:
            end = min(end, known.front[k])
            continue
        piece = known.piece[k, known.at[k]]
        red, green, blue = red + piece[0], green + piece[1], blue + piece[2]
        extinction, end = extinction + piece[EXTINCTION], min(end, piece[BACK])
    return (red, green, blue, extinction), end


@inner_kernel
def _composite(
    way: SeveralFields,
    point: tuple[float, float],
    like: Medium,
    view: View,
    between: tuple[float, float],
) -> Result:
    """Composite all fields on a ray between two depths."""
    # Enter all fields.
    known, opaque, count = way.scratch, way.fields.opaque, len(way.scratch.front)
    thickness, length = math.inf, 0.0
    for k in range(count):
        entered = _enter(way, k, like, point, view, between)
        if entered.steps > 0:
            thickness, length = min(thickness, entered.thickness), entered.length
    # March to the nearest depth at which any is visible, then to where anything changes.
    result, here, same = NOTHING, -math.inf, SAME * thickness
    whole = Composite(opaque, False, False)
    while 1.0 - result[3] > opaque:
        here = max(here, _nearest(known))
        if here == math.inf:
            break
        # Sample the steps that begin here; some turn out to be empty.
        were_all = True
        for k in range(count):
            if known.front[k] <= here + same and known.pieces[k] == 0:
                result = _open(way, k, like, result)
                were_all = False
        if not were_all:
            continue
        light, end = _sum_at(known, here + same)
        middle, piece = 0.5 * (here + end), max(0.0, end - here) * length
        result = put(whole, result, light, (1.0, 0.0), piece, middle)
        # Leave the pieces that end here.
        for k in range(count):
            if known.front[k] <= here + same and known.piece[k, known.at[k], BACK] <= end + same:
                _advance(known, k)
        here = end
    return finished(result, opaque)


@plays(cast, of=SeveralFields)
def _(
    way: SeveralFields,
    ray: Ray,  # noqa: ARG001
    point: tuple[float, float],
    medium: Medium,
    view: View,
    between: tuple[float, float],
) -> Result:
    return _composite(way, point, medium, view, between)


@packed_kernel
def paint_several(
    counter: Counter, count: int, fineness: int, fields: Fields, medium: Medium, output: Output
) -> None:
    """Paint tiles of a picture by casting rays through several fields.

    `count`, `fineness`, `output`: as in `paint_rays`. `medium`: the first field, with the meshes.
    """
    # Each thread marches its own rays.
    each = len(fields.media)
    scratch = Scratch(
        np.empty((each, STATE), np.int64),
        np.empty((each, MOST_PIECES, 6)),
        np.empty(each, np.int64),
        np.empty(each, np.int64),
        np.empty(each),
    )
    way = SeveralFields(fields, scratch)
    for task in tasks(counter, count):
        paint_tile(output.which[task], fineness, way, medium, output)
