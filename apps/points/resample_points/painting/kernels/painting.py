"""Paint discs of a cloud: each sub-pixel's front surface, and its mean color.

A sub-pixel shows all discs of the surface in front of it, weighted by the distance of their
centers; discs whose planes are farther there than sampling explains belong to the next surface,
which shows where the first leaves the pixel uncovered.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.roles import plays
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
from resample.types import Floats, Record, Records, Single, Tiles
from resample_points.painting.kernels.discs import REACH

CORE: Single = np.float32(1.0 / (REACH * REACH))  # i² within which a splat is opaque
FEW = 4.0  # sub-pixels; shorter rows are not narrowed down
AMPLE = 1.5  # factor of the coverage of points, so that irregular surfaces of them are closed, too
EVEN = 1.0  # px; discs at least as large need not be sampled at every sub-pixel
LAYERS = 8  # surfaces one behind the other, at most
RED, GREEN, BLUE = range(3)  # lanes of a surface, besides those of the engine


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
    ux, uy, vx, vy = (
        float(disc.ux),
        float(disc.uy),
        float(disc.vx),
        float(disc.vy),
    )
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
            # Evaluate the disc's linear forms; perspective divides those of splats.
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
            # Write premultiplied color and coverage, mean depth, and the depth of what is first.
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
