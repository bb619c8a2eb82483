"""Paint the tiles of a frame: each tile alone, front to back, until it is opaque."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import (
    Home,
    cast_rays,
    is_at_home,
    laid_out,
    new_canvas,
    pixel_weights,
    resolve,
)
from resample.engine.ellipsoids.splats import paint_cut_splat, paint_splat
from resample.engine.grid import grid
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.points.adding import MOST_TAPS, add_point, composite_sheet
from resample.engine.sorting import put_in_order
from resample.types import (
    DISC,
    EXACT,
    Canvas,
    Doubles,
    Ellipsoid,
    Film,
    Place,
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


@kernel
def paint_members(
    members: NDArray[np.int32],
    footprints: Records,
    sheets: Sheets,
    canvas: Canvas,
    place: Place,
    home: Home,
    view: View,
    ellipsoid: Ellipsoid,
    planes: Doubles,
    style: Style,
    tables: Tables,
    still_open: int,
    tally: Tally,
) -> int:
    """Paint samples in their order until all is opaque, and count the tile's own in `tally`.

    Takes and gives how many sub-pixels are not opaque.
    """
    pixel, sheet, ray, dirty = canvas
    across, down = np.zeros(MOST_TAPS, np.float32), np.zeros(MOST_TAPS, np.float32)
    profile, table, correction = tables.point, tables.footprint, tables.correction
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
        is_cut = record["cone"] < 0.0  # by a plane: no point will do
        is_point = record["spacing"] * place.subpixels <= style.threshold and not is_cut
        if is_at_home(record, home):
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
            still_open -= paint_cut_splat(
                pixel, place, record, view, ellipsoid, planes, style, tables.partial
            )
    return still_open - composite_sheet(pixel, sheet, dirty, style)


@parallel_kernel
def paint_tiles(
    counter: Counter,
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
    film: Film,
    tally: Tally,
) -> None:
    """Paint the tiles listed in `turn`. No pixel is shared, so none meet."""
    for number in tasks(counter, turn.size):
        tile = turn[number]
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        subpixels = grid(tiles.spacing[tile], style)
        tally[tile, 3] = subpixels
        home, place, rows, columns = laid_out(
            tile, tiles.size, tiles.columns, subpixels, tables.pixel_margin, screen
        )
        canvas = new_canvas(rows, columns)
        if style.model in (EXACT, DISC):
            cast_rays(canvas.ray, place, view, ellipsoid)
        put_in_order(members, key_bits, footprints)
        paint_members(
            members,
            footprints,
            sheets,
            canvas,
            place,
            home,
            view,
            ellipsoid,
            screen.planes,
            style,
            tables,
            rows * columns,
            tally[tile],
        )
        resolve(canvas.pixel, subpixels, pixel_weights(tables, subpixels), home, film)
