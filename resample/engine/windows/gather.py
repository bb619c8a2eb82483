"""The loop over pixels that gather from a grid: the means over their footprints, within limits.

Most pixels keep about their size, or grow: a single box stands for them, and its window is few
samples wide. What these need is computed a row at a time (`rows`). All others, such as those that
an edge of the grid crosses, are averaged one by one, in as many boxes as they need.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.cells.bands import BOTTOM, LEFT, RIGHT, TOP
from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, tasks
from resample.engine.windows.boxes import (
    TRANSPARENT,
    GridBox,
    Place,
    add_mean,
    put_mean_of_few,
    scratch_size,
)
from resample.engine.windows.footprints import (
    DOWN,
    LEAN,
    LIMITED,
    MOST_CORNERS,
    NEARLY,
    OTHER,
    ROWS,
    WIDE,
    GridView,
    PixelFootprint,
    PixelGeometry,
    RowScratch,
    area,
    averaged,
    boxes_of,
    cut_to,
    fold,
    footprint_at,
    has_fewer,
    is_box,
    is_small,
    measure_rows,
    nth_part,
    parts_of,
    place_of,
    row_scratch,
    side_of,
)
from resample.engine.windows.limits import (
    ALONG_Y,
    Corners,
    Part,
    both,
    corner_scratch,
    fill_corners,
    keep_within,
    keep_within_mean,
    marks_at,
    part_around,
    part_of,
    tolerances,
    towards,
)
from resample.types import Doubles, Floats, Single

Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

AT_EDGES = 4  # parts of a pixel along an axis where an edge of the grid crosses it, at least
FARTHEST = 2.0**40  # samples from the grid's origin beyond which there is nothing
LONGEST_LIMITED = 24.0  # samples along one axis, `LIMITED` along the other: limits are averaged


class PixelScratch(NamedTuple):
    """Scratch for one pixel."""

    weights: Floats  # see `boxes.scratch_size`
    total: Floats  # (C,)
    polygon: Doubles  # (MOST_CORNERS, 2)
    spare: Doubles
    corners: Corners
    straight: Floats  # (2 × C,) see `_straighten`
    changes: Floats  # (2 × C,)


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
    # Split finely, and add the parts with centers on the source.
    footprint = averaged(view, footprint)
    counts, inside = parts_of(footprint, view.finest), 0
    counts = max(counts[0], AT_EDGES), max(counts[1], AT_EDGES)
    for n in range(counts[0] * counts[1]):
        part = nth_part(footprint, counts, n)
        if 0.0 <= part.u <= width and 0.0 <= part.v <= height:
            _add_part(view, part, np.float32(1), scratch)
            inside += 1
    # If none does, take one part at the nearest position of the source.
    if inside == 0:
        part = nth_part(footprint, counts, 0)
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
    placed = averaged(view, fold(view, footprint))
    if placed.along_x[0] == placed.along_x[1] == placed.along_y[0] == placed.along_y[1] == 0.0:
        box = GridBox(placed.u - view.plate.left, placed.v - view.plate.top, 0.0, 0.0)
        one, total = np.float32(1), scratch.total
        add_mean(view.plate, view.integral, view.points, box, one, scratch.weights, total)
    elif is_box(placed, view.finest):
        _add_part(view, placed, np.float32(1), scratch)
    else:
        counts = parts_of(placed, view.finest)
        each = np.float32(1.0 / (counts[0] * counts[1]))
        for n in range(counts[0] * counts[1]):
            _add_part(view, nth_part(placed, counts, n), each, scratch)
    return 1.0


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
def _straighten(
    view: GridView,
    footprint: PixelFootprint,
    part: Part,
    at: tuple[float, float],
    marks: int,
    scratch: PixelScratch,
) -> None:
    """Keep a pixel beside straight edges near the means across these edges.

    Along an edge the samples themselves are interpolated: the grid's means over each of them.
    """
    # The box of the pixel's mean, on the plate, and the samples before its center.
    placed, own = averaged(view, fold(view, footprint)), view.limits.own
    (ux, vx), (uy, vy) = placed.along_x, placed.along_y
    u, v = placed.u - view.plate.left, placed.v - view.plate.top
    wide, high = math.hypot(ux, uy), math.hypot(vx, vy)
    column, row = math.floor(u - 0.5) + 0.5, math.floor(v - 0.5) + 0.5
    channels, total, lanes = view.limits.plain.channels, scratch.total, scratch.total.size
    straight, tolerance = scratch.straight[:lanes], scratch.straight[lanes:]
    for axis in range(2):
        changes = scratch.changes[axis * lanes : (axis + 1) * lanes]
        for c in range(lanes):
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
        total[c] += both(scratch.changes[c], scratch.changes[lanes + c])


@inner_kernel
def _keep_positive(view: GridView, footprint: PixelFootprint, total: Floats) -> None:
    """Keep a mean of samples at or above zero where none of them is below.

    For pixels too large for limits: the rest of the ringing is small beside its cause, but not
    beside black.
    """
    flat, left, top, rows, columns, channels, there, before = view.limits.plain
    for c in range(channels):
        if not total[c] < np.float32(0):
            continue
        # Bound what the pixel covers.
        placed, least = fold(view, footprint), np.float32(0)
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
def _fill_pixel(
    view: GridView, footprint: PixelFootprint, part: Part, has_edges: bool, is_apart: bool,
    scratch: PixelScratch,
) -> float:  # fmt: skip
    """Put the mean over any footprint, within its limits; return its coverage.

    `part`, `has_edges`: limits that all pixels of the tile share, unless they `is_apart`.
    """
    coverage, total, corners = _mean_of(view, footprint, scratch), scratch.total, scratch.corners
    if not coverage > 0.0 or view.limits.excess < 0.0:
        return coverage
    plain, channels = view.limits.plain, view.limits.plain.channels
    u, v = footprint.u - plain.left, footprint.v - plain.top
    if is_small(footprint):
        # Clamp small footprints to the limits at their center.
        if is_apart:
            placed = fold(view, footprint)
            u, v = placed.u - plain.left, placed.v - plain.top
            part = part_around(view.limits, u, v)
            has_edges = fill_corners(view.limits, part, corners)
        marks = marks_at(corners, part, u, v) if has_edges else 0
        if marks:
            _straighten(view, footprint, part, (u, v), marks, scratch)
        keep_within(corners, part, (u, v), channels, total)
        return coverage
    # Clamp long, thin ones to the mean of the limits along them.
    side = _longer_side(footprint)
    if not is_apart and (side[0] != 0.0 or side[1] != 0.0):
        keep_within_mean(corners, part, (u, v), side, channels, total)
    _keep_positive(view, footprint, total)
    return coverage


@inner_kernel
def _footprint(geometry: PixelGeometry, row: int, column: int) -> PixelFootprint:
    """The footprint of a pixel: the role, compiled once."""
    return footprint_at(geometry, row, column)


@inner_kernel
def _fill_tile(
    geometry: PixelGeometry,
    view: GridView,
    tile: Integers,
    bounds: Doubles,
    wanted: Mask,
    image: Floats,
    covered: Floats,
    scratch: PixelScratch,
    pixels: RowScratch,
) -> None:
    """Fill one tile of the target."""
    # Compute limits for the whole tile, if they fit; else pixel by pixel.
    part, has_edges, has_limits = part_of(view.limits, bounds), False, view.limits.excess >= 0.0
    is_apart = view.margin < math.inf or (has_limits and part.wide == 0)
    if has_limits and not is_apart:
        has_edges = fill_corners(view.limits, part, scratch.corners)
    plain, total = view.limits.plain, scratch.total
    first, width = tile[LEFT], tile[RIGHT] - tile[LEFT]
    flat, share = image.reshape(-1), covered.reshape(-1)
    for row in range(tile[TOP], tile[BOTTOM]):
        above = (row - tile[TOP]) % ROWS
        if above == 0:
            rows = row, min(row + ROWS, tile[BOTTOM])
            measure_rows(geometry, view, rows, first, width, is_apart, pixels)
        for column in range(first, first + width):
            coverage, n = np.float32(1), above * WIDE + column - first
            if wanted.size > 0 and not wanted[row, column]:
                continue
            boxes = boxes_of(pixels, n)
            if boxes > 0:
                # Sum the few samples around, and clamp to the limits there.
                across, down = side_of(pixels, n, 0), side_of(pixels, n, DOWN)
                is_fewer = has_fewer(pixels, n)
                put_mean_of_few(
                    view.plate, view.integral, across, down, is_fewer, scratch.weights, total
                )
                if boxes == 2:
                    _average_with_other(view, pixels, n, is_fewer, scratch)
                if has_limits:
                    u, v = place_of(pixels, n)
                    u, v = u - plain.left, v - plain.top
                    marks = marks_at(scratch.corners, part, u, v) if has_edges else 0
                    if marks:
                        footprint = _footprint(geometry, row, column)
                        _straighten(view, footprint, part, (u, v), marks, scratch)
                    keep_within(scratch.corners, part, (u, v), plain.channels, total)
            else:
                footprint = _footprint(geometry, row, column)
                coverage = np.float32(
                    _fill_pixel(view, footprint, part, has_edges, is_apart, scratch)
                )
            # Store, premultiplied by coverage.
            at = np.uint64(row * covered.shape[1] + column)
            share[at] = coverage
            _put(total, coverage, flat, at * np.uint64(image.shape[2]), image.shape[2])


@inner_kernel
def _average_with_other(
    view: GridView, pixels: RowScratch, n: int, is_fewer: bool, scratch: PixelScratch
) -> None:
    """Average the nth pixel's mean over one box with that over the other."""
    across, down = side_of(pixels, n, OTHER), side_of(pixels, n, OTHER + DOWN)
    put_mean_of_few(
        view.plate, view.integral, across, down, is_fewer, scratch.weights, scratch.straight
    )
    for c in range(scratch.total.size):
        scratch.total[c] = np.float32(0.5) * (scratch.total[c] + scratch.straight[c])


@inner_step
def _put(total: Floats, coverage: Single, flat: Floats, at: Place, channels: int) -> None:
    """Put a pixel's channels, times its coverage; three at once."""
    if channels == 3:
        flat[at], flat[at + np.uint64(1)] = coverage * total[0], coverage * total[1]
        flat[at + np.uint64(2)] = coverage * total[2]
        return
    for c in range(channels):
        flat[at + np.uint64(c)] = coverage * total[c]


@kernel
def gather_tiles(
    counter: Counter,
    geometry: PixelGeometry,
    view: GridView,
    tiles: Integers,
    bounds: Doubles,
    wanted: Mask,
    image: Floats,
    covered: Floats,
) -> None:
    """Fill tiles (T, 4) of an image; for an application's packed kernel.

    `bounds`: (T, 4) of the tiles' footprints, see `Extent`. `wanted`: (height, width) of pixels
    that are filled, or empty: all. `image`: (height, width, C), filled, premultiplied by coverage;
    of as many channels as the plate, or less. `covered`: (height, width) coverage, filled.
    """
    # Allocate the scratch of this thread.
    channels, pixels = view.plate.channels, row_scratch()
    polygon, spare = np.empty((MOST_CORNERS, 2)), np.empty((MOST_CORNERS, 2))
    weights, total = np.empty(scratch_size(channels), np.float32), np.empty(channels, np.float32)
    straight, changes = np.zeros(2 * channels, np.float32), np.zeros(2 * channels, np.float32)
    scratch = PixelScratch(
        weights, total, polygon, spare, corner_scratch(channels), straight, changes
    )
    for n in tasks(counter, tiles.shape[0]):
        _fill_tile(geometry, view, tiles[n], bounds[n], wanted, image, covered, scratch, pixels)


class Extent(NamedTuple):
    """Area of tiles in the source, and its cost."""

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
    """Measure tiles' footprints, by pixels `step` apart; for an application's parallel kernel.

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
