"""The loop over pixels that gather from a grid: their footprints as boxes, and the means of these.

A pixel covers about a parallelogram of the grid. A box with the same second moments has the same
mean of what varies slowly, up to fourth order; a pixel in which the grid varies too much for that
is split into parts. A parallelogram along the grid's axes is such a box itself.

Where a pixel lies is up to the application, which plays the role `footprint_at`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, tasks
from resample.engine.roles import role
from resample.engine.windows.boxes import (
    GridBox,
    Integral,
    Plate,
    PointTaps,
    add_mean,
    scratch_size,
)
from resample.engine.windows.edges import TRANSPARENT, folded
from resample.engine.windows.limits import (
    Corners,
    Limits,
    Part,
    corner_scratch,
    fill_corners,
    keep_within,
    keep_within_mean,
    marks_at,
    part_around,
    part_of,
    tolerances,
)
from resample.engine.windows.polygons import MOST_CORNERS, area, cut_to
from resample.engine.windows.straight import ALONG_Y, both, towards
from resample.types import Doubles, Floats, Single

Integers = NDArray[np.int64]
PixelGeometry = Any  # a bundle of the application's, whose class selects where pixels lie

LEAN = 0.1  # samples², 12 times a part's mixed moment, from which on two boxes stand for it
LEANEST = 0.5  # samples², mixed moment of one side of a part, at most
MOST_PARTS = 64.0  # of a pixel along an axis
AT_EDGES = 4  # parts of a pixel along an axis where an edge of the grid crosses it, at least
FARTHEST = 2.0**40  # samples from the grid's origin beyond which there is nothing
LIMITED = 2.0  # samples along u and v up to which the limits at one position hold for a pixel
LONGEST_LIMITED = 24.0  # samples along one axis, `LIMITED` along the other: limits are averaged
NEARLY = 1e-6  # samples, or share of a pixel, that count as nothing
OWN = 1.001  # samples², a sample's own extent along an axis, and what maps in float32 round


class PixelFootprint(NamedTuple):
    """The footprint of a pixel: a parallelogram in source coordinates."""

    u: float  # its center; NaN: nothing
    v: float
    along_x: tuple[float, float]  # step (u, v) of a pixel to the right
    along_y: tuple[float, float]  # and down


class GridView(NamedTuple):
    """A grid, and how pixels gather from it."""

    plate: Plate
    integral: Integral
    points: PointTaps  # its weights at points; none: pixels are averaged over all that they cover
    size: tuple[int, int]  # (height, width) of the source; the grid is a part of it, with margins
    edge: int
    margin: float  # samples around the source into which positions are folded; inf: they are not
    finest: float  # samples², tolerance of splitting pixels; see `parts_of`
    limits: Limits


class PixelScratch(NamedTuple):
    """Scratch for one pixel."""

    weights: Floats  # see `boxes.scratch_size`
    total: Floats  # (C,)
    polygon: Doubles  # (MOST_CORNERS, 2)
    spare: Doubles
    corners: Corners
    straight: Floats  # (2 × C,) see `_straighten`
    changes: Floats  # (2 × C,)


@role
def footprint_at(geometry: PixelGeometry, row: int, column: int) -> PixelFootprint:
    """The footprint of a pixel."""
    raise NotImplementedError


@inner_step
def is_box(footprint: PixelFootprint, finest: float) -> bool:
    """Whether one or two boxes approximate a pixel well enough; see `parts_of`."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    leans = max(abs(ux * vx), abs(uy * vy)) <= LEANEST * finest
    return bool(leans and max(abs(ux * uy), abs(vx * vy)) <= finest)


@inner_kernel
def parts_of(footprint: PixelFootprint, finest: float) -> tuple[int, int]:
    """Parts of a pixel along x and y that boxes approximate up to a fourth moment.

    Along u, that moment of a parallelogram differs from a box's by (a b)² / 60, with a and b the
    extents of its sides, which falls with the square of the number of parts. Slanted parts become
    two boxes, which stand for about a sample along a diagonal at most.
    """
    # Split sides that slant too much.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    parts, leanest = max(abs(ux * uy), abs(vx * vy)) / finest, LEANEST * finest
    count_x = max(1.0, math.ceil(math.sqrt(abs(ux * vx) / leanest)))
    count_y = max(1.0, math.ceil(math.sqrt(abs(uy * vy) / leanest)))
    # If that is not enough, split further, the longer side first.
    if parts > count_x * count_y:
        longer = math.hypot(uy, vy) / max(math.hypot(ux, vx), 1e-30)
        count_x = max(count_x, math.ceil(min(math.sqrt(parts / longer), MOST_PARTS)))
        count_y = max(count_y, math.ceil(min(parts / count_x, MOST_PARTS)))
    return int(min(count_x, MOST_PARTS)), int(min(count_y, MOST_PARTS))


@inner_step
def _add_part(
    view: GridView, footprint: PixelFootprint, share: Single, scratch: PixelScratch
) -> None:
    """Add a parallelogram as a box, or as two boxes that are apart along its slant."""
    # Second moments, times 12, and the center on the plate.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    uu, vv, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    u, v = footprint.u - view.plate.left, footprint.v - view.plate.top
    boxes = 1
    apart_u = apart_v = 0.0
    # Two boxes carry the mixed moment by their distance; the rest stays in their sides.
    if abs(uv) > LEAN * view.finest:
        boxes, share, ratio = 2, np.float32(0.5) * share, math.sqrt(uu / vv)
        apart_u = math.sqrt(abs(uv) * ratio / 12.0)
        apart_v = math.copysign(math.sqrt(abs(uv) / ratio / 12.0), uv)
        uu, vv = max(uu - abs(uv) * ratio, 0.0), max(vv - abs(uv) / ratio, 0.0)
    # Add the mean over each box.
    wide, high = math.sqrt(uu), math.sqrt(vv)
    for _ in range(boxes):
        box = GridBox(u + apart_u, v + apart_v, wide, high)
        add_mean(view.plate, view.integral, view.points, box, share, scratch.weights, scratch.total)
        apart_u, apart_v = -apart_u, -apart_v


@inner_kernel
def _part(footprint: PixelFootprint, counts: tuple[int, int], n: int) -> PixelFootprint:
    """The nth part of a pixel."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    x = (n % counts[0] + 0.5) / counts[0] - 0.5
    y = (n // counts[0] + 0.5) / counts[1] - 0.5
    return PixelFootprint(
        footprint.u + x * ux + y * uy,
        footprint.v + x * vx + y * vy,
        (ux / counts[0], vx / counts[0]),
        (uy / counts[1], vy / counts[1]),
    )


@inner_kernel
def _add_parts(view: GridView, footprint: PixelFootprint, scratch: PixelScratch) -> None:
    """Add all parts of a pixel, with equal weights."""
    counts = parts_of(footprint, view.finest)
    each = np.float32(1.0 / (counts[0] * counts[1]))
    for n in range(counts[0] * counts[1]):
        _add_part(view, _part(footprint, counts, n), each, scratch)


@inner_kernel
def _shrunk(footprint: PixelFootprint, own: float) -> PixelFootprint:
    """By how much a footprint is larger than a sample: their second moments' difference.

    A sample is already a mean over its own extent, which interpolation may widen, so only what a
    pixel covers beyond that is to be averaged: nothing where samples keep their size or grow.
    """
    # Second moments, times 12, and their eigenvalues.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    uu, vv, uv = ux * ux + uy * uy, vx * vx + vy * vy, ux * vx + uy * vy
    # Both are below a sample's own if its moments less these are those of an ellipse.
    if uu <= own and vv <= own and uv * uv <= (own - uu) * (own - vv):
        return PixelFootprint(footprint.u, footprint.v, (0.0, 0.0), (0.0, 0.0))
    middle, half = 0.5 * (uu + vv), 0.5 * (uu - vv)
    apart = math.sqrt(half * half + uv * uv)
    # Subtract the sample's own along both eigenvectors.
    longer = math.sqrt(max(middle + apart - own, 0.0))
    shorter = math.sqrt(max(middle - apart - own, 0.0))
    # Halve the angle 2 a of their axes: cos 2a = (uu − vv) / 2 apart.
    double = 0.5 * (uu - vv) / apart if apart > NEARLY else 1.0
    x = math.sqrt(max(0.5 + 0.5 * double, 0.0))
    y = math.copysign(math.sqrt(max(0.5 - 0.5 * double, 0.0)), uv)
    along_x, along_y = (longer * x, longer * y), (-shorter * y, shorter * x)
    return PixelFootprint(footprint.u, footprint.v, along_x, along_y)


@inner_step
def _averaged(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """What a pixel is averaged over: its footprint, or what of it is larger than a sample."""
    return footprint if view.points.taps == 0 else _shrunk(footprint, view.points.own)


@inner_step
def _place(view: GridView, footprint: PixelFootprint) -> PixelFootprint:
    """Fold a pixel to the equivalent footprint within the grid."""
    if view.margin == math.inf:
        return footprint
    u, turn_u = folded(footprint.u, float(view.size[1]), view.edge, view.margin)
    v, turn_v = folded(footprint.v, float(view.size[0]), view.edge, view.margin)
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return PixelFootprint(u, v, (turn_u * ux, turn_v * vx), (turn_u * uy, turn_v * vy))


@inner_step
def _is_within(view: GridView, footprint: PixelFootprint) -> bool:
    """Whether no transparent edge of the source crosses a pixel."""
    if view.edge != TRANSPARENT:
        return True
    # Compare the bounding box of the footprint with the source.
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    reach_u, reach_v = 0.5 * (abs(ux) + abs(uy)) - NEARLY, 0.5 * (abs(vx) + abs(vy)) - NEARLY
    across = footprint.u >= reach_u and footprint.u + reach_u <= view.size[1]
    return bool(across and footprint.v >= reach_v and footprint.v + reach_v <= view.size[0])


@inner_kernel
def _share_within(view: GridView, footprint: PixelFootprint, scratch: PixelScratch) -> float:
    """Share of a pixel's footprint that lies on the source."""
    # Cull by the bounding box.
    height, width = float(view.size[0]), float(view.size[1])
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    reach_u, reach_v = 0.5 * (abs(ux) + abs(uy)), 0.5 * (abs(vx) + abs(vy))
    is_outside = footprint.u + reach_u <= 0.0 or footprint.u - reach_u >= width
    if is_outside or footprint.v + reach_v <= 0.0 or footprint.v - reach_v >= height:
        return 0.0
    # Corners of the parallelogram, in order.
    polygon = scratch.polygon
    for k in range(4):
        x, y = -0.5 if k in (1, 2) else 0.5, -0.5 if k > 1 else 0.5
        polygon[k, 0], polygon[k, 1] = footprint.u + x * ux + y * uy, footprint.v + x * vx + y * vy
    # A degenerate footprint counts by its center.
    whole = area(polygon, 4)
    if whole <= 0.0:
        return 1.0 if 0.0 <= footprint.u <= width and 0.0 <= footprint.v <= height else 0.0
    # Clip to the source, and compare areas.
    count = cut_to(polygon, scratch.spare, 4, (0.0, 0.0, width, height))
    share = area(polygon, count) / whole
    return 0.0 if share < NEARLY else 1.0 if share > 1.0 - NEARLY else share


@inner_kernel
def _mean_within(view: GridView, footprint: PixelFootprint, scratch: PixelScratch) -> float:
    """Mean over the part of a footprint on the source, where an edge crosses it; and its share."""
    share = _share_within(view, footprint, scratch)
    if share <= 0.0:
        return 0.0
    height, width = float(view.size[0]), float(view.size[1])
    # Split finely, and add the parts whose centers lie on the source.
    footprint = _averaged(view, footprint)
    counts, inside = parts_of(footprint, view.finest), 0
    counts = max(counts[0], AT_EDGES), max(counts[1], AT_EDGES)
    for n in range(counts[0] * counts[1]):
        part = _part(footprint, counts, n)
        if 0.0 <= part.u <= width and 0.0 <= part.v <= height:
            _add_part(view, part, np.float32(1), scratch)
            inside += 1
    # If none does, take one part at the nearest position of the source.
    if inside == 0:
        part = _part(footprint, counts, 0)
        u, v = min(max(footprint.u, 0.0), width), min(max(footprint.v, 0.0), height)
        _add_part(view, PixelFootprint(u, v, part.along_x, part.along_y), np.float32(1), scratch)
    # Normalize by their number.
    each = np.float32(1.0 / max(inside, 1))
    for c in range(scratch.total.size):
        scratch.total[c] *= each
    return share


@inner_step
def _mean_of(view: GridView, footprint: PixelFootprint, scratch: PixelScratch) -> float:
    """Mean over a pixel's footprint; return its coverage."""
    for c in range(scratch.total.size):
        scratch.total[c] = np.float32(0)
    # Footprints that are NaN or very far away are empty.
    if not (abs(footprint.u) <= FARTHEST and abs(footprint.v) <= FARTHEST):
        return 0.0
    # At a transparent edge, only a share of the footprint counts.
    if not _is_within(view, footprint):
        return _mean_within(view, footprint, scratch)
    # Elsewhere, fold the footprint into the grid, and add it whole or in parts.
    placed = _averaged(view, _place(view, footprint))
    if placed.along_x[0] == placed.along_x[1] == placed.along_y[0] == placed.along_y[1] == 0.0:
        box = GridBox(placed.u - view.plate.left, placed.v - view.plate.top, 0.0, 0.0)
        one, total = np.float32(1), scratch.total
        add_mean(view.plate, view.integral, view.points, box, one, scratch.weights, total)
    elif is_box(placed, view.finest):
        _add_part(view, placed, np.float32(1), scratch)
    else:
        _add_parts(view, placed, scratch)
    return 1.0


@inner_step
def _is_small(footprint: PixelFootprint) -> bool:
    """Whether the samples around a pixel's center suffice for its limits."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    return bool(max(abs(ux) + abs(uy), abs(vx) + abs(vy)) <= LIMITED)


@inner_step
def _longer_side(footprint: PixelFootprint) -> tuple[float, float]:
    """Side of a long, thin footprint along which limits are averaged; (0, 0) for all others."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    is_along_x = ux * ux + vx * vx > uy * uy + vy * vy
    longer, other = (
        (footprint.along_x, footprint.along_y)
        if is_along_x
        else (footprint.along_y, footprint.along_x)
    )
    extent = max(abs(longer[0]), abs(longer[1]))
    is_thin = max(abs(other[0]), abs(other[1])) <= LIMITED
    return longer if is_thin and extent <= LONGEST_LIMITED else (0.0, 0.0)


@inner_kernel
def _part_around(
    view: GridView, footprint: PixelFootprint, scratch: PixelScratch
) -> tuple[Part, float, float, bool]:
    """Compute the limits around one pixel, its position in them, and whether edges are there."""
    placed, plain = _place(view, footprint), view.limits.plain
    u, v = placed.u - plain.left, placed.v - plain.top
    part = part_around(view.limits, u, v)
    has_edges = fill_corners(view.limits, part, scratch.corners)
    return part, u, v, has_edges


@inner_kernel
def _straighten(
    view: GridView,
    footprint: PixelFootprint,
    part: Part,
    at: tuple[float, float],
    marks: int,
    scratch: PixelScratch,
) -> None:
    """Keep a pixel beside straight edges near the means across them alone.

    Along an edge the samples themselves are interpolated: the grid's means over each of them.
    """
    # The box of the pixel's mean, on the plate, and the samples before its center.
    placed, own = _averaged(view, _place(view, footprint)), view.limits.own
    (ux, vx), (uy, vy) = placed.along_x, placed.along_y
    u, v = placed.u - view.plate.left, placed.v - view.plate.top
    wide, high = math.hypot(ux, uy), math.hypot(vx, vy)
    column, row = math.floor(u - 0.5) + 0.5, math.floor(v - 0.5) + 0.5
    channels, total = scratch.total.size, scratch.total
    straight, tolerance = scratch.straight[:channels], scratch.straight[channels:]
    for axis in range(2):
        changes = scratch.changes[axis * channels : (axis + 1) * channels]
        for c in range(channels):
            straight[c] = changes[c] = np.float32(0)
        has_marks = marks & (((1 << ALONG_Y) - 1) << (axis * ALONG_Y))
        if not has_marks or not tolerances(
            view.limits, scratch.corners, part, at, axis == 0, tolerance
        ):
            continue
        # Interpolate between the two samples beside the pixel along the edge.
        for n in range(2):
            if axis == 0:
                box, share = GridBox(column + n, v, own, high), 1.0 - abs(u - column - n)
            else:
                box, share = GridBox(u, row + n, wide, own), 1.0 - abs(v - row - n)
            add_mean(
                view.plate, view.integral, view.points, box, np.float32(share), scratch.weights,
                straight,
            )  # fmt: skip
        for c in range(channels):
            changes[c] = towards(total[c], straight[c], tolerance[c])
    for c in range(channels):
        total[c] += both(scratch.changes[c], scratch.changes[channels + c])


@inner_kernel
def _keep_positive(view: GridView, footprint: PixelFootprint, total: Floats) -> None:
    """Keep a mean of samples at or above zero where none of them is below.

    For pixels too large for limits: what is left of ringing is small beside what rings, but not
    beside black.
    """
    flat, left, top, rows, columns, channels, there, before = view.limits.plain
    for c in range(channels):
        if not total[c] < np.float32(0):
            continue
        # Bound what the pixel covers.
        placed, least = _place(view, footprint), np.float32(0)
        (ux, vx), (uy, vy) = placed.along_x, placed.along_y
        reach_u, reach_v = 0.5 * (abs(ux) + abs(uy)) + 1.0, 0.5 * (abs(vx) + abs(vy)) + 1.0
        first, last = max(int(placed.u - left - reach_u), 0), int(placed.u - left + reach_u)
        last, row = min(last, columns - 1), max(int(placed.v - top - reach_v), 0)
        # Any sample that is not above the mean will do.
        while row <= min(int(placed.v - top + reach_v), rows - 1) and least > total[c]:
            for column in range(first, last + 1):
                least = min(least, flat[(row * there + column) * channels + c - before])
            row += 1
        total[c] = max(total[c], least)


@inner_kernel
def _fill_tile(
    geometry: PixelGeometry,
    view: GridView,
    tile: Integers,
    bounds: Doubles,
    image: Floats,
    covered: Floats,
    scratch: PixelScratch,
) -> None:
    """Fill one tile of the target."""
    # Compute limits for the whole tile, if they fit; else pixel by pixel.
    part, is_filled, has_edges = part_of(view.limits, bounds), False, False
    has_limits = view.limits.excess >= 0.0
    is_apart = part.wide == 0 or view.margin < math.inf
    left, top = view.limits.plain.left, view.limits.plain.top
    for row in range(tile[TOP], tile[BOTTOM]):
        for column in range(tile[LEFT], tile[RIGHT]):
            # Gather the mean over the footprint.
            footprint = footprint_at(geometry, row, column)
            coverage = np.float32(_mean_of(view, footprint, scratch))
            # Clamp small footprints to the limits at their center.
            if coverage > 0.0 and has_limits and _is_small(footprint):
                u, v = footprint.u - left, footprint.v - top
                if is_apart:
                    part, u, v, has_edges = _part_around(view, footprint, scratch)
                elif not is_filled:
                    has_edges = fill_corners(view.limits, part, scratch.corners)
                    is_filled = True
                marks = marks_at(scratch.corners, part, u, v) if has_edges else 0
                if marks:
                    _straighten(view, footprint, part, (u, v), marks, scratch)
                keep_within(scratch.corners, part, u, v, scratch.total)
            elif coverage > 0.0 and has_limits and not is_apart:
                # Clamp long, thin ones to the mean of the limits along them.
                side = _longer_side(footprint)
                if side[0] != 0.0 or side[1] != 0.0:
                    # Limits of the tile are computed when first needed.
                    if not is_filled:
                        has_edges = fill_corners(view.limits, part, scratch.corners)
                        is_filled = True
                    at = footprint.u - left, footprint.v - top
                    keep_within_mean(scratch.corners, part, at, side, scratch.total)
            if coverage > 0.0 and has_limits and not _is_small(footprint):
                _keep_positive(view, footprint, scratch.total)
            # Store, premultiplied by coverage.
            covered[row, column] = coverage
            for c in range(image.shape[2]):
                image[row, column, c] = coverage * scratch.total[c]


@kernel
def gather_tiles(
    counter: Counter,
    geometry: PixelGeometry,
    view: GridView,
    tiles: Integers,
    bounds: Doubles,
    image: Floats,
    covered: Floats,
) -> None:
    """Fill tiles (T, 4) of an image; for an application's packed kernel.

    Parameters
    ----------
    bounds
        (T, 4) bounds of what tiles cover, see `Extent`.
    image
        (height, width, C), filled, premultiplied by coverage.
    covered
        (height, width) coverage, filled.
    """
    # Allocate the scratch of this thread.
    channels = image.shape[2]
    polygon, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    weights, total = np.empty(scratch_size(channels), np.float32), np.empty(channels, np.float32)
    straight, changes = np.zeros(2 * channels, np.float32), np.zeros(2 * channels, np.float32)
    scratch = PixelScratch(
        weights, total, polygon, spare, corner_scratch(channels), straight, changes
    )
    for n in tasks(counter, tiles.shape[0]):
        _fill_tile(geometry, view, tiles[n], bounds[n], image, covered, scratch)


class Extent(NamedTuple):
    """What tiles cover in the source, and what that costs."""

    bounds: Doubles  # (T, 4) left, top, right and bottom in source coordinates; left > right: none
    # (T,) boxes of the costliest pixel, weighted by the samples that each gathers; less a quarter
    # for each sample that the pixel covers, as the alternative is to project all of these.
    work: Doubles
    span: Doubles  # (T,) samples that a pixel covers along u or v, at most


@inner_step
def _widen(footprint: PixelFootprint, bounds: Doubles) -> float:
    """Extend a tile's bounds by a pixel; return its longer extent along u or v."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    reach_u, reach_v = 0.5 * (abs(ux) + abs(uy)), 0.5 * (abs(vx) + abs(vy))
    bounds[LEFT] = min(bounds[LEFT], footprint.u - reach_u)
    bounds[RIGHT] = max(bounds[RIGHT], footprint.u + reach_u)
    bounds[TOP] = min(bounds[TOP], footprint.v - reach_v)
    bounds[BOTTOM] = max(bounds[BOTTOM], footprint.v + reach_v)
    return 2.0 * max(reach_u, reach_v)


@inner_kernel
def _work_on(footprint: PixelFootprint, view: GridView) -> float:
    """Cost of a pixel, see `Extent`."""
    (ux, vx), (uy, vy) = footprint.along_x, footprint.along_y
    # Whatever the quality asked for, so that more of it never gives less.
    parts_x, parts_y = parts_of(footprint, 1.0)
    # Samples that each box gathers, against samples that would be projected.
    wide, high = math.hypot(ux, uy), math.hypot(vx, vy)
    taps = view.integral.taps
    samples = (taps + wide / parts_x) * (taps + high / parts_y)
    covered = abs(ux * vy - uy * vx)
    return parts_x * parts_y * (1.0 + samples / 256.0) - 0.25 * covered


@kernel
def measure_tiles(
    counter: Counter,
    geometry: PixelGeometry,
    tiles: Integers,
    step: int,
    view: GridView,
    extent: Extent,
) -> None:
    """Measure what tiles cover, by pixels `step` apart; for an application's parallel kernel.

    A tile with pixels that have no position counts as endless work, unless all its pixels are
    measured (`step` 1): then work is not computed.
    """
    for n in tasks(counter, tiles.shape[0]):
        # Start with empty bounds.
        extent.bounds[n, :2], extent.bounds[n, 2:] = math.inf, -math.inf
        work, span, count, missing = 0.0, 0.0, 0, 0
        # Visit every `step`th pixel, the last row and column included.
        for row in range(tiles[n, TOP], tiles[n, BOTTOM] + step - 1, step):
            for column in range(tiles[n, LEFT], tiles[n, RIGHT] + step - 1, step):
                at = min(row, tiles[n, BOTTOM] - 1), min(column, tiles[n, RIGHT] - 1)
                footprint = footprint_at(geometry, at[0], at[1])
                # Skip pixels without a position.
                if not (abs(footprint.u) <= FARTHEST and abs(footprint.v) <= FARTHEST):
                    missing += 1
                    continue
                # Widen the bounds, and keep the costliest pixel.
                span = max(span, _widen(footprint, extent.bounds[n]))
                work = max(work, _work_on(footprint, view)) if step > 1 else 0.0
                count += 1
        extent.span[n] = span
        extent.work[n] = math.inf if step > 1 and missing > 0 and count > 0 else work
