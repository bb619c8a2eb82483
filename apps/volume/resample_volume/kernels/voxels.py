"""Kernels of voxels: what a pointer meets, their light, and gradients of their values."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_step, kernel, parallel_kernel, tasks
from resample.engine.rays.coefficients import value_and_slope_at
from resample.engine.vectors import Vector, dot, matrix_of, multiply
from resample.types import Doubles, Flags, Floats, Indices, Lamp, SplineField

CHUNK = 64  # rays that a thread takes at a time
STEPS = 4  # of a ray through a field, per voxel
MOST = 1 << 14  # voxels in a queue
NONE = -1  # no voxel, in place of an index
COMPOSITE, MAXIMUM, MINIMUM, FIRST_HIT = 0, 1, 2, 3  # projections of a field

Size = tuple[int, int, int]
Found = tuple[int, float]  # flat index of a voxel, and the transmittance behind it


class PickingRays(NamedTuple):
    """Rays through a lattice, by their depth along the view axis in scene units."""

    origin: Doubles  # (N, 3) voxels along x, y and z, at depth 0
    direction: Doubles  # (N, 3) voxels per depth
    length: Doubles  # (N,) scene units per depth
    first: Doubles  # (N,) depths between which something is visible
    last: Doubles  # (N,)


class SplattedVoxels(NamedTuple):
    """Voxels with splatting kernels around them."""

    extinction: Floats  # (N,) optical depth per scene unit, z slowest; 0: invisible
    size: Size  # voxels along x, y and z
    nearest: float  # depth of the first voxel
    deeper: Vector  # growth of depth along x, y and z
    footprint: Floats  # (K,) line integrals over the squared distance, in radii
    radius: float  # voxels


class PickedField(NamedTuple):
    """A field, and the target of picking."""

    spline: SplineField
    known: Flags  # as in `LatticeField`
    classifiers: int  # transfer functions beside each other in the table
    table: Floats  # (G, L K, 4) as in `Classifier`
    low: float
    high: float
    steep: float
    to_scene: Doubles  # (3, 3) takes slopes per voxel to slopes per scene unit
    wanted: int
    iso: float


class Waiting(NamedTuple):
    """Queue of voxels by depth, as long as others may come before them."""

    depth: Doubles
    voxel: Indices
    thickness: Doubles


@kernel
def _vector(rows: Doubles, n: int) -> Vector:
    """One row of an array (N, 3)."""
    return rows[n, 0], rows[n, 1], rows[n, 2]


@kernel
def _put(waiting: Waiting, count: int, depth: float, voxel: int, thickness: float) -> int:
    """Insert a voxel into the queue; equal depths keep the volume's order."""
    # Move farther voxels back; a full queue loses its last.
    n = min(count, MOST - 1)
    while n > 0 and (
        waiting.depth[n - 1] > depth
        or (waiting.depth[n - 1] == depth and waiting.voxel[n - 1] > voxel)
    ):
        waiting.depth[n] = waiting.depth[n - 1]
        waiting.voxel[n] = waiting.voxel[n - 1]
        waiting.thickness[n] = waiting.thickness[n - 1]
        n -= 1
    waiting.depth[n], waiting.voxel[n], waiting.thickness[n] = depth, voxel, thickness
    return min(count + 1, MOST)


@kernel
def _meet(
    splatted: SplattedVoxels, rays: PickingRays, n: int, axis: int, k: int, waiting: Waiting,
    count: int,
) -> int:  # fmt: skip
    """Queue the voxels of slice k across an axis with kernels that ray n meets."""
    origin, direction, size = _vector(rays.origin, n), _vector(rays.direction, n), splatted.size
    one, two = (axis + 1) % 3, (axis + 2) % 3
    strides = (1, size[0], size[0] * size[1])
    # Intersect the ray with the slice, and bound its kernels there.
    depth = (k - origin[axis]) / direction[axis]
    u, v = origin[one] + depth * direction[one], origin[two] + depth * direction[two]
    speed = math.sqrt(dot(direction, direction))
    reach = splatted.radius * speed / abs(direction[axis])
    per = rays.length[n] / (speed * splatted.radius**2)
    # Visit the voxels within.
    for b in range(max(0, math.ceil(u - reach)), min(size[one], math.floor(u + reach) + 1)):
        for c in range(max(0, math.ceil(v - reach)), min(size[two], math.floor(v + reach) + 1)):
            voxel = k * strides[axis] + b * strides[one] + c * strides[two]
            # Measure the distance from the ray, and the depth nearest to the voxel.
            along = ((b - u) * direction[one] + (c - v) * direction[two]) / speed
            away = ((b - u) ** 2 + (c - v) ** 2 - along**2) / splatted.radius**2
            at = depth + along / speed
            # Keep visible voxels with a kernel that the ray meets between its ends.
            if splatted.extinction[voxel] > 0 and away < 1 and rays.first[n] <= at <= rays.last[n]:
                deeper = splatted.deeper
                own = splatted.nearest + k * deeper[axis] + b * deeper[one] + c * deeper[two]
                # Find the optical depth along the ray.
                squared = max(away, 0.0) * (splatted.footprint.size - 1)
                m = min(int(squared), splatted.footprint.size - 2)
                low, high = float(splatted.footprint[m]), float(splatted.footprint[m + 1])
                integral = low + (squared - m) * (high - low)
                thickness = splatted.extinction[voxel] * per * integral
                count = _put(waiting, count, own, voxel, thickness)
    return count


@kernel
def _pass(
    waiting: Waiting, count: int, until: float, kept: float, level: float
) -> tuple[int, float, int]:
    """Attenuate light by queued voxels before a depth; return the rest, light and a voxel."""
    # Composite front to back until the level is passed.
    n = 0
    while n < count and waiting.depth[n] < until:
        kept *= math.exp(-waiting.thickness[n])
        if 1 - kept > level:
            return 0, kept, waiting.voxel[n]
        n += 1
    # Remove the voxels that were composited.
    if n:
        for m in range(n, count):
            waiting.depth[m - n] = waiting.depth[m]
            waiting.voxel[m - n] = waiting.voxel[m]
            waiting.thickness[m - n] = waiting.thickness[m]
    return count - n, kept, NONE


@kernel
def _pick_voxel(
    splatted: SplattedVoxels, rays: PickingRays, n: int, level: float, waiting: Waiting
) -> Found:
    """Voxel at which the share of light that ray n loses exceeds a level."""
    # Slice the volume across the axis along which the ray advances most.
    origin, direction = _vector(rays.origin, n), _vector(rays.direction, n)
    x, y, z = abs(direction[0]), abs(direction[1]), abs(direction[2])
    axis = 2 if z >= max(x, y) else 1 if y >= x else 0
    speed, fastest = math.sqrt(dot(direction, direction)), abs(direction[axis])
    beyond = splatted.radius * speed / fastest
    one, two = splatted.deeper[(axis + 1) % 3], splatted.deeper[(axis + 2) % 3]
    # Voxels of a slice may be nearer than the ray's own depth there by this.
    before = beyond * (abs(one) + abs(two))
    kept, count = 1.0, 0
    # Visit the slices front to back.
    for s in range(splatted.size[axis]):
        k = s if direction[axis] > 0 else splatted.size[axis] - 1 - s
        # Skip slices wholly outside the ray's ends.
        depth = (k - origin[axis]) / direction[axis]
        if depth + 2 * beyond / speed < rays.first[n] or depth - 2 * beyond / speed > rays.last[n]:
            continue
        # Queue the slice's voxels, and composite those in front of all later slices.
        count = _meet(splatted, rays, n, axis, k, waiting, count)
        count, kept, found = _pass(waiting, count, depth + 1 / fastest - before, kept, level)
        if found != NONE:
            return found, kept
    # Composite the rest.
    count, kept, found = _pass(waiting, count, math.inf, kept, level)
    return found, kept


@parallel_kernel
def pick_voxels(
    counter: Counter, splatted: SplattedVoxels, rays: PickingRays, level: float, voxel: Indices,
    kept: Doubles,
) -> None:  # fmt: skip
    """Find voxels (N,) where absorbed light exceeds a level, and transmittances."""
    waiting = Waiting(np.empty(MOST), np.empty(MOST, np.int64), np.empty(MOST))
    for chunk in tasks(counter, (voxel.size + CHUNK - 1) // CHUNK):
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, voxel.size)):
            voxel[n], kept[n] = _pick_voxel(splatted, rays, n, level, waiting)


@kernel
def _extinction(looked: PickedField, number: int, value: float, slope: Vector) -> float:
    """Optical depth per scene unit of a value and its slope in transfer function `number`."""
    if number < 0:
        return 0.0
    # Find the column by the value.
    rows, columns = looked.table.shape[0] - 1, looked.table.shape[1] // looked.classifiers - 1
    place = (value - looked.low) / (looked.high - looked.low) * columns
    place = min(max(place, 0.0), float(columns))
    # Find the row by the gradient's length.
    row = 0
    if rows > 0:
        turned = multiply(matrix_of(looked.to_scene), slope)
        share = math.sqrt(dot(turned, turned)) / looked.steep
        row = min(int(share * rows + 0.5), rows)
    # Interpolate between the nearest columns.
    k = min(int(place), columns - 1)
    share, k = float(place - k), k + number * (columns + 1)
    low, high = float(looked.table[row, k, 3]), float(looked.table[row, k + 1, 3])
    return low + share * (high - low)


@kernel
def _voxel_at(place: Vector, shape: Size) -> int:
    """Flat index of the voxel at a place; the first voxel is at (1, 1, 1)."""
    x = min(max(int(place[0] - 0.5), 0), shape[2] - 1)
    y = min(max(int(place[1] - 0.5), 0), shape[1] - 1)
    z = min(max(int(place[2] - 0.5), 0), shape[0] - 1)
    return (z * shape[1] + y) * shape[2] + x


@kernel
def _in_field(looked: PickedField, rays: PickingRays, n: int, level: float) -> Found:
    """Voxel around which ray n meets the target."""
    # Step along the ray, several times per voxel.
    origin, direction = _vector(rays.origin, n), _vector(rays.direction, n)
    step = 1 / (STEPS * math.sqrt(dot(direction, direction)))
    kept, best, found, wanted = 1.0, -math.inf, NONE, looked.wanted
    for s in range(math.ceil((rays.last[n] - rays.first[n]) / step)):
        depth = min(rays.first[n] + (s + 0.5) * step, rays.last[n])
        place = (
            origin[0] + depth * direction[0] + 1,
            origin[1] + depth * direction[1] + 1,
            origin[2] + depth * direction[2] + 1,
        )
        # Interpolate the field.
        value, slope = value_and_slope_at(looked.spline, place)
        # Composite until the level is passed, stop at the surface, or track the extreme.
        if wanted == COMPOSITE:
            number = 0  # transfer function of the voxel; below 0 if that is missing
            if looked.known.size > 0:
                i, j, k = int(place[0] + 1.5), int(place[1] + 1.5), int(place[2] + 1.5)
                at = k * looked.spline.plane + j * looked.spline.row + i
                number = int(looked.known[at]) - 1
            extinction = _extinction(looked, number, value, slope)
            kept *= math.exp(-extinction * step * rays.length[n])
            if 1 - kept > level:
                return _voxel_at(place, looked.spline.shape), kept
        elif wanted == FIRST_HIT:
            if value >= looked.iso:
                return _voxel_at(place, looked.spline.shape), 0.0
        elif (value if wanted == MAXIMUM else -value) > best:
            best = value if wanted == MAXIMUM else -value
            found, kept = _voxel_at(place, looked.spline.shape), 0.0
    return found, kept


@parallel_kernel
def pick_in_field(
    counter: Counter, looked: PickedField, rays: PickingRays, level: float, voxel: Indices,
    kept: Doubles,
) -> None:  # fmt: skip
    """Return `pick_voxels` for a field: voxels around which it is found."""
    for chunk in tasks(counter, (voxel.size + CHUNK - 1) // CHUNK):
        for n in range(chunk * CHUNK, min((chunk + 1) * CHUNK, voxel.size)):
            voxel[n], kept[n] = _in_field(looked, rays, n, level)


SHADED = 4096  # voxels that a thread takes at a time

TINY = 1e-300  # keeps divisions finite
FRACTION_BITS, BIAS = 52, np.int32(1023)  # of float64
UP_TO_ONE = 0x00095F619980C433  # from the bits of √½ to the bits of 1
LEAST = -1000.0  # exponent of 2
ONE, TWO, THREE = np.uint64(1), np.uint64(2), np.uint64(3)  # unsigned indices
SERIES = tuple(math.log(2) ** n / math.factorial(n) for n in range(8))  # of 2 ** x

Places = NDArray[np.int32]


@kernel
def power(base: float, exponent: float) -> float:
    """Power of a base from 0 to 1 to an exponent above 0, with an error below 1e-8."""
    # Split the base into m 2^k with m around 1.
    bits = np.float64(base).view(np.int64)
    k = np.int32((bits + UP_TO_ONE) >> FRACTION_BITS) - BIAS
    m = np.int64(bits - (np.int64(k) << FRACTION_BITS)).view(np.float64)
    # Take its logarithm: log m = 2 atanh f.
    f = (m - 1.0) / (m + 1.0)
    g = f * f
    log = 2.0 * f * (1.0 + g * (1 / 3 + g * (1 / 5 + g * (1 / 7 + g * (1 / 9)))))
    # Multiply by the exponent, and split into whole and fraction.
    y = max(exponent * (float(k) + log / math.log(2)), LEAST)
    whole = np.int32(y - 0.5)
    x = y - float(whole)
    # Evaluate 2^x by its series (Horner), and scale by the whole power.
    total = SERIES[7]
    for n in range(6, -1, -1):
        total = SERIES[n] + x * total
    scale = np.int64(np.int64(whole + BIAS) << FRACTION_BITS).view(np.float64)
    return total * scale if base > 0.0 else 0.0


@kernel
def _shade(position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats) -> None:
    """Shade voxels by Blinn and Phong; flat arrays of three numbers each."""
    # Load the light: `at_viewer` is a headlight, `is_near` tells perspective.
    eye_x, eye_y, eye_z, is_near = lamp.viewer[0], lamp.viewer[1], lamp.viewer[2], lamp.viewer[3]
    to_x, to_y, to_z = lamp.toward[0], lamp.toward[1], lamp.toward[2]
    at_viewer = to_x * to_x + to_y * to_y + to_z * to_z == 0.0
    flat = lamp.flat * lamp.flat
    half = 0.5 * lamp.shininess
    for n in range(np.uint64(len(position)) // THREE):
        a = THREE * n
        b, c = a + ONE, a + TWO
        # Find the direction to the viewer, and the angles to the gradient.
        x = eye_x - is_near * position[a]
        y = eye_y - is_near * position[b]
        z = eye_z - is_near * position[c]
        u, v, w = np.float64(gradient[a]), np.float64(gradient[b]), np.float64(gradient[c])
        steep = u * u + v * v + w * w
        away = x * x + y * y + z * z
        along = u * x + v * y + w * z
        # A headlight's halfway vector is the view direction; otherwise add both unit vectors.
        if at_viewer:
            facing = along * along / max(steep * away, TINY)
            diffuse = math.sqrt(facing)
        else:
            near = 1.0 / math.sqrt(max(away, TINY))
            x, y, z = x * near + to_x, y * near + to_y, z * near + to_z
            along = u * x + v * y + w * z
            facing = along * along / max(steep * (x * x + y * y + z * z), TINY)
            along = u * to_x + v * to_y + w * to_z
            diffuse = math.sqrt(along * along / max(steep, TINY))
        # Flat regions, without a gradient, have only ambient and diffuse light.
        own = lamp.ambient + lamp.diffuse * diffuse
        highlight = lamp.specular * power(facing, half)
        own = own if steep > flat else lamp.ambient + lamp.diffuse
        highlight = highlight if steep > flat else 0.0
        shaded[a] = max(own * color[a] + highlight, 0.0)
        shaded[b] = max(own * color[b] + highlight, 0.0)
        shaded[c] = max(own * color[c] + highlight, 0.0)


@kernel
def _shade_chunk(
    position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats, first: int
) -> None:
    """Shade the voxels of one chunk."""
    last = first + 3 * SHADED
    _shade(position[first:last], color[first:last], gradient[first:last], lamp, shaded[first:last])


@parallel_kernel
def shade_voxels(
    counter: Counter, position: Floats, color: Floats, gradient: Floats, lamp: Lamp, shaded: Floats
) -> None:
    """Fill in lit colors of voxels; all arrays are flat, three numbers each."""
    for chunk in tasks(counter, (len(position) // 3 + SHADED - 1) // SHADED):
        _shade_chunk(position, color, gradient, lamp, shaded, 3 * SHADED * chunk)


@kernel
def _envelope(away: Indices, stack: Indices) -> int:
    """Keep the places of a line that are nearest to some part of it; return how many.

    `away` (N,) is the squared distance from the line to the known voxel of each place, or below 0.
    `stack` (N,) receives the places, ascending. Section 4 of the paper: of three, the middle one is
    dropped where one of the two others is nearer all along the line.
    """
    count = 0
    for n in range(away.size):
        # Skip places without a known voxel.
        if away[n] < 0:
            continue
        # Pop places with a parabola hidden by its neighbours'.
        while count >= 2:
            last, before = stack[count - 1], stack[count - 2]
            a, b = last - before, n - last
            c = a + b
            if c * away[last] - b * away[before] - a * away[n] - a * b * c <= 0:
                break
            count -= 1
        stack[count] = n
        count += 1
    return count


@kernel
def _nearest_on_line(away: Indices, stack: Indices, found: Indices) -> None:
    """Find the (first) place with the nearest known voxel for all places of a line."""
    count, at = _envelope(away, stack), 0
    for n in range(away.size):
        if count == 0:
            found[n] = NONE
            continue
        # Advance along the envelope while the next place is nearer.
        own = (stack[at] - n) * (stack[at] - n) + away[stack[at]]
        while at + 1 < count:
            after = stack[at + 1]
            other = (after - n) * (after - n) + away[after]
            if own <= other:
                break
            own = other
            at += 1
        found[n] = stack[at]


@parallel_kernel
def nearest_in_columns(counter: Counter, deep: Places, z: int, down: Places) -> None:
    """Find the row (Y, X) in each column that leads to the nearest known voxel.

    `deep` (Y, X) is the z of the known voxel that is nearest along z, or NONE.
    """
    height, width = deep.shape
    away, stack = np.empty(height, np.int64), np.empty(height, np.int64)
    found = np.empty(height, np.int64)
    for x in tasks(counter, width):
        # Measure along z, then search along y.
        for y in range(height):
            far = np.int64(deep[y, x]) - z
            away[y] = NONE if deep[y, x] < 0 else far * far
        _nearest_on_line(away, stack, found)
        for y in range(height):
            down[y, x] = found[y]


@parallel_kernel
def nearest_in_rows(
    counter: Counter, deep: Places, down: Places, z: int, known: NDArray[np.bool_], across: Places
) -> None:
    """Find the column (Y, X) in each row, if not all known, with the nearest known voxel."""
    height, width = deep.shape
    away, stack = np.empty(width, np.int64), np.empty(width, np.int64)
    found = np.empty(width, np.int64)
    for y in tasks(counter, height):
        # Skip rows without gaps.
        if known[y].all():
            continue
        # Measure along y and z, then search along x.
        for x in range(width):
            row = np.int64(down[y, x])
            if row < 0:
                away[x] = NONE
                continue
            far = np.int64(deep[row, x]) - z
            away[x] = far * far + (row - y) * (row - y)
        _nearest_on_line(away, stack, found)
        for x in range(width):
            across[y, x] = found[x]


BRICK = 8  # voxels

Step = tuple[int, int, int]  # z, y, x


@kernel
def _next_place(index: int, before: int, at: Step, size: Step) -> Step:
    """Voxel of a flat index, given the previous index's: mostly in the same row."""
    x = at[2] + index - before
    if 0 <= x < size[2]:
        return at[0], at[1], x
    row, x = divmod(index, size[2])
    z, y = divmod(row, size[1])
    return z, y, x


@kernel
def brick_order(index: Indices, size: Step, order: Indices) -> None:
    """Find the order (N,) that sorts voxels by flat index into bricks; stable."""
    rows, columns = (size[1] + BRICK - 1) // BRICK, (size[2] + BRICK - 1) // BRICK
    layers = (size[0] + BRICK - 1) // BRICK
    start = np.zeros(layers * rows * columns + 1, np.int64)
    brick = np.empty(index.size, np.int32)
    # Count the voxels of each brick.
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, size)
        before = index[n]
        z, y, x = at
        brick[n] = (z // BRICK * rows + y // BRICK) * columns + x // BRICK
        start[brick[n] + 1] += 1
    # Turn counts into start positions.
    for b in range(start.size - 1):
        start[b + 1] += start[b]
    # Place each voxel (counting sort).
    for n in range(index.size):
        order[start[brick[n]]] = n
        start[brick[n]] += 1


@kernel
def place(index: Indices, size: Step, lattice: Doubles, origin: Doubles, position: Floats) -> None:
    """Scene positions (N, 3) of voxels, given by their flat index into (Z, Y, X)."""
    steps = matrix_of(lattice)
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, size)
        before = index[n]
        z, y, x = at
        moved = multiply(steps, (float(x), float(y), float(z)))
        for c in range(3):
            position[n, c] = origin[c] + moved[c]


@kernel
def _mean(behind: float, ahead: float) -> float:
    """Mean of the finite ones of two differences; NaN if neither is."""
    if not math.isfinite(ahead):
        return behind if math.isfinite(behind) else math.nan
    return 0.5 * (ahead + behind) if math.isfinite(behind) else ahead


@kernel
def _value(values: NDArray[Any], place: Step) -> float:
    """Value of a voxel; NaN outside the volume."""
    z, y, x = place
    depth, height, width = values.shape
    if 0 <= z < depth and 0 <= y < height and 0 <= x < width:
        return float(values[z, y, x])
    return math.nan


@kernel
def _slopes_at_border(values: NDArray[Any], place: Step) -> Vector:
    """Slopes along x, y and z from known neighbours; 0 where there is none."""
    z, y, x = place
    here = _value(values, place)
    # Difference to both sides along each axis; outside the volume these are NaN.
    left, right = here - _value(values, (z, y, x - 1)), _value(values, (z, y, x + 1)) - here
    above, below = here - _value(values, (z, y - 1, x)), _value(values, (z, y + 1, x)) - here
    before, after = here - _value(values, (z - 1, y, x)), _value(values, (z + 1, y, x)) - here
    x_slope, y_slope, z_slope = _mean(left, right), _mean(above, below), _mean(before, after)
    # Replace slopes without any neighbour.
    return (
        x_slope if math.isfinite(x_slope) else 0.0,
        y_slope if math.isfinite(y_slope) else 0.0,
        z_slope if math.isfinite(z_slope) else 0.0,
    )


@inner_step
def _central_slopes(values: NDArray[Any], place: Step) -> Vector:
    """Slopes along x, y and z from a voxel's neighbours; 0 where there is none."""
    z, y, x = place
    depth, height, width = values.shape
    # Inside the volume, and if all neighbours are finite, take central differences at once.
    if 0 < z < depth - 1 and 0 < y < height - 1 and 0 < x < width - 1:
        # Unsigned indices spare a test for negative ones.
        k, j, i, one = np.uint64(z), np.uint64(y), np.uint64(x), np.uint64(1)
        # Numba's float() of a float32 stays one: convert explicitly.
        here = np.float64(values[k, j, i])
        left, right = here - values[k, j, i - one], values[k, j, i + one] - here
        above, below = here - values[k, j - one, i], values[k, j + one, i] - here
        before, after = here - values[k - one, j, i], values[k + one, j, i] - here
        slope = (0.5 * (right + left), 0.5 * (below + above), 0.5 * (after + before))
        if math.isfinite(slope[0] + slope[1] + slope[2]):
            return slope
    return _slopes_at_border(values, place)


@kernel
def _moved(place: Step, count: int, step: Step) -> Step:
    """Move a voxel's place by so many steps."""
    return (place[0] + count * step[0], place[1] + count * step[1], place[2] + count * step[2])


@kernel
def _smooth_slope(values: NDArray[Any], place: Step, step: Step) -> float:
    """Mean slope of nine parallel lines, weighted 1-2-1 × 1-2-1; 0 if none is known."""
    # Find the two axes across the step's.
    across = (step[1], step[2], step[0])
    along = (step[2], step[0], step[1])
    total = weight = 0.0
    for a in range(-1, 2):
        line = _moved(place, a, across)
        for b in range(-1, 2):
            middle = _moved(line, b, along)
            # Difference along the line, and weigh it unless nothing is known.
            here = _value(values, middle)
            behind = here - _value(values, _moved(middle, -1, step))
            slope = _mean(behind, _value(values, _moved(middle, 1, step)) - here)
            if math.isfinite(slope):
                share = (2 - abs(a)) * (2 - abs(b))
                total += share * slope
                weight += share
    return total / weight if weight > 0.0 else 0.0


@kernel
def find_gradients(
    values: NDArray[Any], index: Indices, to_scene: Doubles, is_smooth: bool, gradient: Floats
) -> None:
    """Gradients (N, 3) of `values` (Z, Y, X) at flat indices; 0 if unknown.

    `to_scene` (3, 3), the inverse transpose of the lattice, takes slopes to scene units.
    """
    turn = matrix_of(to_scene)
    before, at = 0, (0, 0, 0)
    for n in range(index.size):
        at = _next_place(index[n], before, at, values.shape)
        before = index[n]
        if is_smooth:
            x_slope = _smooth_slope(values, at, (0, 0, 1))
            y_slope = _smooth_slope(values, at, (0, 1, 0))
            slope = (x_slope, y_slope, _smooth_slope(values, at, (1, 0, 0)))
        else:
            slope = _central_slopes(values, at)
        # Unsigned indices spare a test for negative ones.
        k, one = np.uint64(n), np.uint64(1)
        gradient[k, one - one], gradient[k, one], gradient[k, one + one] = multiply(turn, slope)
