"""Composite ellipsoids in the order of each ray: by the depth at which it passes their centers.

Each sub-pixel keeps the nearest of those that were not composited yet in a ring, in order. Members
of a tile come by the depth of their centers; when the ring is full, its nearest is composited. So a
ray's order is exact unless one of it comes more than `WAITING` members late.
"""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, inner_step, load_soon, parallel_kernel, tasks
from resample.engine.shaped.canvas import (
    LANES,
    OPAQUE,
    PLANE,
    SHARE,
    SIDE,
    SIZE,
    Line,
    Open,
    PaintedShapes,
    TilePlace,
    clear,
    close_groups,
    columns_of,
    groups_of,
    lay,
    line_of,
    rows_of,
    write_tile,
)
from resample.engine.shaped.lists import TileGrid, TileLists
from resample.engine.shaped.painting import OFTEN, DepthOpacity, PeakOpacity, response_at, tile_at
from resample.engine.shaped.records import BLUE, GREEN, LIMIT, PEAK, RED, WIDTH
from resample.types import Floats, Single

WAITING = 32  # a power of two
LAST = WAITING - 1


@inner_step
def _take(
    canvas: Floats, ring: Floats, number: NDArray[np.int32], place: int, slot: int, records: Floats
) -> None:
    """Composite what waits in a slot of a sub-pixel's ring."""
    k = place * WAITING + slot
    record = records[number[k]]
    light = record[RED], record[GREEN], record[BLUE]
    lay(canvas, np.uint64(place), ring[2 * k], ring[2 * k + 1], light)


@inner_step
def _wait(
    ring: Floats, number: NDArray[np.int32], place: int, begin: int, count: int, alpha: Single,
    t: Single, member: int,
) -> None:  # fmt: skip
    """Put an opacity at a depth into a sub-pixel's ring, in order."""
    first = place * WAITING
    n = count
    while n > 0:
        before = first + ((begin + n - 1) & LAST)
        if ring[2 * before + 1] <= t:
            break
        k = first + ((begin + n) & LAST)
        ring[2 * k], ring[2 * k + 1] = ring[2 * before], ring[2 * before + 1]
        number[k] = number[before]
        n -= 1
    k = first + ((begin + n) & LAST)
    ring[2 * k], ring[2 * k + 1], number[k] = alpha, t, member


@inner_kernel
def _offer(
    canvas: Floats,
    is_open: Open,
    rings: tuple[Floats, NDArray[np.int32], NDArray[np.int32], Floats],
    records: Floats,
    member: int,
    spot: TilePlace,
    opacity: PeakOpacity | DepthOpacity,
) -> None:
    """Offer a record to a tile's sub-pixels."""
    ring, number, state, lanes = rings
    record = records[member]
    columns, (top, bottom) = columns_of(record, spot), rows_of(record, spot)
    own = record[PEAK], record[LIMIT], spot.near
    for row in range(top, bottom):
        bits = is_open[row]
        if bits == np.uint32(0):
            continue
        line = line_of(record, spot, row)
        first, last = groups_of(record, line, spot, columns)
        y = np.float32(spot.top + (row + 0.5) * float(spot.step))
        for group in range(first, last):
            if bits >> np.uint32(group) & np.uint32(1) == np.uint32(0):
                continue
            _evaluate(lanes, line, spot, group, y, own, opacity)
            base = row * SIDE + group * LANES
            for lane in range(LANES):
                place = base + lane
                alpha = lanes[lane]
                if alpha <= np.float32(0) or canvas[np.uint64(place) + SHARE] < OPAQUE:
                    continue
                begin, count = state[2 * place], state[2 * place + 1]
                # A full ring composites its nearest, unless the new one is nearer still.
                if count == WAITING:
                    _take(canvas, ring, number, place, begin, records)
                    begin, count = (begin + 1) & LAST, count - 1
                _wait(ring, number, place, begin, count, alpha, lanes[LANES + lane], member)
                state[2 * place], state[2 * place + 1] = begin, count + 1


@inner_step
def _evaluate(
    lanes: Floats,
    line: Line,
    spot: TilePlace,
    group: int,
    y: Single,
    own: tuple[Single, Single, Single],
    opacity: PeakOpacity | DepthOpacity,
) -> None:
    """Opacities of a record at the sub-pixels of a group, and then depths, into `lanes`."""
    start = line.start + np.float32(group * LANES) * spot.step
    x = np.float32(spot.left + (group * LANES + 0.5) * float(spot.step))
    for lane in range(LANES):
        along = np.float32(lane) * spot.step
        alpha, t = response_at(opacity, line, start + along, (x + along, y), own)
        k = np.uint64(lane)
        lanes[k] = alpha
        lanes[k + np.uint64(LANES)] = t


@inner_kernel
def _finish(
    canvas: Floats,
    rings: tuple[Floats, NDArray[np.int32], NDArray[np.int32], Floats],
    records: Floats,
) -> None:
    """Composite all that waits."""
    ring, number, state, _ = rings
    for place in range(PLANE):
        begin, count = state[2 * place], state[2 * place + 1]
        for n in range(count):
            if canvas[np.uint64(place) + SHARE] < OPAQUE:
                break
            _take(canvas, ring, number, place, (begin + n) & LAST, records)


@parallel_kernel
def paint_along_rays(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    grid: TileGrid,
    fine: int,
    near: float,
    opacity: PeakOpacity | DepthOpacity,
    picture: PaintedShapes,
) -> None:
    """Paint all tiles; parameters are those of `paint_shapes`."""
    canvas, is_open = np.empty(SIZE, np.float32), np.empty(SIDE, np.uint32)
    number, state = np.empty(PLANE * WAITING, np.int32), np.empty(2 * PLANE, np.int32)
    ring, lanes = np.empty(2 * PLANE * WAITING, np.float32), np.empty(2 * LANES, np.float32)
    rings = ring, number, state, lanes
    flat = records.reshape(-1)
    for tile in tasks(counter, lists.start.size - 1):
        origin, spot = tile_at(grid, tile, fine, near)
        clear(canvas, is_open)
        state[:] = 0
        end = lists.start[tile + 1]
        for k in range(lists.start[tile], end):
            if k + 4 < end:
                load_soon(flat, lists.member[k + 4] * WIDTH)
            _offer(canvas, is_open, rings, records, lists.member[k], spot, opacity)
            if k % OFTEN == OFTEN - 1 and not close_groups(canvas, is_open):
                break
        _finish(canvas, rings, records)
        write_tile(canvas, origin, fine, picture)
