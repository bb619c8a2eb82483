"""What a ray sees of a field: light through what is in front, a largest or a mean value, a surface.

Front to back, step by step, past bricks of which nothing can be seen. A step that is seen is
looked at in its middle as well: the field goes evenly from its ends to there. Where it is thick,
it is composited in parts.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import inner_step
from resample.engine.lookup import absorbed
from resample.engine.over import VISIBLE
from resample.engine.rays.looks import (
    Light,
    SummedLook,
    clamped,
    highlight_of,
    light_between,
    look_of,
    value_of,
)
from resample.engine.rays.marching import (
    Bricks,
    Ray,
    SampleSpace,
    brick_at,
    depth_at,
    next_step,
    place_at,
    steps_out,
)
from resample.engine.rays.splines import value_and_slope_at, value_at
from resample.engine.roles import called_role, plays
from resample.engine.slabs.lighting import length_of
from resample.engine.vectors import Vector, combine, dot, matrix_of, multiply, scaled
from resample.types import Doubles, Flags, Reached, Spline, Tint, Triangles

THICK = 0.5  # optical depth of a part
MOST_PARTS = 8  # of half a step
CLOSER = 24  # of the search for a surface
ALL = 255.0  # of the light
FULL = 65535.0  # of a color
NEAR = 1e-4  # of a column, which a surface is found to
CUT = 3.0  # voxels that a cut is thick
EVEN_BRICK = 1e-6  # columns between the least and the greatest value of a brick that is even

# Premultiplied light, opacity, depth × opacity, nearest depth that is visible, length of what is
# seen in voxels, a value in data units and its weight.
Result = tuple[float, float, float, float, float, float, float, float, float]


class Medium(NamedTuple):
    """A field with its look, as rays read it; values are counted in columns of the look."""

    spline: Spline
    bricks: Bricks
    space: SampleSpace
    look: SummedLook
    lattice: Doubles  # (3, 3) scene units per sample
    origin: Doubles  # (3,) scene position of the place 0
    to_slope: Doubles  # (3, 3) from columns per sample to data units per scene unit
    per_voxel: float  # voxels per scene unit
    cuts: (
        Doubles  # (M, 4) planes of the scene, in voxels: what n · p + d puts at 0 and more is kept
    )
    known: Flags  # as of `LatticeField`
    tint: Tint
    coarse: float  # columns that a field may bend by within a step
    reached: Reached
    mesh: Triangles


class Composite(NamedTuple):
    """Light that comes through what lies in front."""

    opaque: float  # transmittance that counts as none
    is_lit: bool
    has_regions: bool  # looks depend on gradients


class Extreme(NamedTuple):
    """The largest or the least value."""

    voxel: float  # scene units
    is_least: bool


class Mean(NamedTuple):
    """The mean of values, or their sum times length."""

    voxel: float  # scene units
    is_additive: bool


class Surface(NamedTuple):
    """The surface on which the field first rises to a value."""

    iso: float  # column


class End(NamedTuple):
    """The field at an end of a step."""

    value: float
    rise: float  # of the value over a step, were it as steep all the way
    slope: Vector  # per sample


class Part(NamedTuple):
    """A step of a ray or half of one."""

    begin: float  # steps
    share: float  # of a step


class Step(NamedTuple):
    """A part of a ray that can be seen."""

    front: End
    back: End
    depth: float  # of the front end
    thickness: float  # depth
    start: Vector  # place at depth 0
    way: Vector  # places per depth
    length: float  # scene units


class Shine(NamedTuple):
    """Factor of a stretch's own color and its white highlight, both dimmed by depth."""

    own: float
    highlight: float


Way = Composite | Extreme | Mean | Surface

NOTHING = (0.0, 0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 0.0, 0.0)


@called_role
def seen(way: Way, ray: Ray, medium: Medium) -> Result:
    """What a ray that meets the field sees of it."""
    raise NotImplementedError


@inner_step
def _position(medium: Medium, place: Vector) -> Vector:
    """Scene position of a place."""
    origin = (medium.origin[0], medium.origin[1], medium.origin[2])
    return combine(origin, 1.0, multiply(matrix_of(medium.lattice), place))


@inner_step
def kept_at(look: SummedLook, depth: float) -> float:
    """Share of the light that depth leaves."""
    far = max(0.0, min(1.0, (depth - look.near) / (look.far - look.near)))
    return 1.0 - look.dimmed * far


@inner_step
def is_known(medium: Medium, place: Vector) -> bool:
    """Whether the sample that a place is nearest to stands for something."""
    if medium.known.size == 0:
        return True
    # The sample at place 1 is the third one that is stored.
    i, j, k = int(place[0] + 1.5), int(place[1] + 1.5), int(place[2] + 1.5)
    return bool(medium.known[k * medium.spline.plane + j * medium.spline.row + i])


@inner_step
def _stored(medium: Medium, place: Vector) -> tuple[int, Vector]:
    """Index of the sample before a place along all axes, and how far that is from it."""
    # The sample at place 1 is the third one that is stored.
    x, y, z = place[0] + 1.0, place[1] + 1.0, place[2] + 1.0
    i, j, k = int(x), int(y), int(z)
    first = k * medium.spline.plane + j * medium.spline.row + i
    return first, (x - i, y - j, z - k)


@inner_step
def _corner(medium: Medium, first: int, away: Vector, n: int) -> tuple[int, float]:
    """One of eight samples around a place, and its share in what is linear between them."""
    right, down, behind = n & 1, (n >> 1) & 1, n >> 2
    share = away[0] if right else 1.0 - away[0]
    share *= away[1] if down else 1.0 - away[1]
    share *= away[2] if behind else 1.0 - away[2]
    return first + behind * medium.spline.plane + down * medium.spline.row + right, share


@inner_step
def look_at(medium: Medium, place: Vector) -> int:
    """Number of the look of a place, which most of what is around it has; below 0: it is missing.

    Samples have shares in a place as in linear interpolation, so between two looks the border is
    where a field would pass one half that is 1 in one of them and 0 in the other.
    """
    if medium.known.size == 0:
        return 0
    if not is_known(medium, place):
        return -1
    if medium.look.column.shape[0] == medium.look.columns:
        return 0
    first, away = _stored(medium, place)
    best, most = 0, 0.0
    for n in range(8):
        index, _ = _corner(medium, first, away, n)
        number, total = int(medium.known[index]), 0.0
        if number == best:
            continue
        for m in range(8):
            other, share = _corner(medium, first, away, m)
            total += share if int(medium.known[other]) == number else 0.0
        if number > 0 and total > most:
            best, most = number, total
    return best - 1


@inner_step
def _tinted(medium: Medium, place: Vector, light: Light) -> Light:
    """Light of a place in its own color, if samples have colors."""
    color = medium.tint.color
    if color.shape[0] == 0:
        return light
    red, green, blue = 0.0, 0.0, 0.0
    first, away = _stored(medium, place)
    for n in range(8):
        index, share = _corner(medium, first, away, n)
        red += share * color[index, 0]
        green += share * color[index, 1]
        blue += share * color[index, 2]
    per = light[3] * medium.tint.most / FULL
    return per * red, per * green, per * blue, light[3]


@inner_step
def _faced(medium: Medium, place: Vector, slope: Vector) -> Vector:
    """Gradient at a place; beside a cut it leads across that.

    A cut through even tissue meets noise alone, whose gradients would make it look rough
    (Weiskopf, Engel and Ertl, Interactive Clipping Techniques, 2003).
    """
    if len(medium.cuts) == 0:
        return slope
    at, nearest, normal = _position(medium, place), CUT, slope
    for n in range(len(medium.cuts)):
        across = (medium.cuts[n, 0], medium.cuts[n, 1], medium.cuts[n, 2])
        away = dot(across, at) + medium.cuts[n, 3]
        if away < nearest:
            length = max(length_of(slope), 2.0 * medium.look.lamp.flat) / length_of(across)
            nearest, normal = away, scaled(length, across)
    return normal


@inner_step
def _toward(v: Vector) -> Vector:
    """Vector of length 1."""
    return scaled(1.0 / math.sqrt(dot(v, v)), v)


@inner_step
def _cell(place: float, per: int, count: int) -> tuple[int, int, float]:
    """Cells before and behind a place along one axis, and how far it is from the one before."""
    at = max(0.0, min(count - 1.0, (place - 0.5) / per - 0.5))
    before = int(at)
    return before, min(before + 1, count - 1), at - before


@inner_step
def _share_at(reached: Reached, place: Vector, n: int) -> float:
    """Share of light that gets to a place, linear between cells."""
    share, per = reached.share, reached.per
    i, i_next, x = _cell(place[0], per, share.shape[2])
    j, j_next, y = _cell(place[1], per, share.shape[1])
    k, k_next, z = _cell(place[2], per, share.shape[0])
    total = 0.0
    for plane, of_plane in ((k, 1.0 - z), (k_next, z)):
        for row, of_row in ((j, 1.0 - y), (j_next, y)):
            beside = (1.0 - x) * share[plane, row, i, n] + x * share[plane, row, i_next, n]
            total += of_plane * of_row * beside
    return total / ALL


@inner_step
def reaching(medium: Medium, place: Vector) -> tuple[float, float]:
    """Shares of the lamp's light and of light from everywhere that get to a place."""
    if medium.reached.share.size == 0:
        return 1.0, 1.0
    return _share_at(medium.reached, place, 0), _share_at(medium.reached, place, 1)


@inner_step
def reflect(normal: Vector, place: Vector, look: SummedLook) -> tuple[float, float]:
    """As `lighting.reflect`, without ambient light, and with a table of highlights."""
    lamp = look.lamp
    eye = (lamp.viewer[0], lamp.viewer[1], lamp.viewer[2])
    light = (lamp.toward[0], lamp.toward[1], lamp.toward[2])
    if lamp.viewer[3] != 0.0:
        eye = _toward(combine(eye, -1.0, place))
    if dot(light, light) == 0.0:
        light = eye
    halfway = combine(eye, 1.0, light)
    halfway = scaled(1.0 / max(math.sqrt(dot(halfway, halfway)), 1e-30), halfway)
    return lamp.diffuse * abs(dot(normal, light)), highlight_of(look, abs(dot(normal, halfway)))


@inner_step
def _reflected(medium: Medium, place: Vector, slope: Vector) -> tuple[float, float]:
    """Factor of a surface's own color and white highlight."""
    lamp, length = medium.look.lamp, length_of(slope)
    of_lamp, of_all = reaching(medium, place)
    own, highlight = lamp.diffuse, 0.0
    if length > lamp.flat:
        normal = scaled(1.0 / length, slope)
        own, highlight = reflect(normal, _position(medium, place), medium.look)
    return of_all * lamp.ambient + of_lamp * own, of_lamp * highlight


@inner_step
def _put(result: Result, light: Light, shine: Shine, length: float, depth: float) -> Result:
    """Composite what is evenly spread over a length behind what was seen so far."""
    red, green, blue, alpha, deep, first, cover, value, presence = result
    extinction = light[3]
    share = (1.0 - alpha) * float(absorbed(extinction * length))
    own, high = shine.own / extinction, shine.highlight
    red += share * (own * light[0] + high)
    green += share * (own * light[1] + high)
    blue += share * (own * light[2] + high)
    alpha += share
    if first == math.inf and alpha > VISIBLE:
        first = depth
    return red, green, blue, alpha, deep + share * depth, first, cover, value, presence


@inner_step
def _end_at(ray: Ray, step: float, medium: Medium) -> End:
    """Field at an end of a step."""
    value, slope = value_and_slope_at(medium.spline, place_at(ray, step))
    return End(value, dot(slope, ray.way) * ray.thickness, slope)


@inner_step
def _value_between(front: End, back: End, t: float) -> float:
    """Value within a step, by Hermite's cubic."""
    u, away = 1.0 - t, back.value - front.value
    bent = u * (front.rise - away) - t * (back.rise - away)
    return front.value + t * away + t * u * bent


@inner_step
def _is_seen(look: SummedLook, a: float, b: float, c: float) -> bool:
    """Whether a value between three can be seen."""
    first, last = int(min(a, b, c)), math.ceil(max(a, b, c))
    return bool(look.seen[np.uint64(last + 1)] > look.seen[np.uint64(first)])


@inner_step
def _shine_at(way: Composite, step: Step, t: float, medium: Medium) -> Shine:
    """What light makes of colors at a part 0..1 of a step."""
    depth = step.depth + t * step.thickness
    own, highlight = 1.0, 0.0
    if way.is_lit:
        place = combine(step.start, depth, step.way)
        _, per_sample = value_and_slope_at(medium.spline, place)
        slope = _faced(medium, place, multiply(matrix_of(medium.to_slope), per_sample))
        own, highlight = _reflected(medium, place, slope)
    kept = kept_at(medium.look, depth)
    return Shine(kept * own, kept * highlight)


@inner_step
def _slope_between(step: Step, t: float, medium: Medium) -> Vector:
    """Gradient within a step, data units per scene unit."""
    slope = combine(scaled(1.0 - t, step.front.slope), t, step.back.slope)
    return multiply(matrix_of(medium.to_slope), slope)


@inner_step
def _put_half(
    result: Result, way: Composite, half: int, step: Step, values: tuple[float, float],
    medium: Medium,
) -> Result:  # fmt: skip
    """Composite half a stretch, in parts if it is thick."""
    look, (front, back) = medium.look, (step.front, step.back)
    t, length = 0.25 + 0.5 * half, 0.5 * step.length
    depth = step.depth + t * step.thickness
    place = combine(step.start, depth, step.way)
    number = look_at(medium, place)
    if number < 0:
        return result
    first = float(number * look.columns)
    if way.has_regions:
        middle = clamped(look, _value_between(front, back, t))
        steepness = length_of(_slope_between(step, t, medium))
        red, green, blue, thick = look_of(look, first + middle, steepness)
        light = _tinted(medium, place, (thick * red, thick * green, thick * blue, thick))
        if thick > 0.0:
            result = _put(result, light, _shine_at(way, step, t, medium), length, depth)
        return result
    whole = _tinted(medium, place, light_between(look, first + values[0], first + values[1]))
    optical = whole[3] * length
    if not optical > 0.0:
        return result
    if optical <= THICK:
        return _put(result, whole, _shine_at(way, step, t, medium), length, depth)
    parts = 1 + min(MOST_PARTS - 1, int(optical / THICK))
    a = values[0]
    for n in range(1, parts + 1):
        b = clamped(look, _value_between(front, back, 0.5 * (half + n / parts)))
        light = _tinted(medium, place, light_between(look, first + a, first + b))
        if light[3] > 0.0:
            t = 0.5 * (half + (n - 0.5) / parts)
            depth = step.depth + t * step.thickness
            shine = _shine_at(way, step, t, medium)
            result = _put(result, light, shine, length / parts, depth)
            if 1.0 - result[3] <= way.opaque:
                break
        a = b
    return result


@inner_step
def _halved(end: End) -> End:
    """End of a step that is half as long."""
    return End(end.value, 0.5 * end.rise, end.slope)


@inner_step
def _is_bent(front: End, back: End, medium: Medium) -> bool:
    """Whether a field bends so much within a step that its middle is worth a look."""
    away = back.value - front.value
    return abs(front.rise - away) + abs(back.rise - away) > medium.coarse


@inner_step
def _put_part(
    result: Result, way: Composite, ray: Ray, part: Part, ends: tuple[End, End], medium: Medium
) -> Result:
    """Composite a step or half of one, if it can be seen."""
    look, (front, back) = medium.look, ends
    a, b = clamped(look, front.value), clamped(look, back.value)
    middle = clamped(look, _value_between(front, back, 0.5))
    if not _is_seen(look, a, middle, b):
        return result
    depth, thickness = depth_at(ray, part.begin), part.share * ray.thickness
    length = thickness * ray.length
    step = Step(front, back, depth, thickness, ray.start, ray.way, length)
    result = _put_half(result, way, 0, step, (a, middle), medium)
    result = _put_half(result, way, 1, step, (middle, b), medium)
    red, green, blue, alpha, deep, first, cover, value, presence = result
    cover += length * medium.per_voxel
    return red, green, blue, alpha, deep, first, cover, value, presence


@plays(seen, of=Composite)
def _(way: Composite, ray: Ray, medium: Medium) -> Result:
    bricks = medium.bricks
    result, step = NOTHING, next_step(ray, 0, bricks)
    if step >= ray.steps:
        return result
    front = _end_at(ray, step, medium)
    while step < ray.steps:
        back = _end_at(ray, step + 1, medium)
        if _is_bent(front, back, medium):
            middle = _halved(_end_at(ray, step + 0.5, medium))
            half = Part(step, 0.5)
            result = _put_part(result, way, ray, half, (_halved(front), middle), medium)
            half = Part(step + 0.5, 0.5)
            result = _put_part(result, way, ray, half, (middle, _halved(back)), medium)
        else:
            result = _put_part(result, way, ray, Part(step, 1.0), (front, back), medium)
        if 1.0 - result[3] <= way.opaque:
            break
        step, front = step + 1, back
        ahead = next_step(ray, step, bricks)
        if step < ahead < ray.steps:
            front = _end_at(ray, ahead, medium)
        step = ahead
    red, green, blue, alpha, deep, first, cover, _, _ = result
    return red, green, blue, alpha, deep, first, max(alpha, min(1.0, cover)), 0.0, 0.0


@inner_step
def _measured(ray: Ray, medium: Medium, value: float, depth: float, voxel: float) -> Result:
    """Color of a value; it is as opaque as a voxel where the field is that long."""
    look, spline = medium.look, medium.spline
    value = min(max(value, spline.floor), spline.ceiling)
    presence = min(1.0, ray.steps * ray.thickness * ray.length / voxel)
    red, green, blue, extinction = look_of(look, clamped(look, value), 0.0)
    alpha = presence * -math.expm1(-extinction * voxel)
    first = depth if alpha > VISIBLE else math.inf
    return (
        alpha * red,
        alpha * green,
        alpha * blue,
        alpha,
        alpha * depth,
        first,
        presence,
        value_of(look, value),
        presence,
    )


@inner_step
def _most_of(way: Extreme, bricks: Bricks, place: Vector) -> float:
    """Largest value of a brick, or its least one negated."""
    brick = brick_at(bricks, place)
    return -bricks.least[brick] if way.is_least else float(bricks.greatest[brick])


@inner_step
def _signed(way: Extreme, medium: Medium, place: Vector) -> float:
    value = value_at(medium.spline, place)
    return -value if way.is_least else value


@inner_step
def _signed_if_known(way: Extreme, medium: Medium, place: Vector) -> float:
    """As `_signed`; less than all where there is a gap."""
    return _signed(way, medium, place) if is_known(medium, place) else -math.inf


@plays(seen, of=Extreme)
def _(way: Extreme, ray: Ray, medium: Medium) -> Result:
    best, at, step = -math.inf, 0, 0
    while step <= ray.steps:
        place = place_at(ray, step)
        if _most_of(way, medium.bricks, place) <= best:
            step = max(step + 1, math.ceil(steps_out(ray, place, 1)))
            continue
        value = _signed(way, medium, place)
        if value > best and is_known(medium, place):
            best, at = value, step
        step += 1
    if best == -math.inf:
        return NOTHING
    # A parabola through the best step and half a step before and after it.
    before, after = max(0.0, at - 0.5), min(float(ray.steps), at + 0.5)
    one = _signed_if_known(way, medium, place_at(ray, before))
    two = _signed_if_known(way, medium, place_at(ray, after))
    bend = one - 2.0 * best + two
    if -math.inf < bend < 0.0 and after - before == 1.0:
        away = max(-1.0, min(1.0, 0.5 * (one - two) / bend))
        best = max(best, _signed(way, medium, place_at(ray, at + 0.5 * away)))
    best = max(best, one, two)
    value = -best if way.is_least else best
    return _measured(ray, medium, value, depth_at(ray, at), way.voxel)


@plays(seen, of=Mean)
def _(way: Mean, ray: Ray, medium: Medium) -> Result:
    spline, bricks = medium.spline, medium.bricks
    total, count, step = 0.0, 0, 0
    while step < ray.steps:
        place = place_at(ray, step + 0.5)
        if not is_known(medium, place):
            step += 1
            continue
        brick = brick_at(bricks, place)
        least = float(bricks.least[brick])
        if bricks.greatest[brick] - least <= EVEN_BRICK and medium.known.size == 0:
            last = max(step + 1, int(steps_out(ray, place, 1) + 0.5))
            total += (last - step) * least
            count += last - step
            step = last
            continue
        total += value_at(spline, place)
        count += 1
        step += 1
    if count == 0:
        return NOTHING
    mean, middle = total / count, depth_at(ray, 0.5 * ray.steps)
    if not way.is_additive:
        return _measured(ray, medium, mean, middle, way.voxel)
    length = count * ray.thickness * ray.length
    presence = min(1.0, length / way.voxel)
    first = middle if presence > VISIBLE else math.inf
    depth = presence * middle
    return (
        0.0,
        0.0,
        0.0,
        presence,
        depth,
        first,
        presence,
        value_of(medium.look, mean) * length,
        presence,
    )


@inner_step
def _crossing(ray: Ray, spline: Spline, step: int, ends: tuple[float, float], iso: float) -> float:
    """Steps after which a field passes a value that lies between those at the ends of one."""
    before, behind = float(step), step + 1.0
    low, high, middle = ends[0] - iso, ends[1] - iso, step + 0.5
    for _ in range(CLOSER):
        middle = before + (behind - before) * low / (low - high)
        found = value_at(spline, place_at(ray, middle)) - iso
        if abs(found) <= NEAR:
            return middle
        # Illinois: an end that stays counts half, so that both ends close in.
        if found >= 0.0:
            behind, high, low = middle, found, 0.5 * low
        else:
            before, low, high = middle, found, 0.5 * high
    return middle


@plays(seen, of=Surface)
def _(way: Surface, ray: Ray, medium: Medium) -> Result:
    spline, bricks, look = medium.spline, medium.bricks, medium.look
    step, hit = next_step(ray, 0, bricks), -1.0
    if step < ray.steps:
        first = place_at(ray, step)
        front = value_at(spline, first)
        hit = float(step) if front >= way.iso and is_known(medium, first) else -1.0
    while step < ray.steps and hit < 0.0:
        behind = place_at(ray, step + 1)
        back = value_at(spline, behind)
        if back >= way.iso and is_known(medium, behind):
            hit = step + 1.0
            if front < way.iso:
                hit = _crossing(ray, spline, step, (front, back), way.iso)
        step, front = step + 1, back
        ahead = next_step(ray, step, bricks)
        if step < ahead < ray.steps:
            front = value_at(spline, place_at(ray, ahead))
        step = ahead
    if hit < 0.0:
        return NOTHING
    place, depth = place_at(ray, hit), depth_at(ray, hit)
    _, per_sample = value_and_slope_at(spline, place)
    slope = _faced(medium, place, multiply(matrix_of(medium.to_slope), per_sample))
    own, highlight = _reflected(medium, place, slope)
    red, green, blue, _ = look_of(look, clamped(look, way.iso), length_of(slope))
    kept = kept_at(look, depth)
    own, highlight = kept * own, kept * highlight
    color = (own * red + highlight, own * green + highlight, own * blue + highlight)
    iso = value_of(look, way.iso)
    return color[0], color[1], color[2], 1.0, depth, depth, 1.0, iso, 1.0
