"""Paint tiles sheet by sheet or slab by slab: sum what lies in one, then composite the sum."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import (
    Home,
    is_at_home,
    laid_out,
    new_canvas,
    pixel_weights,
    resolve,
)
from resample.engine.grid import grid
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.lookup import absorbed
from resample.engine.over import VISIBLE
from resample.engine.points.adding import MOST_TAPS, add_point
from resample.engine.slabs.fields import resolve_value
from resample.engine.slabs.record_fields import develop, take_in_slab
from resample.engine.slabs.slabs import (
    Corners,
    Rays,
    Slab,
    add_cut_splat,
    add_splat,
    add_thin_point,
    cast_slab_rays,
    density_of,
    rays_of,
    share_of_mass,
)
from resample.engine.sorting import put_in_order
from resample.types import (
    ADDITIVE,
    AVERAGE,
    MAXIMUM,
    Canvas,
    Classifier,
    Ellipsoid,
    Film,
    Floats,
    Place,
    Records,
    Screen,
    Sheets,
    Style,
    Tables,
    Tiles,
    View,
)

Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels


@kernel
def _composite(pixel: Floats, slab: Floats, sheet: Floats, dirty: Corners, style: Style) -> int:
    """Put a slab behind what is painted and empty it; gives how many pixels it closed.

    Its splats overlap, so their optical depths add up; its points lie beside them.
    """
    zero, one, closed = np.float32(0.0), np.float32(1.0), 0
    first_row, last_row, first_column, last_column = dirty
    for row in range(first_row, last_row):
        for column in range(first_column, last_column):
            depth, points, before = (
                slab[row, column, 0],
                sheet[row, column, 0],
                pixel[row, column, 3],
            )
            if depth + points > zero and before > np.float32(style.opaque):
                splats = min(depth, one) if style.linear_opacity else absorbed(depth)
                of_splats = splats / depth if depth > zero else zero
                total = max(one, points + splats)
                alpha = (points + splats) / total
                share = before / total
                for channel in range(3):
                    added = (
                        of_splats * slab[row, column, 1 + channel] + sheet[row, column, 1 + channel]
                    )
                    pixel[row, column, channel] += max(zero, share * added)
                after = before * (one - alpha)
                far = of_splats * slab[row, column, 4] + sheet[row, column, 4]
                pixel[row, column, 3] = after
                pixel[row, column, 4] += share * far
                pixel[row, column, 7] += before * alpha
                covered = slab[row, column, 5] / np.float32(style.layer) + sheet[row, column, 5]
                pixel[row, column, 5] += covered
                if pixel[row, column, 6] == np.inf and after < np.float32(1.0 - VISIBLE):
                    pixel[row, column, 6] = far / (points + splats)
                if after <= style.opaque:
                    closed += 1
            for channel in range(8):
                slab[row, column, channel] = zero
                sheet[row, column, channel] = zero
    dirty[0], dirty[2] = sheet.shape[0], sheet.shape[1]
    dirty[1], dirty[3] = 0, 0
    return closed


@kernel
def _add_members(
    block: Records,
    first: int,
    last: int,
    slab: Floats,
    ray: Floats,
    canvas: Canvas,
    place: Place,
    bounds: Slab,
    rays: Rays,
    view: View,
    ellipsoid: Ellipsoid,
    style: Style,
    tables: Tables,
    is_field: bool,
    across: Floats,
    down: Floats,
) -> None:
    """Sum the samples `first` to `last` of a tile as far as they lie in a slab."""
    pixel, sheet, _, dirty = canvas
    partial, correction, profile = tables.partial, tables.correction, tables.point
    for position in range(first, last):
        record = block[position]
        is_cut = record["cone"] < 0.0
        if record["spacing"] * place.subpixels <= style.threshold and not is_cut:
            if bounds.front <= record["depth"] < bounds.back:
                if is_field or style.variance > 0.0:
                    density = density_of(record, style, is_field)
                    add_thin_point(
                        slab, dirty, place, record, density, style, profile, across, down
                    )
                else:  # the paper's, as wide as pixels
                    add_point(sheet, dirty, place, record, style, profile, across, down)
            continue
        density = density_of(record, style, is_field)
        if is_cut:
            add_cut_splat(
                slab,
                dirty,
                pixel,
                ray,
                place,
                record,
                bounds,
                view,
                ellipsoid,
                density,
                style,
                partial,
            )
            continue
        if style.projection == ADDITIVE and not view.perspective:
            density *= share_of_mass(
                record, place, rays, style, ellipsoid.scale, partial, correction
            )
        add_splat(
            slab,
            dirty,
            pixel,
            ray,
            place,
            record,
            bounds,
            rays,
            density,
            style,
            partial,
            correction,
        )


@kernel
def _count(
    block: Records,
    first: int,
    last: int,
    place: Place,
    home: Home,
    style: Style,
    is_hidden: bool,
    tally: Tally,
) -> None:
    """Count a tile's own samples as points and splats."""
    for position in range(first, last):
        record = block[position]
        if is_at_home(record, home):
            is_point = record["spacing"] * place.subpixels <= style.threshold
            tally[0 if is_point and record["cone"] >= 0.0 else 1] += 1
            tally[2] += 1 if is_hidden else 0


@kernel
def _paint_sheets(
    members: NDArray[np.int32],
    footprints: Records,
    sheets: Sheets,
    canvas: Canvas,
    place: Place,
    home: Home,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    look: Classifier,
    is_field: bool,
    is_cutting: bool,
    state: Floats,
    tally: Tally,
) -> None:
    """Paint sheets of whole samples, or slabs that cut them, until all is opaque."""
    pixel, sheet, _, dirty = canvas
    ray = np.zeros((pixel.shape[0], pixel.shape[1], 6), np.float32)
    cast_slab_rays(ray, place, view, ellipsoid, screen.planes)
    slab = np.zeros_like(pixel)
    across, down = np.zeros(MOST_TAPS, np.float32), np.zeros(MOST_TAPS, np.float32)
    rays = rays_of(view, ellipsoid)
    reach = math.sqrt(ellipsoid.covariance[2, 2])
    block = footprints[members]
    still_open = pixel.shape[0] * pixel.shape[1]
    bounds, number = Slab(-np.inf, np.inf), 0
    first = last = 0
    while last < members.size or first < last:
        if still_open == 0:
            break
        before = last
        if is_cutting:
            if first == last:
                number = math.floor((block[last]["depth"] - reach) / style.layer)
                last += 1
            bounds = Slab(number * style.layer, (number + 1) * style.layer)
            while last < members.size and block[last]["depth"] - reach < bounds.back:
                last += 1
            while first < last and block[first]["depth"] + reach <= bounds.front:
                first += 1
        else:
            first = last
            open_sheet = sheets.sheet[members[first]]
            while last < members.size and sheets.sheet[members[last]] == open_sheet:
                last += 1
        _count(block, before, last, place, home, style, False, tally)
        if first < last:
            _add_members(
                block,
                first,
                last,
                slab,
                ray,
                canvas,
                place,
                bounds,
                rays,
                view,
                ellipsoid,
                style,
                tables,
                is_field,
                across,
                down,
            )
            if is_field:
                still_open -= take_in_slab(
                    slab, state, dirty, pixel, ray, place, bounds, number, view, style, look
                )
            else:
                still_open -= _composite(pixel, slab, sheet, dirty, style)
        if is_cutting:
            number += 1
        else:
            first = last
    _count(block, last, members.size, place, home, style, True, tally)


@parallel_kernel
def paint_sheet_tiles(
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
    look: Classifier,
    is_field: bool,
    is_cutting: bool,
    film: Film,
    value: Floats,
    tally: Tally,
) -> None:
    """Paint the tiles listed in `turn`; `value` (H, W) is what projections of fields measure."""
    for number in tasks(counter, turn.size):
        tile = turn[number]
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        subpixels = grid(tiles.spacing[tile], style)
        tally[tile, 3] = subpixels
        home, place, rows, columns = laid_out(
            tile, tiles.size, tiles.columns, subpixels, tables.pixel_margin, screen
        )
        canvas = new_canvas(rows, columns)
        measured = is_field and style.projection in (MAXIMUM, AVERAGE, ADDITIVE)
        state = np.zeros((rows, columns, 8) if is_field else (0, 0, 8), np.float32)
        put_in_order(members, key_bits, footprints)
        _paint_sheets(
            members,
            footprints,
            sheets,
            canvas,
            place,
            home,
            view,
            ellipsoid,
            screen,
            style,
            tables,
            look,
            is_field,
            is_cutting,
            state,
            tally[tile],
        )
        weight = pixel_weights(tables, subpixels)
        if measured:
            voxel = ellipsoid.volume ** (1.0 / 3.0)
            develop(state, canvas.pixel, voxel, style, look)
            resolve_value(state, subpixels, weight, home, style.projection == ADDITIVE, value)
        resolve(canvas.pixel, subpixels, weight, home, film)
