"""Composite ellipsoids in the order of each ray: by the depth at which it passes their centers.

Members of a tile come by the least depth at which its rays may pass their centers. They wait at
each sub-pixel, in order of the depth at which its own ray does, until no later member can be
nearer. Where more than `WAITING` wait, the group of sub-pixels is painted again by itself, with
room for all members. So each ray has its exact order, until `OPAQUE` is reached.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, inner_step, kernel, parallel_kernel, tasks
from resample.engine.shaped.canvas import (
    FIRST,
    GROUPS,
    LANES,
    MEDIAN,
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
    groups_of,
    lay,
    line_of,
    subpixels_of,
    write_tile,
)
from resample.engine.shaped.lists import TileGrid, TileLists
from resample.engine.shaped.painting import Opacity, response_at, tile_at
from resample.engine.shaped.records import (
    BLUE,
    D_X,
    D_XX,
    D_XY,
    D_Y,
    D_YY,
    GREEN,
    LIMIT,
    PEAK,
    RED,
    T_1,
    T_X,
    T_Y,
    X,
    Y,
    span_of,
)
from resample.types import Doubles, Floats, Single

WAITING = 256  # a power of two
SETTLED = 32  # members of a tile after which what can no longer change is composited
SAFE = 1.0 - 1e-5  # factor of a bound of depths, for the rounding of float32


class Waiting(NamedTuple):
    """Queues of sub-pixels, as rings with a power of two of places each."""

    ring: Floats  # (2 S M,) opacities and depths, in order of the depths
    number: NDArray[np.int32]  # (S M,) of their records
    state: NDArray[np.int32]  # (2 S,) where each ring begins, and how many it holds
    front: Floats  # (S,) depth of the nearest that each holds; inf if it is empty


@kernel
def ring_scratch(subpixels: int, most: int) -> Waiting:
    """Allocate empty rings of `most` places, a power of two, for some sub-pixels."""
    return Waiting(
        np.empty(2 * subpixels * most, np.float32),
        np.empty(subpixels * most, np.int32),
        np.zeros(2 * subpixels, np.int32),
        np.full(subpixels, np.float32(np.inf)),
    )


@inner_step
def _least_depth(record: Floats, spot: TilePlace) -> float:
    """Lower bound of the depths at which a tile's rays pass a record's center."""
    span = SIDE * float(spot.step)
    low, high = span_of(record, 0)
    x0, x1 = max(low, spot.left) - float(record[X]), min(high, spot.left + span) - float(record[X])
    low, high = span_of(record, 1)
    y0, y1 = max(low, spot.top) - float(record[Y]), min(high, spot.top + span) - float(record[Y])
    # The numerator is linear, the denominator convex: both have their extremes at corners.
    along, down = float(record[T_X]), float(record[T_Y])
    least = float(record[T_1]) + min(along * x0, along * x1) + min(down * y0, down * y1)
    most = 0.0
    for x in (x0, x1):
        for y in (y0, y1):
            across = float(record[D_X]) + x * float(record[D_XX]) + y * float(record[D_XY])
            deep = float(record[D_Y]) + y * float(record[D_YY])
            most = max(most, 1.0 + x * across + y * deep)
    return max(SAFE * least / most, float(spot.near)) if least > 0.0 else float(spot.near)


@kernel
def _by_least_depth(
    records: Floats, lists: TileLists, tile: int, spot: TilePlace
) -> tuple[NDArray[np.int32], Doubles]:
    """Order a tile's members by the bounds of their depths, which follow, with inf at the end."""
    members = lists.member[lists.start[tile] : lists.start[tile + 1]]
    bound = np.full(members.size + 1, np.inf)
    for k in range(members.size):
        bound[k] = _least_depth(records[members[k]], spot)
    order = np.argsort(bound, kind="mergesort")  # inf stays last
    return members[order[:-1]], bound[order]


@inner_step
def _take(
    waiting: Waiting, place: int, most: int, canvas: Floats, at: int, records: Floats
) -> None:
    """Composite the nearest queued fragment of a sub-pixel; `at`: its place on the canvas."""
    ring, number, state, front = waiting
    begin, count = state[2 * place], state[2 * place + 1] - 1
    k = place * most + begin
    record = records[number[k]]
    light = record[RED], record[GREEN], record[BLUE]
    lay(canvas, np.uint64(at), ring[2 * k], ring[2 * k + 1], light)
    begin = (begin + 1) & (most - 1)
    state[2 * place], state[2 * place + 1] = begin, count
    front[place] = ring[2 * (place * most + begin) + 1] if count > 0 else np.float32(np.inf)


@inner_step
def _wait(waiting: Waiting, place: int, most: int, alpha: Single, t: Single, member: int) -> None:
    """Put an opacity at a depth into a sub-pixel's ring, in order."""
    ring, number, state, front = waiting
    front[place] = min(front[place], t)
    first, begin, n, last = place * most, state[2 * place], state[2 * place + 1], most - 1
    state[2 * place + 1] = n + 1
    while n > 0:
        before = first + ((begin + n - 1) & last)
        if ring[2 * before + 1] <= t:
            break
        k = first + ((begin + n) & last)
        ring[2 * k], ring[2 * k + 1] = ring[2 * before], ring[2 * before + 1]
        number[k] = number[before]
        n -= 1
    k = first + ((begin + n) & last)
    ring[2 * k], ring[2 * k + 1], number[k] = alpha, t, member


@inner_kernel
def _settle(
    waiting: Waiting,
    span: tuple[int, int],
    most: int,
    canvas: Floats,
    bound: float,
    records: Floats,
) -> None:
    """Composite all queued fragments up to a depth at consecutive sub-pixels.

    `span`: the first of them on the canvas, and their number.
    """
    front = waiting.front
    for place in range(span[1]):
        at = span[0] + place
        while front[place] <= bound and front[place] < np.inf:
            if canvas[np.uint64(at) + SHARE] < OPAQUE:
                break
            _take(waiting, place, most, canvas, at, records)


@inner_step
def _evaluate(
    lanes: Floats,
    line: Line,
    record: Floats,
    at: tuple[int, int],
    spot: TilePlace,
    opacity: Opacity,
) -> None:
    """Opacities of a record at the sub-pixels of a group, and then depths, into `lanes`."""
    row, group = at
    own = record[PEAK], record[LIMIT], spot.near
    start = line.start + np.float32(group * LANES) * spot.step
    x = np.float32(spot.left + (group * LANES + 0.5) * float(spot.step))
    y = np.float32(spot.top + (row + 0.5) * float(spot.step))
    for lane in range(LANES):
        along = np.float32(lane) * spot.step
        alpha, t = response_at(opacity, line, start + along, (x + along, y), own)
        k = np.uint64(lane)
        lanes[k] = alpha
        lanes[k + np.uint64(LANES)] = t


@inner_kernel
def _queue(
    waiting: Waiting, places: tuple[int, int], most: int, canvas: Floats, lanes: Floats, member: int
) -> bool:
    """Queue a record at eight sub-pixels, as `lanes` say; return whether there was room.

    `places`: of the first of them among the rings, and on the canvas.
    """
    for lane in range(LANES):
        place, alpha = places[0] + lane, lanes[lane]
        if alpha > np.float32(0) and canvas[np.uint64(places[1] + lane) + SHARE] >= OPAQUE:
            if waiting.state[2 * place + 1] == most:
                return False
            _wait(waiting, place, most, alpha, lanes[LANES + lane], member)
    return True


@kernel
def _paint_group(
    records: Floats,
    members: NDArray[np.int32],
    bound: Doubles,
    at: tuple[int, int],
    spot: TilePlace,
    opacity: Opacity,
    lanes: Floats,
    canvas: Floats,
) -> None:
    """Paint a group of sub-pixels anew, with room for all members of its tile."""
    row, group = at
    base, most = row * SIDE + group * LANES, 1
    while most < members.size:
        most *= 2
    waiting = ring_scratch(LANES, most)
    for lane in range(LANES):
        at_lane = np.uint64(base + lane)
        for plane in range(SIZE // PLANE):
            canvas[at_lane + np.uint64(plane * PLANE)] = np.float32(0)
        canvas[at_lane + MEDIAN] = canvas[at_lane + FIRST] = np.float32(np.inf)
        canvas[at_lane + SHARE] = np.float32(1)
    for k in range(members.size):
        record = records[members[k]]
        top, bottom = subpixels_of(record, 1, spot.top, spot.step)
        if top <= row < bottom:
            line = line_of(record, spot, row)
            first, last = groups_of(
                record, line, spot, subpixels_of(record, 0, spot.left, spot.step)
            )
            if first <= group < last:
                _evaluate(lanes, line, record, at, spot, opacity)
                _queue(waiting, (0, base), most, canvas, lanes, members[k])
        if k % SETTLED == SETTLED - 1:
            _settle(waiting, (base, LANES), most, canvas, bound[k + 1], records)
            thinnest = np.float32(0)
            for lane in range(LANES):
                thinnest = max(thinnest, canvas[np.uint64(base + lane) + SHARE])
            if thinnest < OPAQUE:
                return
    _settle(waiting, (base, LANES), most, canvas, np.inf, records)


@inner_step
def _visit(
    waiting: Waiting,
    canvas: Floats,
    is_open: Open,
    is_full: Open,
    records: Floats,
    number: int,
    spot: TilePlace,
    opacity: Opacity,
    lanes: Floats,
) -> None:
    """Queue a record at the sub-pixels of a tile that it may cover, where there is room."""
    record = records[number]
    columns = subpixels_of(record, 0, spot.left, spot.step)
    top, bottom = subpixels_of(record, 1, spot.top, spot.step)
    for row in range(top, bottom):
        bits = is_open[row] & ~is_full[row]
        if bits == np.uint32(0):
            continue
        line = line_of(record, spot, row)
        first, last = groups_of(record, line, spot, columns)
        for group in range(first, last):
            bit = np.uint32(1) << np.uint32(group)
            if bits & bit != np.uint32(0):
                _evaluate(lanes, line, record, (row, group), spot, opacity)
                base = row * SIDE + group * LANES
                if not _queue(waiting, (base, base), WAITING, canvas, lanes, number):
                    is_full[row] |= bit


@parallel_kernel
def paint_along_rays(
    counter: Counter,
    records: Floats,
    lists: TileLists,
    grid: TileGrid,
    near: float,
    opacity: Opacity,
    picture: PaintedShapes,
) -> None:
    """Paint all tiles, as `paint_shapes` does, but each ray in its own order."""
    canvas, is_open = np.empty(SIZE, np.float32), np.empty(SIDE, np.uint32)
    is_full, lanes = np.empty(SIDE, np.uint32), np.empty(2 * LANES, np.float32)
    waiting = ring_scratch(PLANE, WAITING)
    for tile in tasks(counter, lists.start.size - 1):
        origin, spot = tile_at(grid, tile, near)
        clear(canvas, is_open)
        is_full[:] = 0
        waiting.state[:] = 0
        waiting.front[:] = np.float32(np.inf)
        members, bound = _by_least_depth(records, lists, tile, spot)
        for k in range(members.size):
            _visit(waiting, canvas, is_open, is_full, records, members[k], spot, opacity, lanes)
            if k % SETTLED == SETTLED - 1:
                _settle(waiting, (0, PLANE), WAITING, canvas, bound[k + 1], records)
                if not close_groups(canvas, is_open):
                    break
        _settle(waiting, (0, PLANE), WAITING, canvas, np.inf, records)
        for row in range(SIDE):
            for group in range(GROUPS):
                if is_full[row] >> np.uint32(group) & np.uint32(1) != np.uint32(0):
                    at = row, group
                    _paint_group(records, members, bound, at, spot, opacity, lanes, canvas)
        write_tile(canvas, origin, grid.fine, picture)
