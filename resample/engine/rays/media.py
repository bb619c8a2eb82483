"""A field with its transfer function, as rays sample it, and its lighting."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, kernel
from resample.engine.rays.coefficients import BRICK
from resample.engine.vectors import Vector, combine, dot, matrix_of, multiply, scaled
from resample.types import (
    Doubles,
    Flags,
    Floats,
    Indices,
    Lamp,
    Reached,
    SplineField,
    Tint,
    Triangles,
    View,
)

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
    # Divide the rest into even steps.
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
    """Steps at which a ray leaves all bricks less than `apart` from a position's brick."""
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
    """Whether the cell of a position is visible, in a visible brick."""
    if bricks.cells.size == 0:
        return True
    i, j, k = int(place[0]) & LAST, int(place[1]) & LAST, int(place[2]) & LAST
    bit = np.uint64((((k << SHIFT) | j) << SHIFT) | i)
    return bool((bricks.cells[np.uint64(brick)] >> bit) & np.uint64(1))


@inner_step
def next_step(ray: Ray, step: int, bricks: BrickBounds) -> int:
    """First step, from this one on, with its middle in a visible cell."""
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


@kernel
def length_of(v: Vector) -> float:
    """Length of a vector."""
    return math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


EVEN = 1e-3  # columns; values are at least as far apart where their difference divides

Light = tuple[float, float, float, float]  # red, green, blue, and extinction


class SummedClassifier(NamedTuple):
    """A classifier for rays; values are counted in columns."""

    column: Doubles  # (L K, 12) sums up to a column, their rise to the next, and its bend
    columns: int  # K, of each of L looks, which lie side by side
    visible: Indices  # (K + 1,) prefix count of columns that are visible in any look
    highlight: Doubles  # (N,) over the cosine 0..1 between normal and halfway vector
    table: Floats  # (G, L K, 4) as in `Classifier`, G = 1 where gradients do not matter
    low: float  # data units, the value of column 0
    per_column: float  # data units
    per_slope: float  # rows per data unit per scene unit
    lamp: Lamp
    # Depth cueing, as in `Classifier`.
    near: float
    far: float
    dimmed: float


@inner_step
def value_of(classifier: SummedClassifier, place: float) -> float:
    """Value of a column, data units."""
    return classifier.low + place * classifier.per_column


@inner_step
def clamped(classifier: SummedClassifier, place: float) -> float:
    """Column of a value, clamped to the table; NaN becomes a column too."""
    return float(min(max(0.0, place), classifier.columns - 1.0))


@inner_step
def highlight_of(classifier: SummedClassifier, cosine: float) -> float:
    """White highlight, interpolated in a table."""
    place = min(1.0, cosine) * (classifier.highlight.size - 1)
    n = np.uint64(min(int(place), classifier.highlight.size - 2))
    below = classifier.highlight[n]
    return float(below + (place - n) * (classifier.highlight[n + np.uint64(1)] - below))


@inner_step
def _sums_at(classifier: SummedClassifier, place: float) -> Light:
    """Integrals from column 0 to a place of color × extinction, and of extinction."""
    # Between columns the integrals are quadratic.
    k = np.uint64(min(int(place), classifier.column.shape[0] - 2))
    f, c = place - k, classifier.column
    return (
        c[k, 0] + f * (c[k, 4] + f * c[k, 8]),
        c[k, 1] + f * (c[k, 5] + f * c[k, 9]),
        c[k, 2] + f * (c[k, 6] + f * c[k, 10]),
        c[k, 3] + f * (c[k, 7] + f * c[k, 11]),
    )


@inner_step
def _apart(end: float, middle: float) -> float:
    """A value, moved if its difference to another is too small for a division."""
    if abs(end - middle) >= EVEN:
        return end
    return middle - EVEN if middle >= EVEN else middle + EVEN


@inner_step
def lights_between(
    classifier: SummedClassifier, number: int, values: tuple[float, float, float]
) -> Light:
    """Mean color × extinction and mean extinction over two intervals that share a value.

    `number`: of the look. `values`: of columns, clamped. Result: the mean of both.
    """
    # Differences of the integrals, over the distances.
    first, middle = float(number * classifier.columns), values[1]
    front, back = _apart(values[0], middle), _apart(values[2], middle)
    one, two, three = (
        _sums_at(classifier, first + front),
        _sums_at(classifier, first + middle),
        _sums_at(classifier, first + back),
    )
    before, behind = 0.5 / (middle - front), 0.5 / (back - middle)
    return (
        before * (two[0] - one[0]) + behind * (three[0] - two[0]),
        before * (two[1] - one[1]) + behind * (three[1] - two[1]),
        before * (two[2] - one[2]) + behind * (three[2] - two[2]),
        before * (two[3] - one[3]) + behind * (three[3] - two[3]),
    )


@inner_step
def _between_rows(
    classifier: SummedClassifier, rows: tuple[int, int], down: float, place: float, n: int
) -> float:
    # Interpolate along values in both rows, then between the rows of gradients.
    k = min(int(place), classifier.table.shape[1] - 2)
    right, upper, lower = place - k, rows[0], rows[1]
    above = classifier.table[upper, k, n] + right * (
        classifier.table[upper, k + 1, n] - classifier.table[upper, k, n]
    )
    below = classifier.table[lower, k, n] + right * (
        classifier.table[lower, k + 1, n] - classifier.table[lower, k, n]
    )
    return float(above + down * (below - above))


@inner_step
def classified(classifier: SummedClassifier, place: float, slope: float) -> Light:
    """Color and extinction, by value and gradient magnitude; bilinear in the table."""
    # Locate the two rows of gradients.
    last = classifier.table.shape[0] - 1
    row = min(float(last), slope * classifier.per_slope)
    r = min(int(row), max(0, last - 1))
    rows, down = (r, min(r + 1, last)), row - r
    return (
        _between_rows(classifier, rows, down, place, 0),
        _between_rows(classifier, rows, down, place, 1),
        _between_rows(classifier, rows, down, place, 2),
        _between_rows(classifier, rows, down, place, 3),
    )


ALL, FULL = 255.0, 65535.0  # full light in `Reached`, full color in `Tint`
CUT = 3.0  # voxels from a clip plane within which its normal replaces gradients


class Medium(NamedTuple):
    """A field with its transfer function; values are counted in the table's columns."""

    spline: SplineField
    bricks: BrickBounds
    space: SampleSpace
    classifier: SummedClassifier
    lattice: Doubles  # (3, 3) scene units per sample
    origin: Doubles  # (3,) scene position of sample position 0
    to_slope: Doubles  # (3, 3) from columns per sample to data units per scene unit
    per_voxel: float  # voxels per scene unit
    # (M, 4) clip planes of the scene, in voxels; points p with n · p + d >= 0 are kept.
    cuts: Doubles
    known: Flags  # as in `LatticeField`
    tint: Tint
    coarse: float  # columns by which a field may bend within a step that is not split
    is_from_eye: bool  # the directions of the light are the same all along a ray
    reached: Reached
    mesh: Triangles


class Aims(NamedTuple):
    """Directions for shading, unit vectors."""

    light: Vector
    halfway: Vector  # between the directions to the light and to the eye


@inner_step
def position(medium: Medium, place: Vector) -> Vector:
    """Scene position of a sample position."""
    origin = (medium.origin[0], medium.origin[1], medium.origin[2])
    return combine(origin, 1.0, multiply(matrix_of(medium.lattice), place))


@inner_step
def depth_cue_at(classifier: SummedClassifier, depth: float) -> float:
    """Share of the light that depth cueing leaves."""
    if classifier.dimmed == 0.0:
        return 1.0
    # Falls linearly from the near to the far depth.
    far = max(0.0, min(1.0, (depth - classifier.near) / (classifier.far - classifier.near)))
    return 1.0 - classifier.dimmed * far


@inner_step
def is_known(medium: Medium, place: Vector) -> bool:
    """Whether the sample nearest to a position is present."""
    if medium.known.size == 0:
        return True
    # The sample at place 1 is the third one that is stored.
    i, j, k = int(place[0] + 1.5), int(place[1] + 1.5), int(place[2] + 1.5)
    return bool(medium.known[k * medium.spline.plane + j * medium.spline.row + i])


@inner_step
def _stored(medium: Medium, place: Vector) -> tuple[int, Vector]:
    """Index of the sample before a position along all axes, and the fractions beyond it."""
    x, y, z = place[0] + 1.0, place[1] + 1.0, place[2] + 1.0
    i, j, k = int(x), int(y), int(z)
    first = k * medium.spline.plane + j * medium.spline.row + i
    return first, (x - i, y - j, z - k)


@inner_step
def _corner(medium: Medium, first: int, away: Vector, n: int) -> tuple[int, float]:
    """Index of the nth of the eight samples around a position, and its trilinear weight."""
    # The bits of n pick the side along x, y and z.
    right, down, behind = n & 1, (n >> 1) & 1, n >> 2
    share = away[0] if right else 1.0 - away[0]
    share *= away[1] if down else 1.0 - away[1]
    share *= away[2] if behind else 1.0 - away[2]
    return first + behind * medium.spline.plane + down * medium.spline.row + right, share


@inner_step
def number_at(medium: Medium, place: Vector) -> int:
    """Number of the look at a position, by majority of the samples around; below 0: missing.

    Samples vote with trilinear weights, so the border between two looks is where a field of 1 in
    one look and 0 in the other would cross one half.
    """
    # No flags: one look everywhere.
    if medium.known.size == 0:
        return 0
    if not is_known(medium, place):
        return -1
    # Flags only tell present from missing samples where there is a single look.
    if medium.classifier.column.shape[0] == medium.classifier.columns:
        return 0
    # Sum the weights of each look among the eight samples, and keep the heaviest.
    first, away = _stored(medium, place)
    best, most = 0, 0.0
    for n in range(8):
        # The best look so far needs no second sum.
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
def tinted(medium: Medium, place: Vector, light: Light) -> Light:
    """Replace a light's color by the samples' own, if they have colors."""
    # Samples without their own colors keep the look's.
    color = medium.tint.color
    if color.shape[0] == 0:
        return light
    # Interpolate the colors of the eight samples around.
    red, green, blue = 0.0, 0.0, 0.0
    first, away = _stored(medium, place)
    for n in range(8):
        index, share = _corner(medium, first, away, n)
        red += share * color[index, 0]
        green += share * color[index, 1]
        blue += share * color[index, 2]
    # Scale to linear light × extinction.
    per = light[3] * medium.tint.most / FULL
    return per * red, per * green, per * blue, light[3]


@inner_step
def faced(medium: Medium, place: Vector, slope: Vector) -> Vector:
    """Gradient at a position; near a clip plane, the plane's normal.

    A plane that cuts uniform tissue meets only noise; its gradients would make the cut look
    rough (Weiskopf, Engel and Ertl, Interactive Clipping Techniques, 2003).
    """
    if len(medium.cuts) == 0:
        return slope
    # Find the nearest plane within `CUT`, and give its normal the gradient's length, or enough for
    # a surface.
    at, nearest, normal = position(medium, place), CUT, slope
    for n in range(len(medium.cuts)):
        across = (medium.cuts[n, 0], medium.cuts[n, 1], medium.cuts[n, 2])
        away = dot(across, at) + medium.cuts[n, 3]
        if away < nearest:
            length = max(length_of(slope), 2.0 * medium.classifier.lamp.flat) / length_of(across)
            nearest, normal = away, scaled(length, across)
    return normal


@inner_step
def _toward(v: Vector) -> Vector:
    """Normalize a vector."""
    return scaled(1.0 / math.sqrt(dot(v, v)), v)


@inner_step
def _cell(place: float, per: int, count: int) -> tuple[int, int, float]:
    """Cells before and behind a position along one axis, and the fraction between their centers."""
    # Clamp to the centers of the outermost cells.
    at = max(0.0, min(count - 1.0, (place - 0.5) / per - 0.5))
    before = int(at)
    return before, min(before + 1, count - 1), at - before


@inner_step
def _share_at(reached: Reached, place: Vector, n: int) -> float:
    """Share of light that reaches a position, trilinear between cells."""
    # Locate the eight cells around.
    share, per = reached.share, reached.per
    i, i_next, x = _cell(place[0], per, share.shape[2])
    j, j_next, y = _cell(place[1], per, share.shape[1])
    k, k_next, z = _cell(place[2], per, share.shape[0])
    # Interpolate along x, then add up along y and z.
    total = 0.0
    for plane, of_plane in ((k, 1.0 - z), (k_next, z)):
        for row, of_row in ((j, 1.0 - y), (j_next, y)):
            beside = (1.0 - x) * share[plane, row, i, n] + x * share[plane, row, i_next, n]
            total += of_plane * of_row * beside
    return total / ALL


@inner_step
def light_shares_at(medium: Medium, place: Vector) -> tuple[float, float]:
    """Shares of the lamp's light and of ambient light that reach a position, 0..1."""
    if medium.reached.share.size == 0:
        return 1.0, 1.0
    return _share_at(medium.reached, place, 0), _share_at(medium.reached, place, 1)


@inner_step
def aims_at(place: Vector, classifier: SummedClassifier) -> Aims:
    """Direction to the light and halfway vector at a scene position."""
    # The viewer is a position or, for parallel rays, a direction.
    lamp = classifier.lamp
    eye = (lamp.viewer[0], lamp.viewer[1], lamp.viewer[2])
    light = (lamp.toward[0], lamp.toward[1], lamp.toward[2])
    if lamp.viewer[3] != 0.0:
        eye = _toward(combine(eye, -1.0, place))
    # A lamp without a direction is a headlight.
    if dot(light, light) == 0.0:
        return Aims(eye, eye)
    # Normalize the halfway vector; it vanishes where light and eye are opposite.
    halfway = combine(eye, 1.0, light)
    return Aims(light, scaled(1.0 / max(math.sqrt(dot(halfway, halfway)), 1e-30), halfway))


@inner_step
def reflect(normal: Vector, aims: Aims, classifier: SummedClassifier) -> tuple[float, float]:
    """As `lighting.reflect`, without ambient light, and with tabulated highlights."""
    diffuse = classifier.lamp.diffuse * abs(dot(normal, aims.light))
    return diffuse, highlight_of(classifier, abs(dot(normal, aims.halfway)))


@inner_step
def reflected(medium: Medium, place: Vector, slope: Vector, aims: Aims) -> tuple[float, float]:
    """Factor of a surface's own color, and its white highlight (Blinn-Phong)."""
    lamp, length = medium.classifier.lamp, length_of(slope)
    of_lamp, of_all = light_shares_at(medium, place)
    # Shade by the normal where the gradient is steep enough for a surface.
    own, highlight = lamp.diffuse, 0.0
    if length > lamp.flat:
        own, highlight = reflect(scaled(1.0 / length, slope), aims, medium.classifier)
    return of_all * lamp.ambient + of_lamp * own, of_lamp * highlight
