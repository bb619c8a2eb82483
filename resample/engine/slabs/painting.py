"""Paint tiles from runs of samples that are summed before they are composited.

As `resample.engine.ellipsoids.deferred`: a tile takes runs nearest first, skips those behind opaque
sub-pixels, and projects the samples of the others. What it sums are slabs that cut splats, of which
as many are open as a splat reaches over; sheets of whole splats, one after the other; or all
samples in one sum. A slab is composited when no splat that is still to come can reach it.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import laid_out, pixel_weights
from resample.engine.ellipsoids.deferred import (
    AHEAD,
    SHORT_WINDOW,
    WINDOW,
    _form,
)
from resample.engine.ellipsoids.footprints import eye_of, shape_of
from resample.engine.ellipsoids.outlines import BATCH, DEPTH, ROOM, meet_batch, sides_of
from resample.engine.ellipsoids.pool import ask_for, enlarged, part, put_in_order, take
from resample.engine.ellipsoids.rows import (
    COLUMNS,
    PAIR,
    RAY,
    Limits,
    Members,
    cast_rays_of_rows,
    close_rows,
    index_of,
    new_rows,
    open_rows,
    resolve_rows,
)
from resample.engine.grid import grid
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.roles import role
from resample.engine.runs import home_of, in_order, is_run_open
from resample.engine.slabs.blends import Blend, Colors, Values
from resample.engine.slabs.colors import composite_colors
from resample.engine.slabs.fields import (
    STATES,
    develop,
    new_state,
    resolve_value,
    take_in_values,
)
from resample.engine.slabs.integrals import WORK, Integral
from resample.engine.slabs.keys import end_of_sheet, key_by_sheets, sort_by_depth
from resample.engine.slabs.splats import Sight, Span, add_splats, sight_of
from resample.engine.slabs.sums import (
    Canvas,
    Cutting,
    Ring,
    Slab,
    aligned,
    empty,
    new_sums,
    no_dirt,
)
from resample.engine.sorting import HALF, bits_of, sort_pairs
from resample.types import (
    ADDITIVE,
    Ellipsoid,
    Film,
    Floats,
    Layers,
    Place,
    Records,
    Samples,
    Screen,
    Single,
    Style,
    Tables,
    Tiles,
    View,
)

PARTS, WHOLES, ALL = range(3)  # slabs cut splats; sheets of whole ones; one sum of all

Indices = NDArray[np.int64]
Flags = NDArray[np.uint8]
Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels


class Summed(NamedTuple):
    """What is summed before it is composited."""

    what: int  # PARTS, WHOLES or ALL
    layers: Layers  # slabs or sheets
    ring: Ring  # of slabs that are open at a time


class Sweep(NamedTuple):
    """Where a tile is: which slab is the first open one, and which one the last."""

    front: int
    slot: int
    behind: int
    is_open: bool


def _no_state(blend, height, width, cutting):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.zeros((0, 0, STATES), np.float32)


def _state_of_values(blend, height, width, cutting):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return new_state(height, width, cutting)


def _close_colors(blend, canvas, ring, slab, cutting, opaque):  # type: ignore[no-untyped-def]  # noqa: ARG001
    composite_colors(canvas, ring, slab.slot, opaque, blend.is_linear)


def _close_values(blend, canvas, ring, slab, cutting, opaque):  # type: ignore[no-untyped-def]
    take_in_values(blend, canvas, ring, slab, cutting, opaque)


def _finish_colors(blend, canvas, n, weight, home, value):  # type: ignore[no-untyped-def]
    pass


def _finish_values(blend, canvas, n, weight, home, value):  # type: ignore[no-untyped-def]
    if value.size > 0:
        develop(blend, canvas)
        resolve_value(canvas.state, n, weight, home, blend.projection == ADDITIVE, value)


_new_state = role({Colors: _no_state, Values: _state_of_values})
_close = role({Colors: _close_colors, Values: _close_values})
_finish = role({Colors: _finish_colors, Values: _finish_values})


@kernel
def _cast(
    rows: Floats,
    along: Floats,
    height: int,
    width: int,
    place: Place,
    camera: View,
    ellipsoid: Ellipsoid,
) -> Single:
    """Fill in |w|, 1 beyond the last column, where amplitudes are 0; gives the least 1 / |w|²."""
    least = cast_rays_of_rows(rows, height, width, place, camera, ellipsoid)
    for row in range(2 * ((height + 1) // 2)):
        for column in range(width + COLUMNS):
            k = index_of(row, column)
            is_inside = row < height and column < width
            along[k] = np.float32(1.0 / math.sqrt(rows[k + RAY])) if is_inside else np.float32(1.0)
    return least


@kernel
def _most_pairs(turn: Indices, tiles: Tiles, style: Style, margin: int) -> int:
    """Pairs of rows of the finest tile."""
    finest = 1
    for tile in turn:
        finest = max(finest, grid(tiles.spacing[tile], style))
    return ((tiles.size + 2 * margin) * finest + 1) // 2


@kernel
def _closed(
    blend: Blend,
    canvas: Canvas,
    summed: Summed,
    sweep: Sweep,
    until: int,
    cutting: Cutting,
    opaque: Single,
) -> Sweep:
    """Composite slabs before one that is reached next."""
    thickness, front, slot, is_any_open = summed.layers.thickness, sweep.front, sweep.slot, True
    while front < until and front <= sweep.behind:
        near, far = front * thickness, (front + 1) * thickness
        if summed.what != PARTS:
            near, far = -np.inf, np.inf
        _close(blend, canvas, summed.ring, Slab(front, slot, near, far), cutting, opaque)
        is_any_open = close_rows(canvas.open_groups, canvas.rows, canvas.width, opaque)
        front, slot = front + 1, (slot + 1) % summed.ring.slots
        if not is_any_open:
            break
    return Sweep(max(front, until), slot, sweep.behind, is_any_open)


@kernel
def _add(
    blend: Blend,
    canvas: Canvas,
    summed: Summed,
    sweep: Sweep,
    room: Floats,
    offset: Members,
    reach: float,
    sight: Sight,
    limits: Limits,
    integral: Integral,
    cutting: Cutting,
) -> tuple[Sweep, int]:
    """Add samples in their order, and composite slabs that no more of them reach."""
    at_home, n, thickness = 0, 0, summed.layers.thickness
    is_cutting = summed.what == PARTS
    while n < offset.size and sweep.is_open:
        if is_cutting:
            depth = float(room[np.uint64(offset[n]) + DEPTH])
            first = math.floor((depth - reach) / thickness)
            sweep = _closed(blend, canvas, summed, sweep, first, cutting, limits.opaque)
            if not sweep.is_open:
                break
        span = Span(sweep.front, sweep.slot, summed.ring, thickness, reach)
        count, found, behind = add_splats(
            canvas, room, offset[n:], span, sight, limits, integral, blend, cutting, is_cutting
        )
        n, at_home = n + count, at_home + found
        sweep = Sweep(sweep.front, sweep.slot, max(sweep.behind, behind), True)
    return sweep, at_home


@parallel_kernel
def paint_summed_runs(
    counter: Counter,
    turn: Indices,
    tiles: Tiles,
    runs: Records,
    start: Indices,
    samples: Samples,
    by_distance: bool,  # noqa: ARG001
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    integral: Integral,
    summed: Summed,
    blend: Blend,
    value: Floats,
    film: Film,
    taken: Flags,
    tally: Tally,
) -> None:
    """Paint the tiles listed in `turn`, of which each knows the runs that it may show.

    Parameters
    ----------
    turn
        Numbers of tiles that have members.
    tiles
        Whose members are runs.
    runs, start
        Runs (R,), and where the samples of each begin, (R + 1,); at most BATCH in one.
    samples
        N samples, of which each run has some that follow each other.
    by_distance
        Not looked at.
    view, ellipsoid, screen, style, tables
        As for all painters.
    integral
        Line integrals of the kernel.
    summed, blend
        What is summed, and how sums are composited.
    value
        (H, W) what projections of fields measure; or nothing.
    film
        (H, W) written to.
    taken
        (R,) set to 1 for runs whose samples were looked at.
    tally
        (T, 4) numbers of splats painted by the tiles that hold their centers, and grids.
    """
    eye, shape = eye_of(view), shape_of(ellipsoid)
    position, extinction = samples.position.reshape(-1), samples.extinction
    color = samples.color.reshape(-1)
    reach, faintest = math.sqrt(shape.covariance[2][2]), np.float32(style.faintest)
    pairs = _most_pairs(turn, tiles, style, tables.pixel_margin)
    work, sums = aligned(WORK), new_sums(summed.ring, pairs)
    along, dirty = np.empty(pairs * PAIR, np.float32), no_dirt(summed.ring.slots)
    pair, pool = np.empty(BATCH, np.uint64), np.empty(8 * WINDOW, np.uint64)
    ready, other = np.empty_like(pool), np.empty_like(pool)
    room, offset = (
        np.empty(pool.size // BATCH * ROOM, np.float32),
        np.empty(pool.size, np.int32),
    )
    for number in tasks(counter, turn.size):
        tile = turn[number]
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        n = grid(tiles.spacing[tile], style)
        tally[tile, 3] = n
        home, place, height, width = laid_out(
            tile, tiles.size, tiles.columns, n, tables.pixel_margin, screen
        )
        rows, open_groups = new_rows(height, width), open_rows(height, width)
        least_ray = _cast(rows, along, height, width, place, view, ellipsoid)
        limits = Limits(
            np.float32(style.opaque),
            np.float32(1.0 / style.layer),
            np.float32(1.0) / least_ray,
        )
        cutting = Cutting(place, view, ellipsoid, screen.planes, tables.partial)
        canvas = Canvas(
            rows,
            open_groups,
            along,
            sums,
            dirty,
            work,
            _new_state(blend, height, width, cutting),
            height,
            width,
        )
        bounds, sight = home_of(home), sight_of(eye, shape, place)
        in_order(runs, members)
        sides = sides_of(eye, shape, place, height, width)
        waiting, next_run, farthest = 0, 0, np.uint64(0)
        sweep = Sweep(-(1 << 60) if summed.what == PARTS else 0, 0, -(1 << 60), True)
        while sweep.is_open and (next_run < members.size or waiting > 0):
            before = waiting
            while next_run < members.size and waiting < before + WINDOW:
                run = members[next_run]
                if (
                    waiting >= before + SHORT_WINDOW
                    and bits_of(runs[run]["key"]) > farthest >> HALF
                ):
                    break
                next_run += 1
                if next_run + AHEAD < members.size:
                    soon = members[next_run + AHEAD]
                    ask_for(position, extinction, color, start[soon], start[soon + 1] - start[soon])
                if is_run_open(runs[run], place, height, width, open_groups):
                    taken[run] = 1
                    begin, count = start[run], start[run + 1] - start[run]
                    if waiting + count >= pool.size:
                        pool = enlarged(pool)
                    meet_batch(
                        pair,
                        position,
                        extinction,
                        begin,
                        count,
                        eye,
                        reach,
                        sides,
                        faintest,
                        False,
                    )
                    if summed.what == WHOLES:
                        key_by_sheets(pair, position, begin, count, summed.layers, eye)
                    waiting, farthest = take(pool, waiting, pair, count, farthest)
            if ready.size < pool.size:
                ready, other = np.empty_like(pool), np.empty_like(pool)
                offset = np.empty(pool.size, np.int32)
                room = np.empty(pool.size // BATCH * ROOM, np.float32)
            limit = np.float32(np.inf)
            if next_run < members.size:
                limit = runs[members[next_run]]["key"]
            stay = part(pool, waiting, limit, ready)
            count = waiting - stay
            sort_pairs(ready[:count], other[:count])
            first = 0
            while first < count and sweep.is_open:
                last = count
                if summed.what == WHOLES:
                    last = end_of_sheet(ready[:count], first)
                    sort_by_depth(ready[first:last], other[first:last], position, eye)
                _form(
                    ready[first:last],
                    room,
                    samples,
                    eye,
                    shape,
                    place,
                    height,
                    width,
                    bounds,
                    screen.planes,
                )
                put_in_order(ready[first:last], room, offset)
                sweep, at_home = _add(
                    blend,
                    canvas,
                    summed,
                    sweep,
                    room,
                    offset[: last - first],
                    reach,
                    sight,
                    limits,
                    integral,
                    cutting,
                )
                tally[tile, 1] += at_home
                if summed.what == WHOLES:
                    sweep = _closed(
                        blend, canvas, summed, sweep, sweep.front + 1, cutting, limits.opaque
                    )
                first = last
            waiting = stay
        if sweep.is_open:
            _closed(blend, canvas, summed, sweep, sweep.behind + 1, cutting, limits.opaque)
        empty(sums, dirty, summed.ring)
        weight = pixel_weights(tables, n)
        _finish(blend, canvas, n, weight, home, value)
        resolve_rows(rows, n, weight, home, film)
