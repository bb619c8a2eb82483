"""Composite ellipsoids in the order of each ray: by the depth at which it passes their centers.

Each sub-pixel keeps the nearest of those that were not composited yet in a ring, in order. Members
of a tile come by the depth of their centers; when the ring is full, its nearest is composited. So a
ray's order is exact unless one of it comes more than `WAITING` members late.
"""

import numpy as np

from resample.engine.jit import inner_kernel, inner_step
from resample.engine.roles import plays
from resample.engine.shaped.canvas import (
    LANES,
    OPAQUE,
    PLANE,
    SHARE,
    SIDE,
    Line,
    Rings,
    TilePlace,
    lay,
)
from resample.engine.shaped.painting import (
    DepthOpacity,
    PeakOpacity,
    begin_tile,
    end_tile,
    meet,
    response_at,
    waiting_of,
)
from resample.engine.shaped.records import BLUE, GREEN, LIMIT, PEAK, RED
from resample.types import Floats, Single

WAITING = 32  # a power of two
LAST = WAITING - 1


@plays(waiting_of, object)
def _rings(most, records):  # type: ignore[no-untyped-def]  # noqa: ARG001
    ring, number = np.empty(2 * PLANE * WAITING, np.float32), np.empty(PLANE * WAITING, np.int32)
    state, lanes = np.empty(2 * PLANE, np.int32), np.empty(2 * LANES, np.float32)
    return ring, number, state, lanes, records


@plays(begin_tile, object)
def _begin(waiting):  # type: ignore[no-untyped-def]
    waiting[2][:] = 0


@inner_step
def _take(canvas: Floats, waiting: Rings, place: int, slot: int) -> None:
    """Composite what waits in a slot of a sub-pixel's ring."""
    ring, number, _, _, records = waiting
    k = place * WAITING + slot
    record = records[number[k]]
    light = record[RED], record[GREEN], record[BLUE]
    lay(canvas, np.uint64(place), ring[2 * k], ring[2 * k + 1], light)


@inner_step
def _wait(
    waiting: Rings, place: int, begin: int, count: int, alpha: Single, t: Single, member: int
) -> None:
    """Put an opacity at a depth into a sub-pixel's ring, in order."""
    ring, number = waiting[0], waiting[1]
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


@plays(meet, object)
def _offer(waiting, canvas, line, record, place, spot, opacity):  # type: ignore[no-untyped-def]
    row, group, number = place
    _evaluate(waiting[3], line, record, (row, group), spot, opacity)
    _queue(waiting, canvas, row * SIDE + group * LANES, number)


@inner_kernel
def _queue(waiting: Rings, canvas: Floats, base: int, member: int) -> None:
    """Let a record wait at eight sub-pixels, as `lanes` say."""
    state, lanes = waiting[2], waiting[3]
    for lane in range(LANES):
        place = base + lane
        alpha = lanes[lane]
        if alpha <= np.float32(0) or canvas[np.uint64(place) + SHARE] < OPAQUE:
            continue
        begin, count = state[2 * place], state[2 * place + 1]
        # A full ring composites its nearest.
        if count == WAITING:
            _take(canvas, waiting, place, begin)
            begin, count = (begin + 1) & LAST, count - 1
        _wait(waiting, place, begin, count, alpha, lanes[LANES + lane], member)
        state[2 * place], state[2 * place + 1] = begin, count + 1


@inner_step
def _evaluate(
    lanes: Floats,
    line: Line,
    record: Floats,
    at: tuple[int, int],
    spot: TilePlace,
    opacity: PeakOpacity | DepthOpacity,
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


@plays(end_tile, object)
def _finish(waiting, canvas):  # type: ignore[no-untyped-def]
    state = waiting[2]
    for place in range(PLANE):
        begin, count = state[2 * place], state[2 * place + 1]
        for n in range(count):
            if canvas[np.uint64(place) + SHARE] < OPAQUE:
                break
            _take(canvas, waiting, place, (begin + n) & LAST)
