"""Paint splats that are projected by the tiles which show them, run by run and nearest runs first.

A tile knows which runs of neighbouring samples it may show, and how near these come. It takes them
in that order, skips those that lie behind opaque sub-pixels only, and projects the samples of the
others. Of these it paints what is nearer than any run that it has not taken: the order is that of
all samples. So hidden runs cost next to nothing, and what is known of a sample never leaves the
cache. This is occlusion culling (Zhang, Manocha, Hudson and Hoff 1997) with the picture itself as
occlusion map.
"""

import numpy as np
from numpy.typing import NDArray

from resample.kernels.canvas import Home, laid_out, pixel_weights
from resample.kernels.footprints import area_of, eye_of, shape_of
from resample.kernels.grid import grid
from resample.kernels.jit import Counter, kernel, parallel_kernel, tasks
from resample.kernels.outlines import (
    BOTTOM,
    CUT,
    DEPTH,
    KEY,
    LEFT,
    RIGHT,
    ROOM,
    SPACING,
    TOP,
    A,
    B,
    C,
    X,
    Y,
    clip_batch,
    form_batch,
    outline_batch,
)
from resample.kernels.rows import (
    Groups,
    Limits,
    Span,
    Splat,
    cast_rays_of_rows,
    close_rows,
    is_open,
    new_rows,
    open_rows,
    paint_cut_splat_on_rows,
    paint_splat_on_rows,
    resolve_rows,
)
from resample.kernels.sorting import bits_of, end_of_ties, settle, sort_by_key
from resample.kernels.splats import first_inside, last_inside
from resample.kernels.tiles import tiles_met
from resample.types import (
    Doubles,
    Ellipsoid,
    Film,
    Floats,
    Place,
    Profile,
    Record,
    Records,
    Samples,
    Screen,
    Single,
    Style,
    Tables,
    Tiles,
    View,
)

WINDOW = 1024  # samples that a tile takes before it paints those that it can
SHORT_WINDOW = 64  # likewise where all of them are nearer than what is to come
BETWEEN_LOOKS = 64  # splats painted before it is looked at again what is opaque by now

# A sample that waits to be painted, as a row of numbers; those up to P_BLUE say what comes first of
# samples that are equally near.
P_Y, P_X, P_A, P_B, P_C, P_EXTINCTION, P_RED, P_GREEN, P_BLUE, P_DEPTH, P_KEY = range(11)
P_TOP, P_BOTTOM, P_LEFT, P_RIGHT, P_CUT, NUMBERS = range(11, 17)

Indices = NDArray[np.int64]
Members = NDArray[np.int32]
Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels
Flags = NDArray[np.uint8]
Bounds = tuple[Single, Single, Single, Single]  # px: left, right, top, bottom


@kernel
def count_runs(runs: Records, screen: Screen, size: int, columns: int, count: Indices) -> None:
    """Add to `count` (T,) how many runs each tile of `size` px may show."""
    rows = count.size // columns
    for n in range(runs.size):
        run = runs[n]
        if run["seen"] > 0:
            left, right = tiles_met(run["left"], run["right"], screen.margin, size, columns)
            top, bottom = tiles_met(run["top"], run["bottom"], screen.margin, size, rows)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    count[row * columns + column] += 1


@kernel
def deal_runs(runs: Records, screen: Screen, tiles: Tiles, load: Indices) -> None:
    """Write each tile's runs, and add to `load` (T,) how many samples these have."""
    size, columns, member = tiles.size, tiles.columns, tiles.member
    rows, position = load.size // columns, tiles.start[:-1].copy()
    for n in range(runs.size):
        run = runs[n]
        if run["seen"] > 0:
            left, right = tiles_met(run["left"], run["right"], screen.margin, size, columns)
            top, bottom = tiles_met(run["top"], run["bottom"], screen.margin, size, rows)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    tile = row * columns + column
                    member[position[tile]] = n
                    position[tile] += 1
                    load[tile] += run["seen"]


@kernel
def _find_spacing(
    tile: int,
    tiles: Tiles,
    runs: Records,
    start: Indices,
    samples: Samples,
    view: View,
    ellipsoid: Ellipsoid,
    screen: Screen,
    style: Style,
) -> None:
    eye, shape, area = eye_of(view), shape_of(ellipsoid), area_of(screen)
    position, extinction = samples.position.reshape(-1), samples.extinction
    room, size, columns = np.empty(ROOM, np.float32), tiles.size, tiles.columns
    tile_rows, finest = tiles.spacing.size // columns, np.inf
    for m in range(tiles.start[tile], tiles.start[tile + 1]):
        run = tiles.member[m]
        if grid(runs[run]["least_spacing"], style) <= grid(finest, style) and finest < np.inf:
            continue
        begin, count = start[run], start[run + 1] - start[run]
        outline_batch(
            room, position, extinction, begin, count, eye, shape, area, style.faintest, False
        )
        if screen.planes.shape[0] > 0:
            clip_batch(room, position, begin, count, eye, shape, screen.planes)
        for n in range(count):
            k = np.uint64(n)
            if room[k + LEFT] <= room[k + RIGHT]:
                left, right = tiles_met(
                    room[k + LEFT], room[k + RIGHT], screen.margin, size, columns
                )
                top, bottom = tiles_met(
                    room[k + TOP], room[k + BOTTOM], screen.margin, size, tile_rows
                )
                if left <= tile % columns <= right and top <= tile // columns <= bottom:
                    finest = min(finest, float(room[k + SPACING]))
    tiles.spacing[tile] = finest


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
    for tile in tasks(counter, tiles.spacing.size):
        _find_spacing(
            tile,
            tiles,
            runs,
            start,
            samples,
            view,
            ellipsoid,
            screen,
            style,
        )


@kernel
def _take(
    pool: Floats,
    row: Members,
    waiting: int,
    room: Floats,
    begin: int,
    count: int,
    extinction: Floats,
    color: Floats,
    faintest: Single,
    farthest: Single,
) -> tuple[int, Single]:
    """Put those samples of a batch in the pool that touch the tile.

    Takes and gives how many are in it, and the largest of their keys. They lie in those rows of the
    pool that the first numbers of `row` say; the others say which rows are free.
    """
    for n in range(count):
        k, sample = np.uint64(n), begin + n
        left, right, top, bottom = room[k + LEFT], room[k + RIGHT], room[k + TOP], room[k + BOTTOM]
        if left > right or top > bottom or not extinction[sample] > faintest:
            continue
        m = row[waiting]
        pool[m, P_Y], pool[m, P_X] = room[k + Y], room[k + X]
        pool[m, P_A] = room[k + A]
        pool[m, P_B] = room[k + B]
        pool[m, P_C] = room[k + C]
        pool[m, P_EXTINCTION] = extinction[sample]
        pool[m, P_RED] = color[sample, 0]
        pool[m, P_GREEN] = color[sample, 1]
        pool[m, P_BLUE] = color[sample, 2]
        pool[m, P_DEPTH] = room[k + DEPTH]
        pool[m, P_KEY] = room[k + KEY]
        pool[m, P_TOP] = top
        pool[m, P_BOTTOM] = bottom + np.float32(1.0)
        pool[m, P_LEFT] = left
        pool[m, P_RIGHT] = right + np.float32(1.0)
        pool[m, P_CUT] = room[k + CUT]
        farthest = max(farthest, room[k + KEY])
        waiting += 1
    return waiting, farthest


@kernel
def _enlarged(pool: Floats, row: Members) -> tuple[Floats, Members]:
    """Pool of twice as many rows, the new ones free."""
    size = row.size
    larger, more = np.empty((2 * size, NUMBERS), np.float32), np.empty(2 * size, np.int32)
    for n in range(size):
        more[n], more[size + n] = row[n], size + n
        for number in range(NUMBERS):
            larger[n, number] = pool[n, number]
    return larger, more


@kernel
def _is_run_open(run: Record, place: Place, height: int, width: int, open_groups: Groups) -> bool:
    """Whether a run may be seen on a canvas of `height` rows and `width` columns."""
    n = place.subpixels
    left = first_inside(run["left"], place.x, n)
    right = last_inside(run["right"], place.x, n, width)
    top = first_inside(run["top"], place.y, n)
    bottom = last_inside(run["bottom"], place.y, n, height)
    return left < right and top < bottom and is_open(open_groups, top, bottom, left, right)


@kernel
def _part(pool: Floats, row: Members, waiting: int, limit: Single, number: Members) -> int:
    """Move samples that are nearer than `limit` from `row` to `number`; gives how many stay."""
    stay = ready = 0
    for n in range(waiting):
        m = row[n]
        if pool[m, P_KEY] < limit or limit == np.inf:
            number[ready] = m
            ready += 1
        else:
            row[stay] = m
            stay += 1
    for n in range(ready):  # free, once they are painted
        row[stay + n] = number[n]
    return stay


@kernel
def _put_in_order(pool: Floats, number: Members) -> None:
    """Put samples of the pool in painting order."""
    key, count = np.empty(number.size, np.uint32), number.size
    for n in range(count):
        key[n] = bits_of(pool[number[n], P_KEY])
    sort_by_key(key, number)
    start = 0
    while start < count:
        end = end_of_ties(key, start)
        if end - start > 1:
            settle(number[start:end], pool[:, : P_BLUE + 1])
        start = end


@kernel
def _home_of(home: Home) -> Bounds:
    """Where centers of samples belong to a tile; tiles at the frame's edge have all beyond it."""
    far = np.float32(np.inf)
    right, bottom = home.left + home.size, home.top + home.size
    return (
        np.float32(home.left) if home.left > 0 else -far,
        np.float32(right) if right < home.width else far,
        np.float32(home.top) if home.top > 0 else -far,
        np.float32(bottom) if bottom < home.height else far,
    )


@kernel
def _paint_samples(
    number: Members,
    pool: Floats,
    rows: Floats,
    open_groups: Groups,
    place: Place,
    width: int,
    bounds: Bounds,
    view: View,
    ellipsoid: Ellipsoid,
    planes: Doubles,
    partial: Floats,
    profile: Profile,
    peak: float,
    limits: Limits,
) -> int:
    """Paint samples of the pool in their order; gives how many have their center within bounds."""
    at_home, step, half = 0, np.float32(1.0 / place.subpixels), 0.5 / place.subpixels
    first_x, last_x, first_y, last_y = bounds
    for n in range(number.size):
        if n % BETWEEN_LOOKS == 0 and not close_rows(open_groups, rows, width, limits.opaque):
            break
        m = number[n]
        top, bottom = int(pool[m, P_TOP]), int(pool[m, P_BOTTOM])
        left, right = int(pool[m, P_LEFT]), int(pool[m, P_RIGHT])
        if not is_open(open_groups, top, bottom, left, right):
            continue
        x, y = pool[m, P_X], pool[m, P_Y]
        at_home += 1 if (x >= first_x) & (x < last_x) & (y >= first_y) & (y < last_y) else 0
        splat = Splat(
            pool[m, P_A],
            pool[m, P_B],
            pool[m, P_C],
            pool[m, P_EXTINCTION],
            pool[m, P_RED],
            pool[m, P_GREEN],
            pool[m, P_BLUE],
            pool[m, P_DEPTH],
        )
        across, down = np.float32(place.x + half - x), np.float32(place.y + half - y)
        span = Span(top, bottom, left, right, across, down, step)
        if pool[m, P_CUT] > 0.0:
            paint_cut_splat_on_rows(
                rows, splat, span, place, view, ellipsoid, planes, partial, limits
            )
            continue
        is_thin = splat.extinction * peak <= 1.0
        paint_splat_on_rows(rows, open_groups, splat, span, profile, limits, is_thin)
    return at_home


@kernel
def _in_order(runs: Records, members: Members) -> None:
    """Put runs in order of their nearest samples."""
    key = np.empty(members.size, np.uint32)
    for n in range(members.size):
        key[n] = bits_of(runs[members[n]]["key"])
    sort_by_key(key, members)


@kernel
def _paint_tile(
    tile: int,
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
    members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
    if members.size == 0:
        return
    n = grid(tiles.spacing[tile], style)
    tally[tile, 3] = n
    home, place, height, width = laid_out(
        tile, tiles.size, tiles.columns, n, tables.pixel_margin, screen
    )
    eye, shape = eye_of(view), shape_of(ellipsoid)
    position, extinction, color = (
        samples.position.reshape(-1),
        samples.extinction,
        samples.color,
    )
    rows, open_groups = new_rows(height, width), open_rows(height, width)
    least_ray = cast_rays_of_rows(rows, height, width, place, view, ellipsoid)
    limits = Limits(
        np.float32(style.opaque),
        np.float32(1.0 / style.layer),
        np.float32(1.0) / least_ray,
    )
    bounds = _home_of(home)
    _in_order(runs, members)
    room, pool = np.empty(ROOM, np.float32), np.empty((8 * WINDOW, NUMBERS), np.float32)
    row = np.empty(pool.shape[0], np.int32)
    for m in range(row.size):
        row[m] = m
    far, faintest = np.float32(np.inf), np.float32(style.faintest)
    waiting, next_run, farthest, is_any_open = 0, 0, -far, True
    while is_any_open and (next_run < members.size or waiting > 0):
        before = waiting
        while next_run < members.size and waiting < before + WINDOW:
            run = members[next_run]
            if waiting >= before + SHORT_WINDOW and runs[run]["key"] > farthest:
                break
            next_run += 1
            if _is_run_open(runs[run], place, height, width, open_groups):
                taken[run] = 1
                begin, count = start[run], start[run + 1] - start[run]
                if waiting + count > row.size:
                    pool, row = _enlarged(pool, row)
                form_batch(
                    room, position, begin, count, eye, shape, place, height, width, by_distance
                )
                if screen.planes.shape[0] > 0:
                    clip_batch(room, position, begin, count, eye, shape, screen.planes)
                waiting, farthest = _take(
                    pool, row, waiting, room, begin, count, extinction, color, faintest, farthest
                )
        limit = far if next_run == members.size else runs[members[next_run]]["key"]
        number = np.empty(waiting, np.int32)
        stay = _part(pool, row, waiting, limit, number)
        number = number[: waiting - stay]
        _put_in_order(pool, number)
        tally[tile, 1] += _paint_samples(
            number,
            pool,
            rows,
            open_groups,
            place,
            width,
            bounds,
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
        Numbers of tiles.
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
    for place in tasks(counter, turn.size):
        _paint_tile(
            turn[place],
            tiles,
            runs,
            start,
            samples,
            by_distance,
            view,
            ellipsoid,
            screen,
            style,
            tables,
            profile,
            peak,
            film,
            taken,
            tally,
        )
