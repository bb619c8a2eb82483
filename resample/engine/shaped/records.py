"""Ellipsoids on the screen: each becomes a record with a rational form for every pixel.

In the space in which an ellipsoid is the unit sphere around the origin, let u be the vector from
the eye to its center, and w + dx a + dy d the direction of the ray through the pixel (dx, dy) px
from a reference. Its squared distance from the center is

    i² = |u × (w + dx a + dy d)|² / |w + dx a + dy d|²,

exact for every ray, and it is nearest to the center at the depth u · (w + dx a + dy d) over the
same denominator. Records hold the coefficients of the three polynomials, divided by |w|².
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import Counter, inner_kernel, inner_step, parallel_kernel, tasks
from resample.engine.vectors import Matrix, Vector, column, cross, dot, matrix_of, multiply
from resample.types import Floats, Single, View

CHUNK = 4096  # samples that a thread projects at a time
THINNEST = 1e-9  # share of the longest half axis that others have at least
ASIDE = 0.02  # share of a center's distance that it is ahead, at least, to be the reference
FARTHEST = 4.0  # standard deviations to which Gaussians are painted, more than any
BEYOND = 1e30  # px: bounds of ellipsoids that may fill the screen

# Columns of a record.
X, Y = 0, 1  # px, the reference
N_1, N_X, N_Y, N_XX, N_XY, N_YY = range(2, 8)  # numerator of i²
D_X, D_Y, D_XX, D_XY, D_YY = range(8, 13)  # its denominator, less 1
T_1, T_X, T_Y = range(13, 16)  # numerator of the depth
PEAK = 16  # opacity at the center; or optical depth of a ray through it, for slopes of 0
# I² up to which it is painted; or SMALL. Where planes cut kernels, i is not 1 where they end, but
# the depth that a ray through the reference takes from the center until there.
LIMIT = 17
BOX_X, BOX_Y = 18, 19  # how far its box reaches to both sides of X and of Y, see `packed`
RED, GREEN, BLUE = range(20, 23)
WIDTH = 23
# While records are made they also have their boxes, and the numbers that they are ordered by.
LEFT, TOP, RIGHT, BOTTOM = range(WIDTH, WIDTH + 4)  # px; left > right: it is not seen
KEY = WIDTH + 4
WHOLE = WIDTH + 5
# An ellipsoid smaller than a sub-pixel is a box; each sub-pixel takes its share: its light is
# the same wherever it lies. The peak is all of its light.
SMALL = -1.0  # in place of the limit
WIDE, HIGH = N_XX, N_YY  # sub-pixels, sides of the box
LARGEST = 0.36  # variance, sub-pixels², from which on sums over a grid are right to 0.3 %
OWN = 1.0 - 1.0 / (12.0 * LARGEST)  # share of a variance that boxes have; sub-pixels are boxes too
BRIGHTEST = 4.0  # sub-pixels of light; brighter ellipsoids are no boxes
NARROWEST = 0.05  # sub-pixels, of boxes; differences of narrower ones are inexact
FIRST_OCTAVE, PER_OCTAVE = -10, 64  # of optical depths
DEEPEST = 2.0**10
DEPTHS = 2.0 ** (FIRST_OCTAVE + np.arange(20 * PER_OCTAVE + 1) / PER_OCTAVE)
UPPER, UNIT = np.uint32(0xFFFF0000), np.uint32(0x10000)  # the upper 16 bits of 32, and their unit


class ShapedArrays(NamedTuple):
    """N ellipsoids for kernels."""

    position: Floats  # (N, 3) scene units
    scale: Floats  # (N, 3) scene units, where i is 1 along each axis
    # (N, 4) quaternions w, x, y, z, of any length, from own axes to the scene's; or (1, 4) for all
    rotation: Floats
    weight: Floats  # (N,) opacity at the center, or extinction
    color: Floats  # (N, 3)


class ShapedOptions(NamedTuple):
    """How ellipsoids are projected."""

    width: int  # px
    height: int
    is_peak: bool  # weights are opacities of Gaussians at their centers, not extinctions
    is_affine: bool  # ellipses follow from the projection's linear part at the center (EWA)
    by_distance: bool  # ordered by distance from the eye
    dilation: float  # px² of a trained picture, which training has added to variances
    trained: float  # px, focal length of the trained picture
    is_compensated: bool  # opacities make up for the dilation (Mip-Splatting, Yu et al. 2024)
    faintest: float  # opacity below which Gaussians end
    nearest: float  # scene units; centers nearer to the eye are left out
    is_cut: bool = False  # planes cut kernels
    step: float = 0.0  # px between sub-pixels that smaller ellipsoids spread over; 0: not spread
    variance: float = 0.0  # of the kernel along an axis, radii²
    # (K,) light that a kernel takes of its area, per optical depth of its center; of DEPTHS
    taken: Floats = np.ones(1, np.float32)


class Covariance(NamedTuple):
    """The covariance of an ellipsoid in camera axes."""

    xx: float
    xy: float
    xz: float
    yy: float
    yz: float
    zz: float


@inner_step
def _spread(axes: Matrix, scale: Vector) -> Covariance:
    """Covariance of an ellipsoid; `axes` are columns in camera axes."""
    a, b, c = scale[0] * scale[0], scale[1] * scale[1], scale[2] * scale[2]
    x, y, z = axes
    return Covariance(
        x[0] * x[0] * a + x[1] * x[1] * b + x[2] * x[2] * c,
        x[0] * y[0] * a + x[1] * y[1] * b + x[2] * y[2] * c,
        x[0] * z[0] * a + x[1] * z[1] * b + x[2] * z[2] * c,
        y[0] * y[0] * a + y[1] * y[1] * b + y[2] * y[2] * c,
        y[0] * z[0] * a + y[1] * z[1] * b + y[2] * z[2] * c,
        z[0] * z[0] * a + z[1] * z[1] * b + z[2] * z[2] * c,
    )


@inner_step
def _on_screen(spread: Covariance, x: float, y: float) -> tuple[float, float, float]:
    """Covariance xx, xy, yy on the plane at distance 1, at slopes x and y, times the depth²."""
    xx = spread.xx - 2.0 * x * spread.xz + x * x * spread.zz
    yy = spread.yy - 2.0 * y * spread.yz + y * y * spread.zz
    xy = spread.xy - x * spread.yz - y * spread.xz + x * y * spread.zz
    return xx, xy, yy


@inner_step
def _is_beside(
    center: Vector, spread: Covariance, limit: float, slope: float, axis: int, sign: float
) -> bool:
    """Whether an ellipsoid up to i² = `limit` lies beyond an edge of the frame, through the eye.

    `slope`: of the plane, along x (`axis` 0) or y (1). `sign`: −1 for the left or upper edge.
    """
    along = center[0] if axis == 0 else center[1]
    own, mixed = (spread.xx, spread.xz) if axis == 0 else (spread.yy, spread.yz)
    reach = own - 2.0 * slope * mixed + slope * slope * spread.zz
    return bool(sign * (along - slope * center[2]) > math.sqrt(max(limit * reach, 0.0)))


@inner_kernel
def _set_bounds(
    record: Floats,
    center: Vector,
    spread: Covariance,
    view: View,
    options: ShapedOptions,
    limit: float,
) -> None:
    """Set the box around the visible part of an ellipsoid up to i² = `limit`."""
    fx, fy = view.focal[0], view.focal[1]
    cx, cy = view.principal[0], view.principal[1]
    x, y, z = center
    if not view.perspective:
        wide, high = fx * math.sqrt(limit * spread.xx), fy * math.sqrt(limit * spread.yy)
        middle = fx * x + cx, fy * y + cy
        record[LEFT], record[RIGHT] = middle[0] - wide, middle[0] + wide
        record[TOP], record[BOTTOM] = middle[1] - high, middle[1] + high
        return
    # Tangents from the eye; none if the ellipsoid meets the eye's plane.
    ahead = z * z - limit * spread.zz
    if not (z > 0.0 and ahead > 1e-9 * z * z):
        is_left = _is_beside(center, spread, limit, -cx / fx, 0, -1.0)
        is_above = _is_beside(center, spread, limit, -cy / fy, 1, -1.0)
        is_right = _is_beside(center, spread, limit, (options.width - cx) / fx, 0, 1.0)
        is_below = _is_beside(center, spread, limit, (options.height - cy) / fy, 1, 1.0)
        record[LEFT], record[RIGHT], record[TOP], record[BOTTOM] = -BEYOND, BEYOND, -BEYOND, BEYOND
        if is_left or is_above or is_right or is_below:
            record[RIGHT] = -BEYOND
        return
    middle_x = x * z - limit * spread.xz
    root = math.sqrt(max(0.0, middle_x * middle_x - ahead * (x * x - limit * spread.xx)))
    record[LEFT] = fx * (middle_x - root) / ahead + cx
    record[RIGHT] = fx * (middle_x + root) / ahead + cx
    middle_y = y * z - limit * spread.yz
    root = math.sqrt(max(0.0, middle_y * middle_y - ahead * (y * y - limit * spread.yy)))
    record[TOP] = fy * (middle_y - root) / ahead + cy
    record[BOTTOM] = fy * (middle_y + root) / ahead + cy


@inner_kernel
def _set_affine(
    record: Floats,
    center: Vector,
    spread: Covariance,
    view: View,
    options: ShapedOptions,
    limit: float,
) -> bool:
    """Set the ellipse of EWA splatting (Zwicker et al. 2001); return whether one exists."""
    x, y, z = center
    fx, fy = view.focal[0], view.focal[1]
    # The slopes at which the projection is linearized stay near the frame, as in training.
    across, down = x / z, y / z
    limit_x, limit_y = 0.65 * options.width / fx, 0.65 * options.height / fy
    across = min(max(across, -limit_x), limit_x)
    down = min(max(down, -limit_y), limit_y)
    xx, xy, yy = _on_screen(spread, across, down)
    xx, xy, yy = xx * fx * fx / (z * z), xy * fx * fy / (z * z), yy * fy * fy / (z * z)
    xx, yy = xx + options.dilation, yy + options.dilation
    area = xx * yy - xy * xy
    if not area > 0.0:
        return False
    record[X], record[Y] = fx * x / z + view.principal[0], fy * y / z + view.principal[1]
    record[N_XX], record[N_XY], record[N_YY] = yy / area, -2.0 * xy / area, xx / area
    record[N_1] = record[N_X] = record[N_Y] = 0.0
    record[D_X] = record[D_Y] = record[D_XX] = record[D_XY] = record[D_YY] = 0.0
    record[T_1], record[T_X], record[T_Y] = z, 0.0, 0.0
    wide, high = math.sqrt(limit * xx), math.sqrt(limit * yy)
    record[LEFT], record[RIGHT] = record[X] - wide, record[X] + wide
    record[TOP], record[BOTTOM] = record[Y] - high, record[Y] + high
    return True


@inner_kernel
def _set_parallel(record: Floats, center: Vector, to_unit: Matrix, view: View) -> None:
    """Set the form of an ellipsoid under parallel projection."""
    fx, fy = view.focal[0], view.focal[1]
    record[X] = fx * center[0] + view.principal[0]
    record[Y] = fy * center[1] + view.principal[1]
    ray, a, d = column(to_unit, 2), column(to_unit, 0), column(to_unit, 1)
    a, d = (a[0] / fx, a[1] / fx, a[2] / fx), (d[0] / fy, d[1] / fy, d[2] / fy)
    per = 1.0 / dot(ray, ray)
    e, f = cross(ray, a), cross(ray, d)
    record[N_1] = record[N_X] = record[N_Y] = 0.0
    record[N_XX], record[N_XY], record[N_YY] = (
        dot(e, e) * per,
        2.0 * dot(e, f) * per,
        dot(f, f) * per,
    )
    record[D_X] = record[D_Y] = record[D_XX] = record[D_XY] = record[D_YY] = 0.0
    record[T_1], record[T_X], record[T_Y] = center[2], -dot(a, ray) * per, -dot(d, ray) * per


@inner_kernel
def _set_central(
    record: Floats, center: Vector, to_unit: Matrix, view: View, options: ShapedOptions
) -> None:
    """Set the form of an ellipsoid under perspective projection."""
    x, y, z = center
    fx, fy = view.focal[0], view.focal[1]
    # The reference is where the center is seen, or the middle of the frame if it is not.
    is_seen = z > ASIDE * (abs(x) + abs(y) + abs(z))
    across = x / z if is_seen else (0.5 * options.width - view.principal[0]) / fx
    down = y / z if is_seen else (0.5 * options.height - view.principal[1]) / fy
    record[X], record[Y] = fx * across + view.principal[0], fy * down + view.principal[1]
    u, w = multiply(to_unit, center), multiply(to_unit, (across, down, 1.0))
    a, d = column(to_unit, 0), column(to_unit, 1)
    a, d = (a[0] / fx, a[1] / fx, a[2] / fx), (d[0] / fy, d[1] / fy, d[2] / fy)
    per = 1.0 / dot(w, w)
    e, f = cross(u, a), cross(u, d)
    record[N_1] = record[N_X] = record[N_Y] = 0.0
    if not is_seen:
        k = cross(u, w)
        record[N_1] = dot(k, k) * per
        record[N_X], record[N_Y] = 2.0 * dot(k, e) * per, 2.0 * dot(k, f) * per
    record[N_XX], record[N_XY], record[N_YY] = (
        dot(e, e) * per,
        2.0 * dot(e, f) * per,
        dot(f, f) * per,
    )
    record[D_X], record[D_Y] = 2.0 * dot(w, a) * per, 2.0 * dot(w, d) * per
    record[D_XX], record[D_XY], record[D_YY] = (
        dot(a, a) * per,
        2.0 * dot(a, d) * per,
        dot(d, d) * per,
    )
    record[T_1], record[T_X], record[T_Y] = dot(u, w) * per, dot(u, a) * per, dot(u, d) * per


@inner_step
def _turned(turn: Matrix, own: Matrix) -> Matrix:
    """Product of two matrices."""
    columns = (
        multiply(turn, column(own, 0)),
        multiply(turn, column(own, 1)),
        multiply(turn, column(own, 2)),
    )
    return column(columns, 0), column(columns, 1), column(columns, 2)


@inner_step
def _facing(center: Vector, away: float) -> Matrix:
    """Rotation (mirrored, perhaps) with a third row that points to a center."""
    z = (center[0] / away, center[1] / away, center[2] / away)
    aside = (0.0, z[2], -z[1]) if abs(z[0]) < 0.6 else (-z[2], 0.0, z[0])
    per = 1.0 / math.sqrt(dot(aside, aside))
    x = (aside[0] * per, aside[1] * per, aside[2] * per)
    return x, cross(z, x), z


@inner_step
def _weight_of(
    weight: float, center: Vector, axes: Matrix, scale: Vector, view: View, options: ShapedOptions
) -> float:
    """Weight of a Gaussian, without its training's compensation for the dilation."""
    z = center[2]
    if not options.is_compensated or z <= 0.0:
        return weight
    spread, slopes, per = _spread(axes, scale), (0.0, 0.0), options.trained
    if view.perspective:
        slopes, per = (center[0] / z, center[1] / z), options.trained / z
    # Take the share of the opacity that is left where the dilation widens it.
    xx, xy, yy = _on_screen(spread, slopes[0], slopes[1])
    xx, xy, yy = per * per * xx, per * per * xy, per * per * yy
    before = max(xx * yy - xy * xy, 0.0)
    after = (xx + options.dilation) * (yy + options.dilation) - xy * xy
    return weight * (math.sqrt(before / after) if after > 0.0 else 0.0)


@inner_step
def _wider_by(z: float, view: View, options: ShapedOptions) -> float:
    """Variance to add to a trained Gaussian, as training dilated it by px²."""
    if options.is_affine or not options.dilation > 0.0:
        return 0.0
    per = max(z, view.near, 1e-9) / options.trained if view.perspective else 1.0 / options.trained
    return options.dilation * per * per


@inner_kernel
def _set_form(
    record: Floats,
    center: Vector,
    axes: Matrix,
    scale: Vector,
    spread: Covariance,
    view: View,
    options: ShapedOptions,
    limit: float,
) -> float:
    """Set the exact form of an ellipsoid and its box; return half the chord of a slope of 0."""
    to_unit = (
        (axes[0][0] / scale[0], axes[1][0] / scale[0], axes[2][0] / scale[0]),
        (axes[0][1] / scale[1], axes[1][1] / scale[1], axes[2][1] / scale[1]),
        (axes[0][2] / scale[2], axes[1][2] / scale[2], axes[2][2] / scale[2]),
    )
    ray = (0.0, 0.0, 1.0)
    if view.perspective:
        _set_central(record, center, to_unit, view, options)
        across = (record[X] - view.principal[0]) / view.focal[0]
        ray = (across, (record[Y] - view.principal[1]) / view.focal[1], 1.0)
    else:
        _set_parallel(record, center, to_unit, view)
    _set_bounds(record, center, spread, view, options, limit)
    there = multiply(to_unit, ray)
    return 1.0 / math.sqrt(dot(there, there))


@inner_step
def _axes_of(shaped: ShapedArrays, n: int, turn: Matrix) -> Matrix:
    """Axes of an ellipsoid in camera space, as columns."""
    # Quaternions have any length but zero.
    w, x = float(shaped.rotation[n, 0]), float(shaped.rotation[n, 1])
    y, z = float(shaped.rotation[n, 2]), float(shaped.rotation[n, 3])
    s = 2.0 / (w * w + x * x + y * y + z * z)
    own = (
        (1.0 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)),
        (s * (x * y + w * z), 1.0 - s * (x * x + z * z), s * (y * z - w * x)),
        (s * (x * z - w * y), s * (y * z + w * x), 1.0 - s * (x * x + y * y)),
    )
    return _turned(turn, own)


@inner_kernel
def _spread_small(record: Floats, view: View, options: ShapedOptions) -> None:
    """Make a box of an ellipsoid smaller than a sub-pixel: its peak becomes its light."""
    if not record[LEFT] <= record[X] <= record[RIGHT]:  # its reference is elsewhere
        return
    # The ellipse (px²), by the inverse of its form.
    xx, xy, yy = float(record[N_XX]), 0.5 * float(record[N_XY]), float(record[N_YY])
    area = xx * yy - xy * xy
    if not area > 0.0:
        return
    longest = (0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy)) / area
    per = 1.0 / (options.step * options.step)
    if not per * options.variance * longest < LARGEST:
        return
    slant = 1.0
    if view.perspective:
        across = (float(record[X]) - view.principal[0]) / view.focal[0]
        down = (float(record[Y]) - view.principal[1]) / view.focal[1]
        slant = math.sqrt(1.0 + across * across + down * down)
    depth = float(record[PEAK]) * slant
    # The light that a kernel takes of its area follows from the optical depth of its center.
    taken, last = options.taken, options.taken.size - 1
    place = PER_OCTAVE * (math.log2(max(depth, 1e-30)) - FIRST_OCTAVE)
    k = min(max(int(place), 0), last - 1)
    share = min(max(place - k, 0.0), 1.0)
    ratio = taken[k] + share * (taken[k + 1] - taken[k])
    light = per * math.pi / math.sqrt(area) * float(min(depth, DEEPEST) * ratio)
    if not light < BRIGHTEST:
        return
    # As wide as the kernel, and so wide that no sub-pixel takes more light than there is.
    narrowest = math.sqrt(light) if light > 1.0 else NARROWEST
    along = 12.0 * OWN * options.variance * per / area
    wide = max(math.sqrt(along * yy), narrowest)
    high = max(math.sqrt(along * xx), narrowest)
    record[WIDE], record[HIGH], record[PEAK], record[LIMIT] = wide, high, light, SMALL
    reach = 0.5 * options.step * (1.0 + wide), 0.5 * options.step * (1.0 + high)
    record[LEFT], record[RIGHT] = record[X] - reach[0], record[X] + reach[0]
    record[TOP], record[BOTTOM] = record[Y] - reach[1], record[Y] + reach[1]


@inner_kernel
def _adapt(record: Floats, chord: float, view: View, options: ShapedOptions) -> None:
    """Turn a record into one of a small or a cut kernel, in place."""
    if options.step > 0.0:
        _spread_small(record, view, options)
    if options.is_cut and record[LIMIT] != SMALL:
        record[LIMIT] = chord * chord
        for k in range(N_1, N_YY + 1):
            record[k] *= record[LIMIT]


@inner_kernel
def _project_one(
    shaped: ShapedArrays,
    n: int,
    view: View,
    turn: Matrix,
    alike: Matrix,
    options: ShapedOptions,
    record: Floats,
) -> None:
    """Project an ellipsoid; records with left > right are culled.

    `alike`: axes of all, if they are.
    """
    record[LEFT], record[RIGHT] = 1.0, -1.0
    # Skip ellipsoids that are too faint, or behind the near plane whatever their rotation.
    weight = float(shaped.weight[n])
    faintest = options.faintest if options.is_peak else 0.0
    if not weight > faintest:
        return
    place, at, shift = shaped.position, n, view.translation
    center = multiply(turn, (float(place[at, 0]), float(place[at, 1]), float(place[at, 2])))
    center = center[0] + shift[0], center[1] + shift[1], center[2] + shift[2]
    z, away = center[2], math.sqrt(dot(center, center))
    if not away >= options.nearest:
        return
    wider = _wider_by(away if options.by_distance else z, view, options)
    s0, s1, s2 = float(shaped.scale[n, 0]), float(shaped.scale[n, 1]), float(shaped.scale[n, 2])
    longest = max(s0, s1, s2)
    reach = math.sqrt(longest * longest + wider) * (FARTHEST if options.is_peak else 1.0)
    if not z + reach > view.near:
        return
    # Axes in camera space; none is so short that it vanishes.
    axes = alike if shaped.rotation.shape[0] == 1 else _axes_of(shaped, n, turn)
    least = THINNEST * longest
    scale = (max(s0, least), max(s1, least), max(s2, least))
    # Opacity and width as they were trained; where faces meet, as if each were looked at.
    if options.is_compensated and options.by_distance:
        facing = _facing(center, away)
        weight = _weight_of(weight, (0.0, 0.0, away), _turned(facing, axes), scale, view, options)
    else:
        weight = _weight_of(weight, center, axes, scale, view, options)
    if not weight > faintest:
        return
    if wider > 0.0:
        scale = (
            math.sqrt(scale[0] * scale[0] + wider),
            math.sqrt(scale[1] * scale[1] + wider),
            math.sqrt(scale[2] * scale[2] + wider),
        )
    limit = 2.0 * math.log(weight / options.faintest) if options.is_peak else 1.0
    spread = _spread(axes, scale)
    if z + math.sqrt(limit * spread.zz) <= view.near:
        return
    # The form and its box.
    if options.is_affine:
        if not z > view.near or not _set_affine(record, center, spread, view, options, limit):
            return
        chord = 0.0
    else:
        chord = _set_form(record, center, axes, scale, spread, view, options, limit)
        weight *= 1.0 if options.is_peak else chord
    record[PEAK], record[LIMIT] = weight, limit
    _adapt(record, chord, view, options)
    # Leave out what the frame does not show.
    is_beside = record[RIGHT] <= 0.0 or record[LEFT] >= options.width
    if is_beside or record[BOTTOM] <= 0.0 or record[TOP] >= options.height:
        record[LEFT], record[RIGHT] = 1.0, -1.0
        return
    record[KEY] = away if options.by_distance else z
    record[BOX_X] = _packed(record[X] - record[LEFT], record[RIGHT] - record[X])
    record[BOX_Y] = _packed(record[Y] - record[TOP], record[BOTTOM] - record[Y])
    record[RED], record[GREEN] = shaped.color[n, 0], shaped.color[n, 1]
    record[BLUE] = shaped.color[n, 2]


@inner_step
def _rounded_up(extent: float) -> np.uint32:
    """Bits of a float32 no less than a number, with the lower 16 bits 0."""
    bits = np.float32(extent).view(np.uint32)
    return np.uint32((bits + UNIT if extent >= 0.0 else bits) & UPPER)


@inner_step
def _packed(before: float, after: float) -> Single:
    """Two extents, rounded up to 16 bits each."""
    return np.uint32(_rounded_up(before) | (_rounded_up(after) >> np.uint32(16))).view(np.float32)


@inner_step
def span_of(record: Floats, axis: int) -> tuple[float, float]:
    """Start and end of a record's box along x (`axis` 0) or y (1), px."""
    middle, bits = float(record[X + axis]), np.float32(record[BOX_X + axis]).view(np.uint32)
    before = np.uint32(bits & UPPER).view(np.float32)
    after = np.uint32(bits << np.uint32(16)).view(np.float32)
    return middle - float(before), middle + float(after)


@parallel_kernel
def project_shapes(
    counter: Counter, shaped: ShapedArrays, view: View, options: ShapedOptions, records: Floats
) -> None:
    """Project all ellipsoids to `records` (N, WHOLE), which are filled."""
    count = shaped.weight.size
    turn = matrix_of(view.rotation)
    alike = _axes_of(shaped, 0, turn) if count else turn
    for chunk in tasks(counter, (count + CHUNK - 1) // CHUNK):
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, count)):
            _project_one(shaped, n, view, turn, alike, options, records[n])
