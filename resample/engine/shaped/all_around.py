"""Composite ellipsoids on pixels with arbitrary rays: panoramas, fisheyes, distorting lenses.

Directions are shared out among the six faces of a cube around the eye. Ellipsoids are projected to
each face as to a picture; sub-pixels lie anywhere on a face, by explicit coordinates. As the
response is exact for every ray and the order is by distance, faces meet without a seam.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, inner_step, parallel_kernel, tasks
from resample.engine.shaped.canvas import (
    GROUPS,
    LANES,
    OPAQUE,
    PLANE,
    SHARE,
    SIDE,
    SIZE,
    Open,
    PaintedShapes,
    clear,
    lay,
    line_at,
    write_tile,
)
from resample.engine.shaped.lists import TileLists
from resample.engine.shaped.painting import OFTEN, Opacity, response_at
from resample.engine.shaped.records import BLUE, GREEN, LIMIT, PEAK, RED, X, Y, span_of
from resample.types import Doubles, Floats, Indices

FACES = 6
# Planes of a canvas in addition to `canvas`'s: where a sub-pixel lies on the face, and the length
# of its ray per unit of depth.
ACROSS, DOWN, LENGTH = (np.uint64(SIZE + n * PLANE) for n in range(3))
WIDER = SIZE + 3 * PLANE

Faces = NDArray[np.int8]


class PlacedTiles(NamedTuple):
    """Tiles of some rows of a picture, and where their sub-pixels lie on faces."""

    at: Floats  # (T, 3, PLANE) coordinates on the face, and lengths of rays per unit of depth
    face: Faces  # (T, PLANE) −1 for none
    columns: int  # tiles in a row of them


@inner_step
def _meets(records: Floats, n: int, box: Doubles) -> bool:
    """Whether a record's box meets another."""
    low, high = span_of(records[n], 0)
    if low > box[2] or high < box[0]:
        return False
    low, high = span_of(records[n], 1)
    return bool(low <= box[3] and high >= box[1])


@parallel_kernel
def deal_to_boxes(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    of: Indices,
    boxes: Doubles,
    position: Indices,
    member: NDArray[np.int32],
) -> None:
    """Write which of a list's records meet each box, or count them if `member` has no room.

    `of` (B,): list of each box. `position` (B,): where its members begin; it grows by them.
    """
    is_counting = member.size == 0
    for n in tasks(counter, of.size):
        for k in range(lists.start[of[n]], lists.start[of[n] + 1]):
            if _meets(records, lists.member[k], boxes[n]):
                if not is_counting:
                    member[position[n]] = lists.member[k]
                position[n] += 1


@inner_kernel
def _close(canvas: Floats, is_open: Open) -> bool:
    """Close groups with only opaque sub-pixels on the face; return whether one is still open."""
    any_open = False
    for row in range(SIDE):
        bits = np.uint32(0)
        for group in range(GROUPS):
            first = np.uint64(row * SIDE + group * LANES)
            for lane in range(LANES):
                k = first + np.uint64(lane)
                # Sub-pixels on other faces have NaN coordinates.
                if canvas[k + SHARE] >= OPAQUE and canvas[k + ACROSS] == canvas[k + ACROSS]:
                    bits |= np.uint32(1) << np.uint32(group)
        is_open[row] = bits
        any_open = any_open or bits != np.uint32(0)
    return any_open


@inner_kernel
def _place(canvas: Floats, at: Floats, face: Faces, number: int, boxes: Floats) -> None:
    """Give the sub-pixels of a tile their coordinates on a face, and groups their `boxes`."""
    nothing = np.float32(np.nan)
    for group in range(SIDE * GROUPS):
        box = boxes[group]
        box[0] = box[1] = np.float32(np.inf)
        box[2] = box[3] = np.float32(-np.inf)
        for k in range(group * LANES, group * LANES + LANES):
            if face[k] == number:
                box[0], box[1] = min(box[0], at[0, k]), min(box[1], at[1, k])
                box[2], box[3] = max(box[2], at[0, k]), max(box[3], at[1, k])
    for k in range(PLANE):
        place = np.uint64(k)
        is_here = face[k] == number
        canvas[place + ACROSS] = at[0, k] if is_here else nothing
        canvas[place + DOWN] = at[1, k] if is_here else nothing
        canvas[place + LENGTH] = at[2, k]


@inner_step
def _composite(
    canvas: Floats, is_open: Open, boxes: Floats, record: Floats, near: float, opacity: Opacity
) -> None:
    """Composite a record on the sub-pixels of a tile that are on the face."""
    (left, right), (top, bottom) = span_of(record, 0), span_of(record, 1)
    own = record[PEAK], record[LIMIT], np.float32(near)
    light = record[RED], record[GREEN], record[BLUE]
    for row in range(SIDE):
        bits = is_open[row]
        if bits == np.uint32(0):
            continue
        for group in range(GROUPS):
            if bits >> np.uint32(group) & np.uint32(1) == np.uint32(0):
                continue
            box = boxes[row * GROUPS + group]
            if box[0] > right or box[2] < left or box[1] > bottom or box[3] < top:
                continue
            base = np.uint64(row * SIDE + group * LANES)
            for lane in range(LANES):
                k = base + np.uint64(lane)
                x, y = canvas[k + ACROSS], canvas[k + DOWN]
                dx, dy = x - record[X], y - record[Y]
                alpha, t = response_at(opacity, line_at(record, dx, dy), dx, (x, y), own)
                # Depths are distances; sub-pixels off the face have no depth.
                far = t * canvas[k + LENGTH]
                lay(canvas, k, alpha, far if alpha > np.float32(0) else np.float32(0), light)


@parallel_kernel
def paint_all_around(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    tiles: PlacedTiles,
    fine: int,
    near: float,
    opacity: Opacity,
    picture: PaintedShapes,
) -> None:
    """Paint all tiles.

    `lists`: members of each tile on each face, (T FACES) lists. `fine`, `near`, `picture`: as in
    `paint_shapes`.
    """
    canvas, is_open = np.empty(WIDER, np.float32), np.empty(SIDE, np.uint32)
    boxes, side = np.empty((SIDE * GROUPS, 4), np.float32), SIDE // fine
    for tile in tasks(counter, tiles.at.shape[0]):
        clear(canvas, is_open)
        for number in range(FACES):
            first, end = lists.start[tile * FACES + number], lists.start[tile * FACES + number + 1]
            if first == end:
                continue
            _place(canvas, tiles.at[tile], tiles.face[tile], number, boxes)
            if not _close(canvas, is_open):
                continue
            for k in range(first, end):
                _composite(canvas, is_open, boxes, records[lists.member[k]], near, opacity)
                if k % OFTEN == OFTEN - 1 and not _close(canvas, is_open):
                    break
        row, column = tile // tiles.columns, tile % tiles.columns
        write_tile(canvas, (row * side, column * side), fine, picture)
