"""Points among splats: summed sheet by sheet in the order of all samples, then composited.

A sheet is composited before anything behind it is painted. Points that stand alone, as samples of
individual sizes do, form a sheet each.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.compositing import VISIBLE
from resample.engine.ellipsoids.outlines import (
    AREA,
    DEPTH,
    HOME,
    KEY,
    OPACITY,
    SPACING,
    X,
    Y,
)
from resample.engine.ellipsoids.outlines import BLUE as LIT_BLUE
from resample.engine.ellipsoids.outlines import GREEN as LIT_GREEN
from resample.engine.ellipsoids.outlines import RED as LIT_RED
from resample.engine.ellipsoids.rows import (
    ALPHA,
    BLUE,
    FIRST,
    GREEN,
    RED,
    WEIGHT,
    Groups,
    Members,
    bounds_at,
    index_of,
    is_open,
)
from resample.engine.ellipsoids.rows import DEPTH as FAR
from resample.engine.jit import kernel
from resample.engine.points.adding import MOST_TAPS, box_around
from resample.engine.subpixels import point_width
from resample.types import Floats, Place, Single, Stage, Style

_NOWHERE = 1 << 30


class PointSheet(NamedTuple):
    """The open sheet of points of a tile."""

    cell: Floats  # (h, w, 8): sums of opacity, of opacity × RGB and × depth, and of area; 0, 0
    dirty: NDArray[np.int64]  # (5,) touched rows and columns, first and past the last; sheet number
    across: Floats  # (MOST_TAPS,) scratch for weights along x
    down: Floats  # (MOST_TAPS,) and along y
    is_alone: bool  # each point is composited at once


@kernel
def new_sheet(height: int, width: int, is_alone: bool) -> PointSheet:
    """Allocate an empty sheet of so many rows and columns of sub-pixels."""
    return PointSheet(
        np.zeros((height, width, 8), np.float32),
        np.array([_NOWHERE, 0, _NOWHERE, 0, 0]),
        np.empty(MOST_TAPS, np.float32),
        np.empty(MOST_TAPS, np.float32),
        is_alone,
    )


@kernel
def width_of(spacing: Single, n: int, style: Style) -> float:
    """Width of a point's filter in sub-pixels, of n per side of a pixel."""
    return float(point_width(spacing * n, style.variance))


@kernel
def number_of_sheet(key: Single, stage: Stage) -> int:
    """Number of the sheet that a key lies in."""
    return int(np.floor(key / np.float32(stage.layers.thickness)))


@kernel
def is_empty(sheet: PointSheet) -> bool:
    """Whether the sheet holds no points."""
    return bool(sheet.dirty[0] >= sheet.dirty[1])


@kernel
def before_sheet(sheet: PointSheet, room: Floats, offset: Members, stage: Stage) -> int:
    """How many of the next samples belong to the open sheet; all if it is empty."""
    # Samples are in order: find the first that lies in another sheet.
    if is_empty(sheet):
        return offset.size
    n = 0
    while n < offset.size:
        if number_of_sheet(room[np.uint64(offset[n]) + KEY], stage) != sheet.dirty[4]:
            return n
        n += 1
    return n


@kernel
def add_to_open_sheet(
    sheet: PointSheet,
    rows: Floats,
    open_groups: Groups,
    room: Floats,
    offset: int,
    place: Place,
    stage: Stage,
) -> int:
    """Add a point to the open sheet, which is either its own sheet or empty.

    Return 1 if the point is at home in the tile and not hidden.
    """
    # Cull by the open groups of sub-pixels.
    s = np.uint64(offset)
    top, bottom, left, right = bounds_at(room, s)
    if left >= right or top >= bottom or not is_open(open_groups, top, bottom, left, right):
        return 0
    # Compute the filter's weights around the projected center.
    cell, dirty, across, down, is_alone = sheet
    n, style, profile = place.subpixels, stage.style, stage.tables.point
    dirty[4] = number_of_sheet(room[s + KEY], stage)
    x, y = (room[s + X] - place.x) * n, (room[s + Y] - place.y) * n
    reach = width_of(room[s + SPACING], n, style) * style.point_extent
    box = box_around(cell.shape[:2], x, y, reach, profile, across, down)
    if box.top >= box.bottom or box.left >= box.right:
        return int(room[s + HOME])
    # Extend the dirty rectangle.
    dirty[0], dirty[1] = min(dirty[0], box.top), max(dirty[1], box.bottom)
    dirty[2], dirty[3] = min(dirty[2], box.left), max(dirty[3], box.right)
    # Add the point under its filter; OPACITY is opacity × area.
    red, green, blue = room[s + LIT_RED], room[s + LIT_GREEN], room[s + LIT_BLUE]
    zero, one, depth, alpha = np.float32(0.0), np.float32(1.0), room[s + DEPTH], room[s + OPACITY]
    cover = room[s + AREA] / alpha
    for row in range(box.top, box.bottom):
        seen = alpha * down[row - box.first_row]
        for column in range(box.left, box.right):
            opacity = seen * across[column - box.first_column]
            # Eight products, although two are zero: they become one vector instruction.
            cell[row, column, 0] += opacity * one
            cell[row, column, 1] += opacity * red
            cell[row, column, 2] += opacity * green
            cell[row, column, 3] += opacity * blue
            cell[row, column, 4] += opacity * depth
            cell[row, column, 5] += opacity * cover
            cell[row, column, 6] += opacity * zero
            cell[row, column, 7] += opacity * zero
    # A point that stands alone is a sheet of its own.
    if is_alone:
        put_behind(sheet, rows, np.float32(style.opaque))
    return int(room[s + HOME])


@kernel
def put_behind(sheet: PointSheet, rows: Floats, opaque: Single) -> None:
    """Composite the open sheet under what is painted on rows of sub-pixels, and clear it."""
    cell, dirty = sheet.cell, sheet.dirty
    zero, one = np.float32(0.0), np.float32(1.0)
    # Composite the dirty rectangle where sub-pixels are not opaque yet.
    for row in range(dirty[0], dirty[1]):
        for column in range(dirty[2], dirty[3]):
            k, total = index_of(row, column), cell[row, column, 0]
            before = one - rows[k + ALPHA]
            if total > zero and before > opaque:
                # Opacities of points add up; where they exceed 1, they share the sub-pixel.
                alpha = min(total, one)
                share = before * alpha / total
                rows[k + RED] += max(zero, share * cell[row, column, 1])
                rows[k + GREEN] += max(zero, share * cell[row, column, 2])
                rows[k + BLUE] += max(zero, share * cell[row, column, 3])
                rows[k + ALPHA] += before * alpha
                rows[k + FAR] += share * cell[row, column, 4]
                rows[k + WEIGHT] += cell[row, column, 5]
                # Note the depth where the sub-pixel first becomes visible.
                if rows[k + FIRST] == np.inf and rows[k + ALPHA] > np.float32(VISIBLE):
                    rows[k + FIRST] = cell[row, column, 4] / total
            # Clear the cell for the next sheet.
            for channel in range(8):
                cell[row, column, channel] = zero
    dirty[0], dirty[1], dirty[2], dirty[3] = _NOWHERE, 0, _NOWHERE, 0
