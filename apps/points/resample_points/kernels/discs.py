"""Project the discs of a cloud to the screen, and paint them.

The disc p + u a + v b covers the pixel (x, y) where H (u, v, 1) ~ (x, y, 1), with the columns
P a, P b and P p + t of H. The inverse of H gives u, v and 1 / z of the disc's plane at a pixel as
ratios of linear functions, without approximation. Only where a disc is so small, or so oblique,
that it would fall between sub-pixels, its projection is linearized, and its singular values are
clamped to the size of a sub-pixel: such discs are points along one axis, or along both.

A sub-pixel shows all discs of the surface in front of it, weighted by the distance of their
centers; discs with planes farther there than sampling explains belong to the next surface,
which shows where the first leaves the pixel uncovered.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, plays, tasks
from resample.engine.surfaces import (
    COVER,
    NEAR,
    WEIGHT,
    Block,
    Surfaces,
    add,
    claim,
    claimed,
    first_used,
    paint_tile,
    row_shift,
    whole_within,
    write,
)
from resample.engine.tiles import overlapping_tiles
from resample.engine.vectors import Vector, cross, dot
from resample.types import Doubles, Floats, Record, Records, Single, Tiles

CHUNK = 4096  # discs that a thread takes at a time
REACH = 1.75  # radii at which a disc's weight (1 − i² / REACH²)² ends
FINEST = 1.0  # sub-pixels, least extent along any axis
STEEPEST = 8.0  # tangent between the screen and the plane of a point
LOOSEST = 0.5  # of the nearness: largest difference of discs of one surface

# With (dx, dy) a pixel's offset from (x, y), and D = 1 + slope_x dx + slope_y dy: the disc has the
# nearness D × nearness there, and the index i = |(ux dx + uy dy, vx dx + vy dy)| / E in units of
# the extent, with E = D where weight = 1 and E = 1 where it is less.
SURFEL = np.dtype(
    [
        ("x", np.float32),  # px, where the center projects
        ("y", np.float32),
        ("ux", np.float32),  # px⁻¹
        ("uy", np.float32),
        ("vx", np.float32),
        ("vy", np.float32),
        ("slope_x", np.float32),  # px⁻¹
        ("slope_y", np.float32),
        ("nearness", np.float32),  # 1 / z of the center, 1 / scene units
        ("keep", np.float32),  # surfaces nearer than keep × nearness are the same as the disc's
        ("weight", np.float32),  # area of the disc over the drawn area; 1: a splat
        ("left", np.float32),  # px, bounds; left > right: none
        ("top", np.float32),
        ("right", np.float32),
        ("bottom", np.float32),
        ("spacing", np.float32),  # px, the disc's smaller axis
        ("red", np.float32),
        ("green", np.float32),
        ("blue", np.float32),
    ]
)


class CloudCamera(NamedTuple):
    """Camera and drawing options of discs."""

    projection: Doubles  # (3, 4) takes places (x, y, z, 1) to px × depth
    place: Doubles  # (3,) of the camera, scene units
    height: int  # px
    width: int  # px
    focal: float  # px, mean of both axes
    near: float  # scene units; nearer centers are left out
    subpixels: int  # per side of a pixel
    size: float  # factor of the discs' size
    headlight: bool  # shade by the angle between normal and view
    cull: bool  # leave out discs seen from behind
    tolerance: float  # radii by which discs of one surface may differ in depth


@kernel
def _project(eye: CloudCamera, vector: Vector, last: float) -> Vector:
    """Homogeneous px of a place (`last` 1) or a direction (0)."""
    p = eye.projection
    return (
        p[0, 0] * vector[0] + p[0, 1] * vector[1] + p[0, 2] * vector[2] + p[0, 3] * last,
        p[1, 0] * vector[0] + p[1, 1] * vector[1] + p[1, 2] * vector[2] + p[1, 3] * last,
        p[2, 0] * vector[0] + p[2, 1] * vector[1] + p[2, 2] * vector[2] + p[2, 3] * last,
    )


@kernel
def _is_beside(center: float, a: float, b: float) -> bool:
    """Whether a linear function is negative on a whole disc.

    `center` is its value, `a` and `b` are its derivatives.
    """
    return center + REACH * math.hypot(a, b) < 0.0


@kernel
def _bound(center: Vector, a: Vector, b: Vector, axis: int) -> tuple[float, float]:
    """Middle and half extent, px, of a disc's outline; infinite behind the camera.

    From the dual conic ρ² (a aᵀ + b bᵀ) − center centerᵀ.
    """
    # A disc that crosses the camera's plane has no bounds.
    square = REACH * REACH
    last = square * (a[2] * a[2] + b[2] * b[2]) - center[2] * center[2]
    if last >= -1e-12 * center[2] * center[2]:
        return 0.0, np.inf
    # Solve the quadratic equation for the two tangents of the outline along the axis.
    mixed = square * (a[axis] * a[2] + b[axis] * b[2]) - center[axis] * center[2]
    own = square * (a[axis] * a[axis] + b[axis] * b[axis]) - center[axis] * center[axis]
    middle = mixed / last
    return middle, math.sqrt(max(0.0, middle * middle - own / last))


@kernel
def _set_exact(record: Record, center: Vector, a: Vector, b: Vector) -> None:
    """Set the forms of a splat: rows of the inverse of (a b center)."""
    # Invert by cross products, normalized to 1 at the center.
    u, v, w = cross(b, center), cross(center, a), cross(a, b)
    scale = center[2] / dot(w, center)
    record["ux"], record["uy"] = scale / REACH * u[0], scale / REACH * u[1]
    record["vx"], record["vy"] = scale / REACH * v[0], scale / REACH * v[1]
    record["slope_x"], record["slope_y"] = scale * w[0], scale * w[1]
    # Bound the outline exactly.
    record["weight"] = np.float32(1)
    middle, half = _bound(center, a, b, 0)
    record["left"], record["right"] = middle - half, middle + half
    middle, half = _bound(center, a, b, 1)
    record["top"], record["bottom"] = middle - half, middle + half


@kernel
def _set_clamped(
    record: Record,
    eye: CloudCamera,
    forms: tuple[Vector, Vector, Vector],
    spread: Vector,
    values: tuple[float, float],
) -> None:
    """Set the forms of a point with J Jᵀ = (xx, xy, yy), its singular values clamped.

    `forms`: its center and axes. Its plane is limited in steepness.
    """
    # Clamp both axes to a sub-pixel.
    xx, xy, yy = spread
    least = FINEST / (REACH * eye.subpixels)
    long, short = max(values[0], least), max(values[1], least)
    # Turn the forms to the axes' directions.
    angle = 0.5 * math.atan2(xy, 0.5 * (xx - yy))
    c, s = math.cos(angle), math.sin(angle)
    record["ux"], record["uy"] = c / (REACH * long), s / (REACH * long)
    record["vx"], record["vy"] = -s / (REACH * short), c / (REACH * short)
    # Dim enlarged discs, so that their total light stays.
    record["weight"] = values[0] * values[1] / (long * short)
    # Find the change of relative nearness per px: the plane's equation over its value there.
    center, w = forms[0], cross(forms[1], forms[2])
    volume, slope_x, slope_y = dot(w, center), 0.0, 0.0
    if volume != 0.0:
        x, y = center[2] / volume * w[0], center[2] / volume * w[1]
        scale = min(1.0, STEEPEST / (eye.focal * max(math.hypot(x, y), 1e-30)))
        slope_x, slope_y = scale * x, scale * y
    record["slope_x"], record["slope_y"] = slope_x, slope_y
    # Bound the ellipse.
    half = REACH * math.hypot(c * long, s * short)
    record["left"], record["right"] = record["x"] - half, record["x"] + half
    half = REACH * math.hypot(s * long, c * short)
    record["top"], record["bottom"] = record["y"] - half, record["y"] + half


@kernel
def _set_shape(record: Record, eye: CloudCamera, center: Vector, a: Vector, b: Vector) -> bool:
    """Set place and forms of a disc; return whether any of it is visible."""
    # Differentiate the projection at the center.
    x, y = center[0] / center[2], center[1] / center[2]
    jxu, jxv = (a[0] - x * a[2]) / center[2], (b[0] - x * b[2]) / center[2]
    jyu, jyv = (a[1] - y * a[2]) / center[2], (b[1] - y * b[2]) / center[2]
    xx, xy, yy = jxu * jxu + jxv * jxv, jxu * jyu + jxv * jyv, jyu * jyu + jyv * jyv
    area = abs(jxu * jyv - jxv * jyu)
    # Take the singular values of the Jacobian.
    long = math.sqrt(0.5 * (xx + yy) + math.hypot(0.5 * (xx - yy), xy))
    short = area / long if long > 0.0 else 0.0
    record["x"], record["y"] = x, y
    record["spacing"] = short
    # Project large discs exactly, and linearize small or oblique ones.
    if short * REACH * eye.subpixels > FINEST:
        _set_exact(record, center, a, b)
    else:
        _set_clamped(record, eye, (center, a, b), (xx, xy, yy), (long, short))
    # Cull degenerate discs, and those outside the frame.
    is_finite = math.isfinite(x + y + record["ux"] + record["uy"] + record["vx"] + record["vy"])
    return bool(
        is_finite
        and record["weight"] > 0
        and record["right"] >= 0
        and record["bottom"] >= 0
        and record["left"] <= eye.width
        and record["top"] <= eye.height
    )


@parallel_kernel
def project_discs(
    counter: Counter,
    position: Floats,
    axes: Floats,
    color: Floats,
    eye: CloudCamera,
    records: Records,
) -> None:
    """Project all discs.

    `position`, `axes`, `color`: (N, 3), (N, 2, 3) and (N, 3) of the discs. `records`: (N,) of
    `SURFEL`, filled; bounds with left > right mean that a disc is culled.
    """
    wide, high, size = float(eye.width), float(eye.height), eye.size
    for chunk in tasks(counter, (position.shape[0] + CHUNK - 1) // CHUNK):
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, position.shape[0])):
            # Cull discs in front of the near plane.
            record = records[n]
            record["left"], record["right"] = np.float32(1), np.float32(-1)
            place = (float(position[n, 0]), float(position[n, 1]), float(position[n, 2]))
            center = _project(eye, place, 1.0)
            if not center[2] > eye.near:
                continue

            # Scale and project both half axes.
            one = (size * axes[n, 0, 0], size * axes[n, 0, 1], size * axes[n, 0, 2])
            two = (size * axes[n, 1, 0], size * axes[n, 1, 1], size * axes[n, 1, 2])
            a, b = _project(eye, one, 0.0), _project(eye, two, 0.0)
            # Find the cosine between the normal and the direction to the camera; cull back faces.
            facing = 1.0
            if eye.cull or eye.headlight:
                normal = cross(one, two)
                toward = (eye.place[0] - place[0], eye.place[1] - place[1], eye.place[2] - place[2])
                square = dot(normal, normal) * dot(toward, toward)
                facing = dot(normal, toward) / math.sqrt(square) if square > 0.0 else 0.0
                if eye.cull and facing <= 0.0:
                    continue
            # Cull discs outside; the margin keeps points with sub-pixels in the frame.
            is_outside = (
                _is_beside(center[0], a[0], b[0])
                or _is_beside(center[1], a[1], b[1])
                or _is_beside(wide * center[2] - center[0], wide * a[2] - a[0], wide * b[2] - b[0])
                or _is_beside(high * center[2] - center[1], high * a[2] - a[1], high * b[2] - b[1])
            )
            if is_outside and not (
                -1.0 < center[0] / center[2] < eye.width + 1.0
                and -1.0 < center[1] / center[2] < eye.height + 1.0
            ):
                continue
            # Set place, forms and bounds.
            if not _set_shape(record, eye, center, a, b):
                record["left"], record["right"] = np.float32(1), np.float32(-1)
                continue
            # Set the depth within which discs are one surface, perpendicular to it.
            radius = math.sqrt(math.sqrt(dot(one, one) * dot(two, two)))
            record["nearness"] = 1.0 / center[2]
            steep = min(STEEPEST, eye.focal * math.hypot(record["slope_x"], record["slope_y"]))
            apart = eye.tolerance * radius / center[2] + 1.0 / (eye.focal * eye.subpixels)
            record["keep"] = 1.0 - min(LOOSEST, apart * math.sqrt(1.0 + steep * steep))

            # Shade by the headlight.
            light = abs(facing) if eye.headlight else 1.0
            record["red"] = light * color[n, 0]
            record["green"], record["blue"] = light * color[n, 1], light * color[n, 2]


Flags = NDArray[np.bool_]
Lattice = tuple[int, int, int]


@kernel
def _meets(record: Record, lattice: Lattice, first: int, last: int) -> bool:
    """Whether a disc touches one of some consecutive tiles."""
    if record["left"] > record["right"]:
        return False
    # Find the tiles that the bounds meet, and intersect them row by row with the span.
    rows, columns, size = lattice
    left, right = overlapping_tiles(record["left"], record["right"], 0.0, size, columns)
    top, bottom = overlapping_tiles(record["top"], record["bottom"], 0.0, size, rows)
    for row in range(max(top, first // columns), min(bottom, (last - 1) // columns) + 1):
        if max(left, first - row * columns) <= min(right, last - 1 - row * columns):
            return True
    return False


@parallel_kernel
def find_overlapping(
    counter: Counter, records: Records, lattice: Lattice, span: tuple[int, int], flags: Flags
) -> None:
    """Find the discs that touch a tile of a span: its first, and one past its last.

    `records`: (N,) of `SURFEL`. `lattice`: rows and columns of all tiles, and their size, px.
    `span`: two numbers of tiles. `flags`: (N,) filled.
    """
    for chunk in tasks(counter, (flags.size + CHUNK - 1) // CHUNK):
        start = int(np.int64(chunk)) * CHUNK
        for n in range(start, min(start + CHUNK, flags.size)):
            flags[n] = _meets(records[n], lattice, span[0], span[1])


CORE: Single = np.float32(1.0 / (REACH * REACH))  # i² within which a splat is opaque
FEW = 4.0  # sub-pixels; shorter rows are not narrowed down
AMPLE = 1.5  # factor of the coverage of points, so that irregular surfaces of them are closed, too
EVEN = 1.0  # px; discs at least as large need not be sampled at every sub-pixel
LAYERS = 8  # surfaces one behind the other, at most
RED, GREEN, BLUE = range(3)  # lanes of a surface, in addition to the engine's


class Discs(NamedTuple):
    """Discs on the screen."""

    records: Records  # (N,) of `SURFEL`
    shows: NDArray[np.uint8]  # (N,) set to 1 for each disc that some sub-pixel shows


class Disc(NamedTuple):
    """One record, loaded into registers."""

    x: Single
    y: Single
    ux: Single
    uy: Single
    vx: Single
    vy: Single
    slope_x: Single
    slope_y: Single
    nearness: Single
    keep: Single
    weight: Single
    left: Single
    top: Single
    right: Single
    bottom: Single
    is_splat: bool


class CloudPicture(NamedTuple):
    """Pictures that tiles are written to."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)


@kernel
def _disc(record: Record) -> Disc:
    """Load a record into registers."""
    return Disc(
        record["x"],
        record["y"],
        record["ux"],
        record["uy"],
        record["vx"],
        record["vy"],
        record["slope_x"],
        record["slope_y"],
        record["nearness"],
        record["keep"],
        record["weight"],
        record["left"],
        record["top"],
        record["right"],
        record["bottom"],
        record["weight"] >= 1,
    )


@kernel
def _rows(disc: Disc, block: Block) -> tuple[int, int]:
    """First and last row of sub-pixels that a disc may touch."""
    fine = float(block.subpixels)
    first, last = block.box[0], block.box[1]
    return (
        whole_within((disc.top - block.top) * fine + 0.5, first, last + 1),
        whole_within((disc.bottom - block.top) * fine - 0.5, first - 1, last),
    )


@kernel
def _columns(disc: Disc, block: Block, row: int, core: Single) -> tuple[int, int]:
    """First and last column of a row with i² up to `core`, rounded outward."""
    # Write the index along the row as a quadratic form.
    fine = float(block.subpixels)
    dy = block.top + (row + 0.5) / fine - disc.y
    share = 1.0 if disc.is_splat else 0.0
    p, q = share * disc.slope_x, share * disc.slope_y
    ux, uy, vx, vy = float(disc.ux), float(disc.uy), float(disc.vx), float(disc.vy)
    rest = 1.0 + q * dy
    square = ux * ux + vx * vx - core * p * p
    left, right = float(disc.left), float(disc.right)
    # Narrow wide rows down to the zeros of the quadratic; none: the row misses the disc.
    if square > 0.0 and (right - left) * fine > FEW:
        mixed = (ux * uy + vx * vy) * dy - core * p * rest
        under = mixed * mixed - square * ((uy * uy + vy * vy) * dy * dy - core * rest * rest)
        if under < 0.0:
            return 0, -1
        root = math.sqrt(under)
        left = max(left, disc.x + (-mixed - root) / square)
        right = min(right, disc.x + (-mixed + root) / square)

    # Convert to columns; rows of sub-pixels are shifted against each other.
    before = row_shift(row, block.subpixels) + 0.5
    first, last = block.box[2], block.box[3]
    return (
        whole_within((left - block.left) * fine - before + 0.99, first, last + 1),
        whole_within((right - block.left) * fine - before + 0.01, first - 1, last),
    )


@kernel
def _in_row(disc: Disc, block: Block, row: int) -> tuple[Single, tuple[Single, Single, Single]]:
    """Offset from a disc to a row's first sub-pixel, px, and u, v, d on the row."""
    dy = np.float32(block.top + (row + 0.5) / block.subpixels - disc.y)
    start = np.float32(
        block.left + (row_shift(row, block.subpixels) + 0.5) / block.subpixels - disc.x
    )
    return start, (disc.uy * dy, disc.vy * dy, np.float32(1) + disc.slope_y * dy)


@plays(claim, Discs)
def _claim(discs: Discs, member: int, block: Block) -> None:
    """Raise the depth floor where a disc is in front."""
    # Load the disc: splats are opaque in their core, points everywhere.
    disc = _disc(discs.records[member])
    is_splat = disc.is_splat
    core = CORE if is_splat else np.float32(1)
    fine = np.float32(1) / np.float32(block.subpixels)
    nearness, keep = disc.nearness, disc.keep
    ux, vx, p = disc.ux, disc.vx, disc.slope_x
    floor, limit = block.floor, block.limit
    one = np.float32(1)
    # Visit the sub-pixels that the disc may cover.
    first_row, last_row = _rows(disc, block)
    for row in range(first_row, last_row + 1):
        first, last = _columns(disc, block, row, core)
        start, (u0, v0, d0) = _in_row(disc, block, row)
        for column in range(first, last + 1):
            # Evaluate the disc's linear forms; perspective divides splats'.
            dx = start + np.float32(column) * fine
            u, v, d = ux * dx + u0, vx * dx + v0, p * dx + d0
            e = d if is_splat else one
            # Raise the floor to the disc's depth, less what one surface may differ by.
            near = nearness * d
            is_in = u * u + v * v <= core * e * e and d > 0 and near < limit[row, column]
            least = near * keep if is_in else np.float32(0)
            floor[row, column] = max(floor[row, column], least)


@plays(add, Discs)
def _add(discs: Discs, member: int, block: Block) -> None:
    """Add a disc's color to the front surface where it is part of it."""
    record = discs.records[member]
    disc = _disc(record)
    is_splat = disc.is_splat
    fine = np.float32(1) / np.float32(block.subpixels)
    nearness, whole = disc.nearness, disc.weight
    # The disc may be as much nearer than the front as the floor is farther.
    beyond = disc.keep * disc.keep
    ux, vx, p = disc.ux, disc.vx, disc.slope_x
    red, green, blue = record["red"], record["green"], record["blue"]
    floor, limit, sums = block.floor, block.limit, block.sums
    zero, one, ample = np.float32(0), np.float32(1), np.float32(AMPLE)
    shows, step = False, block.step[0]

    # Visit the sub-pixels that the disc may cover.
    first_row, last_row = _rows(disc, block)
    for row in range(first_row, last_row + 1):
        first, last = _columns(disc, block, row, one)
        start, (u0, v0, d0) = _in_row(disc, block, row)
        for column in range(first_used(block, row, first), last + 1, step):
            # Evaluate the disc's linear forms.
            dx = start + np.float32(column) * fine
            u, v, d = ux * dx + u0, vx * dx + v0, p * dx + d0
            e = d if is_splat else one
            near = nearness * d
            index = u * u + v * v
            # Depth test against the floor, and against surfaces peeled before.
            bound = floor[row, column]
            if index < e * e and near * beyond <= bound <= near < limit[row, column] and d > zero:
                # Weigh the color by the distance from the center.
                index /= e * e
                weight = whole * (one - index) * (one - index)
                sums[row, column, RED] += weight * red
                sums[row, column, GREEN] += weight * green
                sums[row, column, BLUE] += weight * blue
                sums[row, column, WEIGHT] += weight
                sums[row, column, NEAR] += weight * near
                # Add coverage: points by their weight, splats only in their core.
                if not is_splat:
                    sums[row, column, COVER] += ample * weight
                elif index <= CORE:
                    sums[row, column, COVER] += one
                shows = True
    if shows:
        discs.shows[member] = 1


@plays(write, CloudPicture)
def _write(picture: CloudPicture, block: Block) -> None:
    """Average each pixel's sub-pixels, and write color and depths."""
    seen, fine = block.visible, block.subpixels
    rgba = picture.rgba
    rows, columns = block.floor.shape
    scale = block.step[0] / (fine * fine)
    for i in range(rows // fine):
        for j in range(columns // fine):
            # Sum the sub-pixels that were used.
            red, green, blue, cover, depth, first = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for row in range(i * fine, (i + 1) * fine):
                start = first_used(block, row, j * fine)
                for column in range(start, (j + 1) * fine, block.step[0]):
                    red += seen[row, column, 0]
                    green += seen[row, column, 1]
                    blue += seen[row, column, 2]
                    cover += seen[row, column, 3]
                    depth += seen[row, column, 4]
                    first = max(first, seen[row, column, 5])
            # Write premultiplied color and coverage, mean depth, and the first surface's depth.
            y, x = block.top + i, block.left + j
            rgba[y, x, 0], rgba[y, x, 1] = scale * red, scale * green
            rgba[y, x, 2], rgba[y, x, 3] = scale * blue, min(1.0, scale * cover)
            picture.depth[y, x] = depth / cover if cover > 0.0 else np.inf
            picture.first_depth[y, x] = 1.0 / first if first > 0.0 else np.inf


@plays(claimed, Discs)
def _claimed(discs: Discs, tiles: Tiles, tile: int, block: Block) -> None:
    """Use only some of a tile's sub-pixels where one surface of splats fills it."""
    block.step[0] = block.subpixels if _is_even(discs.records, tiles, tile, block) else 1


@kernel
def _is_even(records: Records, tiles: Tiles, tile: int, block: Block) -> bool:
    """Whether one surface fills a tile, so that some of its sub-pixels are enough."""
    fine, floor = block.subpixels, block.floor
    if fine % 2 == 1 or tiles.spacing[tile] < EVEN:
        return False
    # Find how much the depth of one surface may vary.
    keep = np.float32(0)
    for member in range(tiles.start[tile], tiles.start[tile + 1]):
        keep = max(keep, records[tiles.member[member]]["keep"])
    # Test each pixel: no hole, and no jump of depth.
    rows, columns = floor.shape
    for top in range(0, rows, fine):
        for left in range(0, columns, fine):
            low, high = floor[top, left], floor[top, left]
            for row in range(top, top + fine):
                for column in range(left, left + fine):
                    low, high = min(low, floor[row, column]), max(high, floor[row, column])
            if low <= 0 or high * keep > low:
                return False
    return True


@parallel_kernel
def paint(
    counter: Counter, discs: Discs, tiles: Tiles, subpixels: int, picture: CloudPicture
) -> None:
    """Paint every tile.

    `tiles`: which discs touch which tile, in their order. `subpixels`: per side of a pixel.
    `picture`: filled; transparent before, with infinite depths.
    """
    height, width = picture.depth.shape
    surfaces = Surfaces(LAYERS, subpixels)
    for tile in tasks(counter, tiles.start.size - 1):
        paint_tile(discs, tiles, tile, (height, width), surfaces, picture)
