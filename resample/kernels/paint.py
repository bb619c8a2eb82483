"""Paint the tiles of a frame: each tile alone, front to back, until it is opaque."""

import math
from typing import NamedTuple

import numpy as np
from numba import prange
from numpy.typing import NDArray

from resample.kernels.grid import grid
from resample.kernels.jit import kernel, parallel_kernel
from resample.kernels.lookup import radial
from resample.kernels.points import MOST_TAPS, add_point, composite_sheet
from resample.kernels.sorting import put_in_order
from resample.kernels.splats import paint_splat, paint_splat_across_near
from resample.types import (
    EXACT,
    Canvas,
    Ellipsoid,
    Floats,
    Place,
    Record,
    Records,
    Screen,
    Sheets,
    Style,
    Tables,
    Tiles,
    View,
)

BLOCK = 256  # samples fetched at once: their scattered reads then overlap

Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels


class Home(NamedTuple):
    """A tile and the frame it belongs to, px."""

    left: int
    top: int
    size: int
    width: int
    height: int


@kernel
def _new_canvas(rows: int, columns: int) -> Canvas:
    """Empty canvas of that many sub-pixels."""
    pixel = np.zeros((rows, columns, 8), np.float32)
    pixel[:, :, 3] = 1.0
    pixel[:, :, 6] = np.inf
    return Canvas(
        pixel,
        np.zeros((rows, columns, 8), np.float32),
        np.zeros((rows, columns, 2), np.float32),
        np.array([rows, 0, columns, 0]),
    )


@kernel
def _cast_rays(ray: Floats, place: Place, view: View, ellipsoid: Ellipsoid) -> None:
    """Per sub-pixel, what the exact footprints of all samples share."""
    n, unit = place.subpixels, ellipsoid.to_unit
    for row in range(ray.shape[0]):
        y = (place.y + (row + 0.5) / n - view.principal[1]) / view.focal[1]
        for column in range(ray.shape[1]):
            x = (place.x + (column + 0.5) / n - view.principal[0]) / view.focal[0]
            if not view.perspective:
                x, y = 0.0, 0.0
            squared = 0.0
            for axis in range(3):
                across = unit[axis, 0] * x + unit[axis, 1] * y + unit[axis, 2]
                squared += across * across
            ray[row, column, 0] = 1.0 / squared
            ray[row, column, 1] = ellipsoid.scale * math.sqrt((1.0 + x * x + y * y) / squared)


@kernel
def _is_at_home(record: Record, home: Home) -> bool:
    """Whether the sample's center, moved into the frame, lies in the tile."""
    x = max(0.0, min(home.width - 1.0, float(record["x"]))) - home.left
    y = max(0.0, min(home.height - 1.0, float(record["y"]))) - home.top
    return 0.0 <= x < home.size and 0.0 <= y < home.size


@kernel
def _paint_members(
    members: NDArray[np.int32],
    footprints: Records,
    sheets: Sheets,
    canvas: Canvas,
    place: Place,
    home: Home,
    view: View,
    ellipsoid: Ellipsoid,
    style: Style,
    tables: Tables,
    tally: Tally,
) -> None:
    """Paint samples in their order until all is opaque, and count the tile's own in `tally`."""
    pixel, sheet, ray, dirty = canvas
    across, down = np.zeros(MOST_TAPS, np.float32), np.zeros(MOST_TAPS, np.float32)
    profile, table, correction = tables.point, tables.footprint, tables.correction
    still_open = pixel.shape[0] * pixel.shape[1]
    open_sheet, has_points = 0, False
    block = footprints[members[:BLOCK]]
    for position in range(members.size):
        if position % BLOCK == 0:
            block = footprints[members[position : position + BLOCK]]
        record = block[position % BLOCK]
        sheet_number = sheets.sheet[members[position]]
        if has_points and sheet_number != open_sheet:
            still_open -= composite_sheet(pixel, sheet, dirty, style)
            has_points = False
        is_cut = record["cone"] < 0.0  # by the near plane: no point will do
        is_point = record["spacing"] * place.subpixels <= style.threshold and not is_cut
        if _is_at_home(record, home):
            tally[0 if is_point else 1] += 1
            tally[2] += 1 if still_open == 0 else 0
        if still_open == 0:
            continue
        if is_point:  # splats of its layer are nearer, if any are left: they are larger on screen
            add_point(sheet, dirty, place, record, style, profile, across, down)
            open_sheet, has_points = sheet_number, True
        elif not is_cut:
            still_open -= paint_splat(pixel, ray, place, record, style, table, correction)
        else:
            still_open -= paint_splat_across_near(
                pixel, place, record, view, ellipsoid, style, tables.density
            )
    composite_sheet(pixel, sheet, dirty, style)


@kernel
def _pixel_weights(tables: Tables, n: int) -> Floats:
    """Weights, with sum 1, of the sub-pixels along one axis that a pixel's filter reads."""
    margin = tables.pixel_margin
    weight = np.zeros((2 * margin + 1) * n, np.float32)
    for tap in range(weight.size):
        distance = abs((tap + 0.5) / n - margin - 0.5)
        weight[tap] = radial(tables.pixel, tables.pixel_extent, distance)
    weight /= weight.sum()
    return weight


@kernel
def _resolve(pixel: Floats, n: int, weight: Floats, home: Home, frame: Floats) -> None:
    """Filter the sub-pixels of a tile to its pixels of the frame (H, W, 7)."""
    one, zero = np.float32(1.0), np.float32(0.0)
    sums = np.zeros(6, np.float32)
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    for row in range(home.top, min(home.top + home.size, frame.shape[0])):
        for column in range(home.left, min(home.left + home.size, frame.shape[1])):
            sums[:] = zero
            first = np.inf
            for down in range(weight.size):
                r = (row - home.top) * n + down
                for right in range(weight.size):
                    c = (column - home.left) * n + right
                    share = weight[down] * weight[right]
                    covered = max(pixel[r, c, 7], min(one, pixel[r, c, 5]))
                    sums[0] += share * pixel[r, c, 0]
                    sums[1] += share * pixel[r, c, 1]
                    sums[2] += share * pixel[r, c, 2]
                    sums[3] += share * pixel[r, c, 7]
                    sums[4] += share * pixel[r, c, 4]
                    sums[5] += share * covered
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, pixel[r, c, 6])
            for channel in range(3):
                frame[row, column, channel] = max(zero, sums[channel])
            frame[row, column, 3] = min(one, max(zero, sums[3]))
            if sums[3] > zero:
                frame[row, column, 4] = sums[4] / sums[3]
            frame[row, column, 5] = first
            frame[row, column, 6] = min(one, max(zero, sums[5]))


@kernel
def _paint_tile(
    tile: int,
    tiles: Tiles,
    footprints: Records,
    sheets: Sheets,
    key_bits: NDArray[np.uint32],
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    frame: Floats,
    tally: Tally,
) -> None:
    members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
    if members.size == 0:
        return
    margin = tables.pixel_margin
    left, top = tile % tiles.columns * tiles.size, tile // tiles.columns * tiles.size
    home = Home(left, top, tiles.size, screen.width, screen.height)
    subpixels = grid(tiles.spacing[tile], style)
    tally[tile, 3] = subpixels
    place = Place(float(left - margin), float(top - margin), subpixels)
    # What lies beyond the frame's edge is left out: nothing might ever cover it.
    rows = (min(tiles.size, screen.height - top) + 2 * margin) * subpixels
    columns = (min(tiles.size, screen.width - left) + 2 * margin) * subpixels
    canvas = _new_canvas(rows, columns)
    if style.model == EXACT:
        _cast_rays(canvas.ray, place, view, ellipsoid)
    put_in_order(members, key_bits, footprints)
    _paint_members(
        members,
        footprints,
        sheets,
        canvas,
        place,
        home,
        view,
        ellipsoid,
        style,
        tables,
        tally[tile],
    )
    _resolve(canvas.pixel, subpixels, _pixel_weights(tables, subpixels), home, frame)


@parallel_kernel
def paint_tiles(
    turn: NDArray[np.int64],
    tiles: Tiles,
    footprints: Records,
    sheets: Sheets,
    key_bits: NDArray[np.uint32],
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    frame: Floats,
    tally: Tally,
) -> None:
    """Paint the tiles listed in `turn`. Tiles share no pixel, so no two threads meet."""
    for place in prange(turn.size):
        _paint_tile(
            turn[place],
            tiles,
            footprints,
            sheets,
            key_bits,
            view,
            ellipsoid,
            screen,
            style,
            tables,
            frame,
            tally,
        )
