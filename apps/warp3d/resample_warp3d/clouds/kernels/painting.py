"""Discs of a cloud to pixels: what is in front at each sub-pixel, and the mean of its colors there.

A sub-pixel shows all discs of the surface in front of it, weighted by how near their centers are;
those whose planes are farther there, by more than sampling explains, belong to the next surface,
which is seen where the first leaves room.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Record, Records, Single, Tiles
from resample_warp3d.clouds.kernels.discs import REACH

CORE: Single = np.float32(1.0 / (REACH * REACH))  # i² within which a splat is opaque
FEW = 4.0  # sub-pixels; rows of fewer are not narrowed down
AMPLE = 1.5  # discs' areas by which points cover: irregular surfaces of them are closed, too
EVEN = 1.0  # px, discs at least as large need not be looked at at every sub-pixel
LAYERS = 8  # surfaces one behind the other, at most
FULL: Single = np.float32(1 - 1e-3)  # coverage beyond which nothing shows through
RED, GREEN, BLUE, WEIGHT, NEAR, COVER = range(6)


class Block(NamedTuple):
    """The sub-pixels of one tile."""

    left: int  # px
    top: int  # px
    subpixels: int  # per side of a pixel
    floor: Floats  # (R, C) nearness that a disc of the surface in front has, at least
    limit: Floats  # (R, C) nearness below which the next surface is looked for; 0: full
    sums: Floats  # (R, C, 6) over the surface at hand: weighted color, weight, nearness, coverage
    seen: Floats  # (R, C, 6) red, green, blue, coverage, coverage × depth, nearness of the first
    box: NDArray[np.int64]  # (4,) first and last row, first and last column that are not full
    step: NDArray[np.int64]  # (1,) of the sub-pixels of a row, one in how many is used


class Disc(NamedTuple):
    """One record, in registers."""

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


class Picture(NamedTuple):
    """Where tiles are written."""

    rgba: Floats  # (H, W, 4)
    depth: Floats  # (H, W)
    first_depth: Floats  # (H, W)
    shows: NDArray[np.uint8]  # (N,) 1 for each disc that some sub-pixel shows


@kernel
def _new_block(tile: int, tiles: Tiles, picture: Picture, subpixels: int) -> Block:
    """An empty tile, without what lies beyond the frame."""
    height, width = picture.depth.shape
    row, column = divmod(int(np.int64(tile)), tiles.columns)
    left, top = column * tiles.size, row * tiles.size
    rows = min(tiles.size, height - top) * subpixels
    columns = min(tiles.size, width - left) * subpixels
    return Block(
        left,
        top,
        subpixels,
        np.zeros((rows, columns), np.float32),
        np.full((rows, columns), np.inf, np.float32),
        np.zeros((rows, columns, 6), np.float32),
        np.zeros((rows, columns, 6), np.float32),
        np.array([0, rows - 1, 0, columns - 1]),
        np.ones(1, np.int64),
    )


@kernel
def _disc(record: Record) -> Disc:
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
def _within(value: float, least: int, most: int) -> int:
    """Whole number below a value, kept within bounds, whatever the value."""
    return math.floor(max(float(least), min(float(most), value)))


@kernel
def _shift(row: int, subpixels: int) -> float:
    """How far a row of sub-pixels is moved to the right, sub-pixels.

    So upright edges pass the samples of a pixel one by one and not by columns.
    """
    return (row % subpixels + 0.5) / subpixels - 0.5


@kernel
def _first(block: Block, row: int, column: int) -> int:
    """First column from one on that is used; few of a pixel are the corners of a turned square."""
    step = block.step[0]
    if step == 1:
        return column
    used = (2 * (row % step) + 1) % (step + 1)
    return int(column + (used - column % step) % step)


@kernel
def _rows(disc: Disc, block: Block) -> tuple[int, int]:
    """First and last row of sub-pixels that a disc may touch."""
    fine = float(block.subpixels)
    first, last = block.box[0], block.box[1]
    return (
        _within((disc.top - block.top) * fine + 0.5, first, last + 1),
        _within((disc.bottom - block.top) * fine - 0.5, first - 1, last),
    )


@kernel
def _columns(disc: Disc, block: Block, row: int, core: Single) -> tuple[int, int]:
    """First and last column of the sub-pixels of a row with i² up to `core`, and few others."""
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
    if square > 0.0 and (right - left) * fine > FEW:
        mixed = (ux * uy + vx * vy) * dy - core * p * rest
        under = mixed * mixed - square * ((uy * uy + vy * vy) * dy * dy - core * rest * rest)
        if under < 0.0:
            return 0, -1
        root = math.sqrt(under)
        left = max(left, disc.x + (-mixed - root) / square)
        right = min(right, disc.x + (-mixed + root) / square)
    before = _shift(row, block.subpixels) + 0.5
    first, last = block.box[2], block.box[3]
    return (
        _within((left - block.left) * fine - before + 0.99, first, last + 1),
        _within((right - block.left) * fine - before + 0.01, first - 1, last),
    )


@kernel
def _claim(record: Record, block: Block) -> None:
    """Raise the floor where a disc is in front."""
    disc = _disc(record)
    is_splat = disc.is_splat
    core = CORE if is_splat else np.float32(1)
    fine = np.float32(1) / np.float32(block.subpixels)
    nearness, keep = disc.nearness, disc.keep
    ux, vx, p = disc.ux, disc.vx, disc.slope_x
    floor, limit = block.floor, block.limit
    one = np.float32(1)
    first_row, last_row = _rows(disc, block)
    for row in range(first_row, last_row + 1):
        first, last = _columns(disc, block, row, core)
        dy = np.float32(block.top + (row + 0.5) / block.subpixels - disc.y)
        start = np.float32(
            block.left + (_shift(row, block.subpixels) + 0.5) / block.subpixels - disc.x
        )
        u0, v0 = disc.uy * dy, disc.vy * dy
        d0 = one + disc.slope_y * dy
        for column in range(first, last + 1):
            dx = start + np.float32(column) * fine
            u, v, d = ux * dx + u0, vx * dx + v0, p * dx + d0
            e = d if is_splat else one
            near = nearness * d
            is_in = u * u + v * v <= core * e * e and d > 0 and near < limit[row, column]
            least = near * keep if is_in else np.float32(0)
            floor[row, column] = max(floor[row, column], least)


@kernel
def _add(record: Record, block: Block) -> bool:
    """Add a disc to the surface in front where it is part of it; gives whether it is anywhere."""
    disc = _disc(record)
    is_splat = disc.is_splat
    fine = np.float32(1) / np.float32(block.subpixels)
    nearness, whole = disc.nearness, disc.weight
    beyond = disc.keep * disc.keep  # as much nearer than what is in front as the floor is farther
    ux, vx, p = disc.ux, disc.vx, disc.slope_x
    red, green, blue = record["red"], record["green"], record["blue"]
    floor, limit, sums = block.floor, block.limit, block.sums
    zero, one, ample = np.float32(0), np.float32(1), np.float32(AMPLE)
    shows, step = False, block.step[0]
    first_row, last_row = _rows(disc, block)
    for row in range(first_row, last_row + 1):
        first, last = _columns(disc, block, row, one)
        dy = np.float32(block.top + (row + 0.5) / block.subpixels - disc.y)
        start = np.float32(
            block.left + (_shift(row, block.subpixels) + 0.5) / block.subpixels - disc.x
        )
        u0, v0 = disc.uy * dy, disc.vy * dy
        d0 = one + disc.slope_y * dy
        for column in range(_first(block, row, first), last + 1, step):
            dx = start + np.float32(column) * fine
            u, v, d = ux * dx + u0, vx * dx + v0, p * dx + d0
            e = d if is_splat else one
            near = nearness * d
            index = u * u + v * v
            bound = floor[row, column]
            if index < e * e and near * beyond <= bound <= near < limit[row, column] and d > zero:
                index /= e * e
                weight = whole * (one - index) * (one - index)
                sums[row, column, RED] += weight * red
                sums[row, column, GREEN] += weight * green
                sums[row, column, BLUE] += weight * blue
                sums[row, column, WEIGHT] += weight
                sums[row, column, NEAR] += weight * near
                if not is_splat:
                    sums[row, column, COVER] += ample * weight
                elif index <= CORE:
                    sums[row, column, COVER] += one
                shows = True
    return shows


@kernel
def _compose(block: Block, layer: int) -> bool:
    """Put the surface at hand behind those before; gives whether another may show through."""
    floor, limit, sums, seen, box = block.floor, block.limit, block.sums, block.seen, block.box
    rows, columns = floor.shape
    top, bottom, left, right = rows, -1, columns, -1
    one = np.float32(1)
    for row in range(box[0], box[1] + 1):
        for column in range(_first(block, row, box[2]), box[3] + 1, block.step[0]):
            weight = sums[row, column, WEIGHT]
            # Discs that were found behind a full sub-pixel, or none at all: nothing more to come.
            if floor[row, column] <= 0:
                limit[row, column] = 0
                continue
            if weight > 0:
                room = one - seen[row, column, 3]
                cover = room * min(one, sums[row, column, COVER])
                share = cover / weight
                seen[row, column, 0] += share * sums[row, column, RED]
                seen[row, column, 1] += share * sums[row, column, GREEN]
                seen[row, column, 2] += share * sums[row, column, BLUE]
                seen[row, column, 3] += cover
                near = sums[row, column, NEAR] / weight
                seen[row, column, 4] += cover / near
                if seen[row, column, 5] == 0:
                    seen[row, column, 5] = near
            is_open = seen[row, column, 3] < FULL
            limit[row, column] = floor[row, column] if is_open else np.float32(0)
            if is_open:
                top, bottom = min(top, row), max(bottom, row)
                left, right = min(left, column), max(right, column)
    if bottom < 0 or layer + 1 == LAYERS:
        return False
    box[0], box[1], box[2], box[3] = top, bottom, left, right
    for row in range(top, bottom + 1):
        for column in range(left, right + 1):
            floor[row, column] = 0
            for k in range(6):
                sums[row, column, k] = 0
    return True


@kernel
def _resolve(block: Block, picture: Picture) -> None:
    """Mean of each pixel's sub-pixels."""
    seen, fine = block.seen, block.subpixels
    rgba = picture.rgba
    rows, columns = block.floor.shape
    scale = block.step[0] / (fine * fine)
    for i in range(rows // fine):
        for j in range(columns // fine):
            red, green, blue, cover, depth, first = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
            for row in range(i * fine, (i + 1) * fine):
                start = _first(block, row, j * fine)
                for column in range(start, (j + 1) * fine, block.step[0]):
                    red += seen[row, column, 0]
                    green += seen[row, column, 1]
                    blue += seen[row, column, 2]
                    cover += seen[row, column, 3]
                    depth += seen[row, column, 4]
                    first = max(first, seen[row, column, 5])
            y, x = block.top + i, block.left + j
            rgba[y, x, 0], rgba[y, x, 1] = scale * red, scale * green
            rgba[y, x, 2], rgba[y, x, 3] = scale * blue, min(1.0, scale * cover)
            picture.depth[y, x] = depth / cover if cover > 0.0 else np.inf
            picture.first_depth[y, x] = 1.0 / first if first > 0.0 else np.inf


@kernel
def _is_even(records: Records, tiles: Tiles, tile: int, block: Block) -> bool:
    """Whether one surface of splats fills a tile, so that a few of its sub-pixels tell all."""
    fine, floor = block.subpixels, block.floor
    if fine % 2 == 1 or tiles.spacing[tile] < EVEN:
        return False
    keep = np.float32(0)
    for member in range(tiles.start[tile], tiles.start[tile + 1]):
        keep = max(keep, records[tiles.member[member]]["keep"])
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


@kernel
def _paint_tile(
    records: Records, tiles: Tiles, tile: int, subpixels: int, picture: Picture
) -> None:
    """Paint one tile, which belongs to one thread."""
    start, end = tiles.start[tile], tiles.start[tile + 1]
    if start == end:
        return
    block = _new_block(tile, tiles, picture, subpixels)
    for layer in range(LAYERS):
        for member in range(start, end):
            _claim(records[tiles.member[member]], block)
        if layer == 0 and _is_even(records, tiles, tile, block):
            block.step[0] = subpixels
        for member in range(start, end):
            if _add(records[tiles.member[member]], block):
                picture.shows[tiles.member[member]] = 1
        if not _compose(block, layer):
            break
    _resolve(block, picture)


@parallel_kernel
def paint(
    counter: Counter, records: Records, tiles: Tiles, subpixels: int, picture: Picture
) -> None:
    """Paint every tile.

    Parameters
    ----------
    records
        (N,) of `SURFEL`.
    tiles
        Which of them touch which tile, in their order.
    subpixels
        Per side of a pixel.
    picture
        Filled; transparent before, with infinite depths.
    """
    for tile in tasks(counter, tiles.start.size - 1):
        _paint_tile(records, tiles, tile, subpixels, picture)
