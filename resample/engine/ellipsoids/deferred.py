"""Paint splats that are projected by the tiles which show them, run by run and nearest runs first.

A tile knows which runs of neighbouring samples it may show, and how near these come. It takes them
in that order, skips those that lie behind opaque sub-pixels only, and projects the samples of the
others. Of these it paints what is nearer than any run that it has not taken: the order is that of
all samples. So hidden runs cost next to nothing, and what is known of a sample never leaves the
cache. This is occlusion culling (Zhang, Manocha, Hudson and Hoff 1997) with the picture itself as
occlusion map.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import laid_out, pixel_weights
from resample.engine.ellipsoids.footprints import Eye, Shape, area_of, eye_of, shape_of
from resample.engine.ellipsoids.outlines import (
    BATCH,
    ROOM,
    Bounds,
    clip_batch,
    form_batch,
    meet_batch,
    outline_batch,
    sides_of,
)
from resample.engine.ellipsoids.pool import ask_for, enlarged, gather, part, put_in_order, take
from resample.engine.ellipsoids.rows import (
    Groups,
    Limits,
    Members,
    cast_rays_of_rows,
    close_rows,
    new_rows,
    open_rows,
    paint_cut_splat_on_rows,
    paint_splats_on_rows,
    resolve_rows,
)
from resample.engine.grid import grid
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.runs import finest_of, home_of, in_order, is_run_open, may_be_finer
from resample.engine.sorting import HALF, Pairs, bits_of, sort_pairs
from resample.types import (
    Doubles,
    Ellipsoid,
    Film,
    Floats,
    Place,
    Profile,
    Records,
    Samples,
    Screen,
    Style,
    Tables,
    Tiles,
    View,
)

WINDOW = 1024  # samples that a tile takes before it paints those that it can
SHORT_WINDOW = 64  # likewise where all of them are nearer than what is to come
AHEAD = 2  # runs after which one is looked at that is asked for
BETWEEN_LOOKS = 64  # splats painted before it is looked at again what is opaque by now

Indices = NDArray[np.int64]
Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels
Flags = NDArray[np.uint8]


@parallel_kernel
def find_spacings(
    counter: Counter,
    tiles: Tiles,
    runs: Records,
    start: Indices,
    samples: Samples,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
) -> None:
    """Fill in for all tiles a spacing that has the grid of the smallest one among its samples."""
    eye, shape, area = eye_of(view), shape_of(ellipsoid), area_of(screen)
    position, extinction = samples.position.reshape(-1), samples.extinction
    room = np.empty(ROOM, np.float32)
    for tile in tasks(counter, tiles.spacing.size):
        finest = np.inf
        for run in tiles.member[tiles.start[tile] : tiles.start[tile + 1]]:
            if may_be_finer(runs[run], finest, style):
                begin, count = start[run], start[run + 1] - start[run]
                outline_batch(
                    room,
                    position,
                    extinction,
                    begin,
                    count,
                    eye,
                    shape,
                    area,
                    style.faintest,
                    False,
                )
                if screen.planes.shape[0] > 0:
                    clip_batch(room, position, begin, count, eye, shape, screen.planes)
                finest = min(finest, finest_of(room, count, tile, tiles, screen.margin))
        tiles.spacing[tile] = finest


@kernel
def _form(
    ready: Pairs,
    room: Floats,
    samples: Samples,
    eye: Eye,
    shape: Shape,
    place: Place,
    height: int,
    width: int,
    home: Bounds,
    planes: Doubles,
) -> None:
    """Fill in batch after batch of samples."""
    position = np.empty(3 * BATCH, np.float32)
    for first in range(0, ready.size, BATCH):
        count, begin = min(BATCH, ready.size - first), first // BATCH * ROOM
        batch = room[begin : begin + ROOM]
        gather(ready[first : first + count], samples, position, batch)
        form_batch(batch, position, 0, count, eye, shape, place, height, width, home)
        if planes.shape[0] > 0:
            clip_batch(batch, position, 0, count, eye, shape, planes)


@kernel
def _paint_samples(
    rows: Floats,
    open_groups: Groups,
    room: Floats,
    offset: Members,
    place: Place,
    width: int,
    view: View,
    ellipsoid: Ellipsoid,
    planes: Doubles,
    partial: Floats,
    profile: Profile,
    peak: float,
    limits: Limits,
) -> int:
    """Paint samples in their order; gives how many are at home in the tile, if not hidden."""
    at_home, step = 0, np.float32(1.0 / place.subpixels)
    for first in range(0, offset.size, BETWEEN_LOOKS):
        if not close_rows(open_groups, rows, width, limits.opaque):
            break
        n, last = first, min(first + BETWEEN_LOOKS, offset.size)
        while n < last:
            painted, found = paint_splats_on_rows(
                rows, open_groups, room, offset[n:last], step, profile, peak, limits
            )
            at_home += found
            n += painted
            if n < last:
                at_home += paint_cut_splat_on_rows(
                    rows,
                    open_groups,
                    room,
                    offset[n],
                    place,
                    view,
                    ellipsoid,
                    planes,
                    partial,
                    limits,
                )
                n += 1
    return at_home


@parallel_kernel
def paint_runs(
    counter: Counter,
    turn: Indices,
    tiles: Tiles,
    runs: Records,
    start: Indices,
    samples: Samples,
    by_distance: bool,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
    tables: Tables,
    profile: Profile,
    peak: float,
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
        Whether samples are ordered by distance from the eye, or by depth.
    view, ellipsoid, screen, style, tables
        As for all painters.
    profile, peak
        Line integrals of the kernel, and the largest of all, scene units.
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
    for number in tasks(counter, turn.size):
        tile = turn[number]
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        n = grid(tiles.spacing[tile], style)
        tally[tile, 3] = n
        home, place, height, width = laid_out(
            tile, tiles.size, tiles.columns, n, tables.pixel_margin, screen
        )
        rows, open_groups = new_rows(height, width), open_rows(height, width)
        least_ray = cast_rays_of_rows(rows, height, width, place, view, ellipsoid)
        limits = Limits(
            np.float32(style.opaque),
            np.float32(1.0 / style.layer),
            np.float32(1.0) / least_ray,
        )
        bounds = home_of(home)
        in_order(runs, members)
        sides = sides_of(eye, shape, place, height, width)
        pair, pool = np.empty(BATCH, np.uint64), np.empty(8 * WINDOW, np.uint64)
        ready, other = np.empty_like(pool), np.empty_like(pool)
        room, offset = (
            np.empty(pool.size // BATCH * ROOM, np.float32),
            np.empty(pool.size, np.int32),
        )
        waiting, next_run, farthest, is_any_open = 0, 0, np.uint64(0), True
        while is_any_open and (next_run < members.size or waiting > 0):
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
                        by_distance,
                    )
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
            _form(
                ready[:count],
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
            put_in_order(ready[:count], room, offset)
            tally[tile, 1] += _paint_samples(
                rows,
                open_groups,
                room,
                offset[:count],
                place,
                width,
                view,
                ellipsoid,
                screen.planes,
                tables.partial,
                profile,
                peak,
                limits,
            )
            waiting = stay
            is_any_open = close_rows(open_groups, rows, width, limits.opaque)
        resolve_rows(rows, n, pixel_weights(tables, n), home, film)
