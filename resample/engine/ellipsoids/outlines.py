"""Project samples to the screen, many at once: bounds, keys, spacings and quadratic forms.

The formulas are those of `resample.engine.ellipsoids.footprints` for exact footprints, written
without branches, so that the compiler vectorizes over eight samples. Results are columns of numbers
at fixed distances, for the same reason as in `resample.engine.ellipsoids.rows`.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.compositing import key_of, place_of
from resample.engine.ellipsoids.footprints import (
    Eye,
    Optics,
    Shape,
    Side,
    in_camera,
    linear_part,
    major_of,
    optics_of,
)
from resample.engine.jit import kernel
from resample.engine.sorting import Pairs, bits_of, paired
from resample.engine.subpixels import POINT_SPACING, point_width
from resample.engine.vectors import Vector, column, cross, dot, multiply, scaled, vector_at
from resample.types import (
    AFFINE,
    SMALL_ANGLE,
    Doubles,
    Floats,
    Layers,
    Place,
    Single,
    Stage,
    Style,
)

BATCH = 256  # samples
# Columns of a batch.
LEFT, TOP, RIGHT, BOTTOM, DEPTH, KEY, SPACING, CUT, X, Y, A, B, C = (
    np.uint64(number * BATCH) for number in range(13)
)
ACROSS, DOWN, HOME, EXTINCTION, RED, GREEN, BLUE = (
    np.uint64(number * BATCH) for number in range(13, 20)
)
AMPLITUDE, FLAT, BENT, AREA, OPACITY, SIZE = (np.uint64(number * BATCH) for number in range(20, 26))
SCRATCH_SIZE = 26 * BATCH  # numbers in a batch
EVERYWHERE = 1e9  # px, bounds of samples that any pixel may see
# Upper bound of rounding errors
SLACK = 1e-9  # share of a half extent or a distance

Sides = tuple[Side, Side, Side, Side]
Bounds = tuple[Single, Single, Single, Single]  # px: left, right, top, bottom


class Margin(NamedTuple):
    """Margin beyond the outlines of their ellipsoids within which samples are painted."""

    mirrored: bool  # footprints are symmetric about the projected center
    beyond: Single  # px by which splats are widened, at most
    threshold: Single  # px of spacing up to which samples may be points; 0: none is a point
    extent: Single  # widths at which the filter of points ends
    variance: Single  # voxels², as in `Style`
    fixed: Single  # sub-pixels per side of a pixel; 0: chosen per tile
    for_splats: Single  # sub-pixels per side, at most, for splats
    for_points: Single  # and for points
    closest: Single  # sub-pixels between points, at most


NO_REACH = Margin(False, *np.zeros(8, np.float32))  # all samples are splats of exact footprint


class OutlineSetup(NamedTuple):
    """Parameters of the projection of samples, as numbers."""

    optics: Optics
    layers: Layers
    beyond: Margin
    faintest: Single  # samples of this extinction or less are left out


class Window(NamedTuple):
    """The sub-pixels of a tile, and its bounds for culling."""

    place: Place
    height: int  # sub-pixels
    width: int
    home: Bounds  # px, bounds of the centers of samples that the tile counts as its own
    sides: Sides  # half spaces that hold the centers of samples that touch it


@kernel
def outline_setup(stage: Stage, margin: Margin) -> OutlineSetup:
    """Parameters of the projection, for samples with this margin."""
    return OutlineSetup(optics_of(stage), stage.layers, margin, np.float32(stage.style.faintest))


@kernel
def reach_of(style: Style, radius: float) -> Margin:
    """Margins of samples; `radius` of the ellipsoid in voxels."""
    widened = style.inflated * radius + math.sqrt(style.blurred)
    return Margin(
        style.model in (AFFINE, SMALL_ANGLE),
        np.float32(widened),
        np.float32(min(style.threshold, 1e30)),
        np.float32(style.point_extent),
        np.float32(style.variance),
        np.float32(style.subpixels),
        np.float32(style.most_for_splats),
        np.float32(style.most_for_points),
        np.float32(min(style.threshold, POINT_SPACING)),
    )


@kernel
def pad_of(spacing: Single, reach: Margin) -> Single:
    """Px of margin beyond the outline of a sample of this spacing; a tile may be finer."""
    one, zero = np.float32(1.0), np.float32(0.0)
    # Samples that are cut have no spacing; bound it, so that what follows is finite.
    apart = max(np.float32(1e-6), min(spacing, np.float32(1e15)))
    # Grid of a tile whose smallest spacing is this one, as in `grid`.
    finest = min(reach.for_points, np.floor(reach.closest / apart))
    finest = max(one, min(reach.for_splats, np.ceil(one / apart)), finest)
    finest = reach.fixed if reach.fixed > zero else finest
    # Extent of the point filter on that grid.
    width = np.sqrt(reach.variance * apart * apart + np.float32(1.0 / 12.0) / (finest * finest))
    pad = reach.extent * width
    return max(reach.beyond, pad if spacing <= reach.threshold else zero)


@kernel
def pad_of_tile(style: Style, widened: Single, subpixels: int) -> float:
    """Px of margin beyond outlines for all samples of a tile, at most; points are finite."""
    width = point_width(min(style.threshold, 1e30), style.variance)
    pad = style.point_extent * width / subpixels
    return max(float(widened), pad if style.threshold > 0.0 else 0.0)


@kernel
def size_of(scale: Floats | None, sample: np.uint64) -> float:
    """Size of a sample's ellipsoid relative to the others'."""
    return 1.0 if scale is None else float(scale[sample])


@kernel
def unit_sized(center: Vector, eye: Eye, size: float) -> tuple[Vector, Eye]:
    """The sample scaled to size 1 about the eye, and the eye that sees the same picture of it.

    Perspective needs no change of the focal lengths; parallel rays come closer together.
    """
    per_size = 1.0 / size
    apart = 1.0 if eye.perspective else size
    x, y, z = center
    nearer = (per_size * x, per_size * y, per_size * z)
    fx, fy, near = apart * eye.fx, apart * eye.fy, per_size * eye.near
    return nearer, Eye(eye.rotation, eye.shift, fx, fy, eye.cx, eye.cy, near, eye.perspective)


@kernel
def _bounds_of(center: Vector, eye: Eye, shape: Shape) -> tuple[float, float, float, float]:
    """Left, top, right and bottom in px of an ellipsoid in front of the eye."""
    # Planes through the eye that touch the ellipsoid: roots of a quadratic equation per axis.
    x, y, z = center
    v = shape.covariance
    in_front = z * z - v[2][2] if eye.perspective else 1.0
    per_front = 1.0 / in_front
    middle_x = x * z - v[0][2] if eye.perspective else x
    middle_y = y * z - v[1][2] if eye.perspective else y
    wide = math.sqrt(max(0.0, middle_x * middle_x - in_front * (x * x - v[0][0])))
    high = math.sqrt(max(0.0, middle_y * middle_y - in_front * (y * y - v[1][1])))
    return (
        eye.fx * ((middle_x - wide) * per_front) + eye.cx,
        eye.fy * ((middle_y - high) * per_front) + eye.cy,
        eye.fx * ((middle_x + wide) * per_front) + eye.cx,
        eye.fy * ((middle_y + high) * per_front) + eye.cy,
    )


@kernel
def outline_batch(
    room: Floats,
    position: Floats,
    extinction: Floats,
    scale: Floats | None,
    begin: int,
    count: int,
    setup: OutlineSetup,
) -> None:
    """Compute bounds in px, key and spacing of `count` samples; left > right: not visible.

    The samples begin at `begin`. Those that the near plane cuts are marked, and have no spacing.
    """
    (camera, shape, area), layers, margin, faintest = setup
    far, are_resized = camera.perspective, scale is not None
    low, high_x, high_y = -area.margin, area.width + area.margin, area.height + area.margin
    reach, per_radius = math.sqrt(shape.covariance[2][2]), 1.0 / shape.radius
    to_left, to_right, to_top, to_bottom = area.sides
    least = reach if far else -np.inf
    for n in range(count):
        k = np.uint64(n)
        sample = np.uint64(begin) + k
        # Transform to camera axes, compute the key, and scale to size 1.
        world = vector_at(position, sample)
        center = in_camera(camera, world)
        key = key_of(layers, place_of(layers, world, center))
        center, eye = unit_sized(center, camera, size_of(scale, sample))
        cx, cy, cz = center
        # Project: linear part, bounds, and signed distances from the sides of the frame.
        per_z = 1.0 / cz if far else 1.0
        _, _, _, _, xx, yy, xy = linear_part(center, eye, shape)
        left, top, right, bottom = _bounds_of(center, eye, shape)
        beside = max(
            to_left[0] * cx + to_left[1] * cy + to_left[2] * cz + to_left[3],
            to_right[0] * cx + to_right[1] * cy + to_right[2] * cz + to_right[3],
            to_top[0] * cx + to_top[1] * cy + to_top[2] * cz + to_top[3],
            to_bottom[0] * cx + to_bottom[1] * cy + to_bottom[2] * cz + to_bottom[3],
        )
        # Mark samples that the near plane cuts; those that reach behind the eye are everywhere.
        is_cut = (cz - reach <= eye.near) | (cz <= least)
        is_around = cz <= least
        # Spacing and projected center.
        spacing = np.float32(np.inf) if is_cut else np.float32(major_of(xx, yy, xy) * per_radius)
        on_x, on_y = eye.fx * (cx * per_z) + eye.cx, eye.fy * (cy * per_z) + eye.cy
        # Make the bounds symmetric where footprints are, and add the margin.
        wide, high = max(on_x - left, right - on_x), max(on_y - top, bottom - on_y)
        left, right = (on_x - wide, on_x + wide) if margin.mirrored else (left, right)
        top, bottom = (on_y - high, on_y + high) if margin.mirrored else (top, bottom)
        pad = float(pad_of(spacing, margin))
        left, top, right, bottom = left - pad, top - pad, right + pad, bottom + pad
        # Cull by the bounds where these are widened, else by the sides of the frame, which are
        # exact.
        is_inside = (right >= low) & (left <= high_x) & (bottom >= low) & (top <= high_y)
        are_bounds_right = ((pad > 0.0) | margin.mirrored) & (not is_cut)
        # With parallel rays the sides of the frame hold for size 1 only.
        are_bounds_right |= are_resized & (not far)
        is_inside = is_inside if are_bounds_right else beside <= 0.0
        is_seen = is_inside & (cz + reach > eye.near)
        is_seen &= extinction[sample] > faintest
        # Write the columns.
        left, right = (-EVERYWHERE, EVERYWHERE) if is_around else (left, right)
        top, bottom = (-EVERYWHERE, EVERYWHERE) if is_around else (top, bottom)
        room[k + LEFT] = np.float32(left) if is_seen else np.float32(np.inf)
        room[k + RIGHT] = np.float32(right) if is_seen else np.float32(-np.inf)
        room[k + TOP] = np.float32(top)
        room[k + BOTTOM] = np.float32(bottom)
        room[k + KEY] = key
        room[k + SPACING] = spacing
        room[k + CUT] = np.float32(1.0) if is_cut else np.float32(0.0)
        room[k + X] = np.float32(on_x)
        room[k + Y] = np.float32(on_y)


@kernel
def _side(normal: Vector, offset: float, eye: Eye, shape: Shape) -> Side:
    """Half space of the centers of ellipsoids that touch a half space of camera axes.

    In scene axes, with a margin for rounding; distances are in extents of the ellipsoid beyond it.
    """
    # Half the ellipsoid's width along the normal.
    reach = math.sqrt(dot(normal, multiply(shape.covariance, normal)))
    r, per_reach = eye.rotation, 1.0 / reach
    return (
        per_reach * dot(column(r, 0), normal),
        per_reach * dot(column(r, 1), normal),
        per_reach * dot(column(r, 2), normal),
        per_reach * (dot(normal, eye.shift) + offset - (1.0 + SLACK) * reach),
    )


@kernel
def sides_of(eye: Eye, shape: Shape, place: Place, size: tuple[int, int], pad: float) -> Sides:
    """Half spaces of the centers of samples that reach within `pad` px of a canvas.

    `size` is rows and columns.
    """
    # Edges of the canvas, through the centers of the outermost sub-pixels.
    far, half = eye.perspective, 0.5 / place.subpixels - pad
    height, width = size
    left, right = place.x + half - eye.cx, place.x + width / place.subpixels - half - eye.cx
    top, bottom = place.y + half - eye.cy, place.y + height / place.subpixels - half - eye.cy
    # Planes through the eye and the edges; parallel to the axis where rays are parallel.
    along, beside = (1.0, 0.0) if far else (0.0, 1.0)
    return (
        _side((-eye.fx, 0.0, along * left), beside * left, eye, shape),
        _side((eye.fx, 0.0, -along * right), -beside * right, eye, shape),
        _side((0.0, -eye.fy, along * top), beside * top, eye, shape),
        _side((0.0, eye.fy, -along * bottom), -beside * bottom, eye, shape),
    )


@kernel
def meet_batch(
    pair: Pairs,
    position: Floats,
    extinction: Floats,
    scale: Floats | None,
    begin: int,
    count: int,
    setup: OutlineSetup,
    window: Window,
) -> None:
    """Pairs of key and number of `count` samples from `begin` on; 0 if one misses the canvas."""
    (eye, shape, _), layers, margin, faintest = setup
    is_mirrored = margin.mirrored and eye.perspective
    reach = math.sqrt(shape.covariance[2][2])
    to_left, to_right, to_top, to_bottom = window.sides
    least = reach if eye.perspective else -np.inf
    for n in range(count):
        # Signed distances from the sides of the canvas.
        sample = np.uint64(begin) + np.uint64(n)
        world = vector_at(position, sample)
        x, y, z = world
        beside = max(
            to_left[0] * x + to_left[1] * y + to_left[2] * z + to_left[3],
            to_right[0] * x + to_right[1] * y + to_right[2] * z + to_right[3],
            to_top[0] * x + to_top[1] * y + to_top[2] * z + to_top[3],
            to_bottom[0] * x + to_bottom[1] * y + to_bottom[2] * z + to_bottom[3],
        )
        # Key of the sample, and its center at size 1.
        center = in_camera(eye, world)
        key = key_of(layers, place_of(layers, world, center))
        size = size_of(scale, sample)
        center, _ = unit_sized(center, eye, size)
        # A symmetric footprint reaches farther than its ellipsoid by at most so many extents:
        # slanted edges change by no more than depths do.
        excess = 2.0 * reach / (center[2] - 2.0 * reach) if is_mirrored else 0.0
        if scale is not None:
            excess = size * (excess + 1.0 + SLACK) - 1.0
        # Compare with the margin, and write the pair without a branch.
        is_met = (beside <= excess) | (center[2] <= (2.0 * least if is_mirrored else least))
        is_met &= extinction[sample] > faintest
        found = paired(bits_of(key), int(sample))
        pair[np.uint64(n)] = found if is_met else np.uint64(0)


@kernel
def meet_outlined(pair: Pairs, room: Floats, begin: int, count: int, window: Window) -> None:
    """As `meet_batch`, for samples outlined by `outline_batch`."""
    # Centers of the outermost sub-pixels.
    place, height, width = window.place, window.height, window.width
    half = np.float32(0.5 / place.subpixels)
    left, top = np.float32(place.x) + half, np.float32(place.y) + half
    right = np.float32(place.x + width / place.subpixels) - half
    bottom = np.float32(place.y + height / place.subpixels) - half
    for n in range(count):
        k = np.uint64(n)
        # Compare their bounds with those of the sample.
        is_met = (room[k + LEFT] <= right) & (room[k + RIGHT] >= left)
        is_met &= (room[k + TOP] <= bottom) & (room[k + BOTTOM] >= top)
        found = paired(bits_of(room[k + KEY]), begin + n)
        pair[k] = found if is_met else np.uint64(0)


@kernel
def form_batch(
    room: Floats,
    position: Floats,
    scale: Floats | None,
    count: int,
    setup: OutlineSetup,
    window: Window,
) -> None:
    """Compute all that painting needs of `count` samples, at `position` (3 n,).

    Bounds are first sub-pixels and one past the last, as whole numbers, on a canvas of `height`
    rows and `width` columns. Samples that the near plane cuts hold their center in place of a form.
    """
    (camera, shape, _), (place, height, width, home, _) = setup.optics, window
    t, reach = shape.to_unit, math.sqrt(shape.covariance[2][2])
    far, per_px = camera.perspective, float(place.subpixels)
    least = reach if far else -np.inf
    last_column, last_row, half = width - 1.0, height - 1.0, 0.5 / place.subpixels
    columns, rows = float(width), float(height)
    first_x, last_x, first_y, last_y = home
    for n in range(count):
        k = np.uint64(n)
        # Transform to camera axes, and scale to size 1.
        center = in_camera(camera, vector_at(position, k))
        depth, size = center[2], size_of(scale, k)
        center, eye = unit_sized(center, camera, size)
        cx, cy, cz = center
        per_z = 1.0 / cz if far else 1.0
        # Bounds, and whether the near plane cuts.
        left, top, right, bottom = _bounds_of(center, eye, shape)
        is_cut = (cz - reach <= eye.near) | (cz <= least)
        is_around = cz <= least
        # The quadratic form: squared length of c × w over the offset in px.
        unit = multiply(t, center)
        ray_x, ray_y = unit[0] if far else t[0][2], unit[1] if far else t[1][2]
        ray = (ray_x, ray_y, unit[2] if far else t[2][2])
        per_px_of_size = 1.0 if far else 1.0 / size
        across = cross(ray, scaled(per_px_of_size, shape.across))
        down = cross(ray, scaled(per_px_of_size, shape.down))
        # Projected center, and whether the tile counts the sample as its own.
        on_x = np.float32(eye.fx * (cx * per_z) + eye.cx)
        on_y = np.float32(eye.fy * (cy * per_z) + eye.cy)
        is_home = (on_x >= first_x) & (on_x < last_x) & (on_y >= first_y) & (on_y < last_y)
        # Round the bounds to sub-pixels, clamped to the canvas.
        left = max(0.0, min(columns, np.ceil((left - place.x) * per_px - 0.5)))
        right = max(-1.0, min(last_column, np.floor((right - place.x) * per_px - 0.5)))
        top = max(0.0, min(rows, np.ceil((top - place.y) * per_px - 0.5)))
        bottom = max(-1.0, min(last_row, np.floor((bottom - place.y) * per_px - 0.5)))
        left, right = (0.0, last_column) if is_around else (left, right)
        top, bottom = (0.0, last_row) if is_around else (top, bottom)
        # Write the columns.
        room[k + LEFT] = np.float32(left)
        room[k + RIGHT] = np.float32(right + 1.0)
        room[k + TOP] = np.float32(top)
        room[k + BOTTOM] = np.float32(bottom + 1.0)
        room[k + DEPTH] = np.float32(depth)
        room[k + X] = on_x
        room[k + Y] = on_y
        room[k + ACROSS] = np.float32(place.x + half - on_x)
        room[k + DOWN] = np.float32(place.y + half - on_y)
        room[k + HOME] = np.float32(1.0) if is_home else np.float32(0.0)
        room[k + CUT] = np.float32(1.0) if is_cut else np.float32(0.0)
        room[k + A] = np.float32(unit[0] if is_cut else dot(across, across))
        room[k + B] = np.float32(unit[1] if is_cut else dot(across, down))
        room[k + C] = np.float32(unit[2] if is_cut else dot(down, down))


@kernel
def clip_batch(
    room: Floats,
    position: Floats,
    scale: Floats | None,
    begin: int,
    count: int,
    setup: OutlineSetup,
    planes: Doubles,
) -> None:
    """Hide samples beyond a clipping plane (M, 5), and mark those that a plane cuts.

    Points are as small as sub-pixels: their centers decide.
    """
    (eye, shape, _), margin = setup.optics, setup.beyond
    finest = max(margin.for_splats, margin.for_points) if margin.fixed == 0.0 else margin.fixed
    for n in range(count):
        k, sample, nearest, is_point = np.uint64(n), np.uint64(begin + n), np.inf, False
        center, size = in_camera(eye, vector_at(position, sample)), size_of(scale, sample)
        # Whether the sample is a point even on the finest grid.
        if margin.threshold > 0.0:
            is_point = room[k + SPACING] * finest <= margin.threshold and room[k + CUT] == 0.0
        # Compare its signed distance from each plane with its extent.
        for m in range(planes.shape[0]):
            inside = planes[m, 0] * center[0] + planes[m, 1] * center[1]
            inside += planes[m, 2] * center[2] + planes[m, 3]
            reach = 0.0 if is_point else size * planes[m, 4]
            if inside <= -reach:
                room[k + LEFT], room[k + RIGHT] = EVERYWHERE, -EVERYWHERE
            nearest = min(nearest, inside - reach)
        # Store the center in place of the form.
        if nearest < 0.0 and not is_point:
            unit = multiply(shape.to_unit, unit_sized(center, eye, size)[0])
            room[k + CUT] = 1.0
            room[k + A], room[k + B], room[k + C] = unit
