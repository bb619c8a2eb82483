"""Paint points that each tile projects for itself, nearest runs first.

As `resample.engine.mixtures.deferred`, for scenes of points only. Points are summed sheet by
sheet, so they need no order among themselves: a tile takes a run of neighbours, adds its points to
the sheets they lie in, and composites the sheets that no later run can reach.
"""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.footprints import Eye
from resample.engine.ellipsoids.outlines import BATCH, NO_REACH, Bounds, OutlineSetup, outline_setup
from resample.engine.ellipsoids.rows import (
    DEEPEST,
    E1,
    E2,
    E3,
    E4,
    E5,
    PER_DEEPEST,
    close_rows,
    new_rows,
    open_rows,
    resolve_rows,
)
from resample.engine.ellipsoids.runs import home_of, in_order, is_run_open
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.points.cells import (
    LINE,
    ROUND,
    ROUND_WEIGHT,
    SLOTS,
    Dirty,
    Ring,
    Scales,
    close_sheet,
    empty_sheet,
    no_dirt,
    touch,
)
from resample.engine.points.octets import spread
from resample.engine.points.outlines import is_clipped, projected, spacing_on_grid, squared_spacing
from resample.engine.subpixels import laid_out, pixel_weights, point_width
from resample.types import (
    Doubles,
    Film,
    Floats,
    Place,
    Profile,
    Record,
    Runs,
    Single,
    Spread,
    Stage,
    Tiles,
)

MOST_TAPS = 8  # sub-pixels along a row and a column that a point is spread over, at most
OCCLUSION_INTERVAL = 8  # sheets composited between occlusion checks

# Columns of a batch: offsets from the point to the center of its first sub-pixel, that sub-pixel's
# row and column, sheet, 1 / radius of the filter, amounts, sums of weights, home flag, weights.
X, Y, ROW, COLUMN, SHEET, PER_REACH, AMOUNT, BEHIND, COVER, TOTAL_X, TOTAL_Y, HOME, ACROSS = (
    np.uint64(number * BATCH) for number in range(13)
)
DOWN = ACROSS + np.uint64(MOST_TAPS * BATCH)
SCRATCH_SIZE = (13 + 2 * MOST_TAPS) * BATCH
STEP = np.uint64(BATCH)
NOWHERE = 1e9  # column of a sample that is not painted

Indices = NDArray[np.int64]
Tally = NDArray[np.int64]  # (T, 4) or one row of it: points, splats, hidden, sub-pixels


@kernel
def place_points(
    scratch: Doubles,
    position: Floats,
    extinction: Floats,
    begin: int,
    count: int,
    sight: OutlineSetup,
    own: tuple[Place, Bounds],
    form: Spread,
) -> None:
    """Project `count` samples from `begin` on to a canvas, and compute their amounts.

    `own` is the canvas of the tile, and the bounds of the centers that it counts as its own, px.
    """
    # Constants of all samples.
    (eye, shape, view_area), layers, _, faintest = sight
    place, bounds = own
    n_side = float(place.subpixels)
    layer, one, two = np.float32(form.layer), np.float32(1.0), np.float32(2.0)
    extent, variance = np.float32(form.extent), np.float32(form.variance)
    thinnest = np.float32(1.0 / 12.0)
    scale = np.float32(shape.volume * eye.fx * eye.fy * n_side * n_side / (form.layer * form.area))
    per_opacity = np.float32(form.area / form.opacity)
    on_grid = spacing_on_grid(eye, shape, n_side)
    first_x, last_x, first_y, last_y = bounds
    low, per_side = -view_area.margin, 1.0 / n_side
    high_x, high_y = view_area.width + view_area.margin, view_area.height + view_area.margin
    for n in range(count):
        k = np.uint64(n)
        sample = np.uint64(begin) + k
        # Project the center, and measure the spacing on the tile's grid.
        center, key, per_z, (x, y) = projected(position, sample, eye, layers)
        squared, right, down = squared_spacing(center, per_z, eye, on_grid)
        near = np.float32(per_z)
        # Radius of the filter, slant of the ray, sheet, and area in sub-pixels.
        reach = extent * np.sqrt(variance * squared + thinnest)
        oblique = np.sqrt(one + right * right + down * down)
        sheet = np.floor(key / layer)
        area = scale * near * near
        # Opacity 1 - exp(-x) = -expm1(-x), with expm1(2x) = expm1(x) (expm1(x) + 2) up to 16 x.
        t = max(DEEPEST, -extinction[sample] * layer * oblique) * PER_DEEPEST
        t2 = t * t
        fall = t * ((one + t * E1) + t2 * ((E2 + t * E3) + t2 * (E4 + t * E5)))
        fall *= fall + two
        fall *= fall + two
        fall *= fall + two
        fall *= fall + two
        amount = -fall * area * per_opacity
        # Decide whether it is painted, and whether the tile counts it as its own.
        is_painted = extinction[sample] > faintest
        pad = reach * per_side
        is_home = (x >= first_x) & (x < last_x) & (y >= first_y) & (y < last_y) & is_painted
        is_home &= (x + pad >= low) & (x - pad <= high_x) & (y + pad >= low) & (y - pad <= high_y)
        scratch[k + HOME] = 1.0 if is_home else 0.0
        # Find its first sub-pixel, and write the columns.
        x, y = (x - place.x) * n_side, (y - place.y) * n_side
        column, row = np.floor(x - reach + 0.5), np.floor(y - reach + 0.5)
        scratch[k + X] = column + 0.5 - x
        scratch[k + Y] = row + 0.5 - y
        scratch[k + COLUMN] = column if is_painted else NOWHERE
        scratch[k + ROW] = row
        scratch[k + PER_REACH] = one / reach
        scratch[k + SHEET] = sheet
        scratch[k + AMOUNT] = amount
        scratch[k + BEHIND] = amount * (np.float32(center[2]) / layer - sheet)
        scratch[k + COVER] = area


@kernel
def drop_clipped(
    scratch: Doubles, position: Floats, begin: int, count: int, eye: Eye, planes: Doubles
) -> None:
    """Drop samples from a batch whose centers lie beyond a clipping plane (M, 5)."""
    for n in range(count):
        if is_clipped(position, begin + n, eye, planes):
            k = np.uint64(n)
            scratch[k + COLUMN], scratch[k + HOME] = NOWHERE, 0.0


@kernel
def _weigh(
    scratch: Doubles,
    offset: np.uint64,
    to: np.uint64,
    total: np.uint64,
    count: int,
    taps: int,
    profile: Profile,
) -> None:
    """Compute weights of the sub-pixels around the points along one axis, and their sums."""
    p0, p1, p2, p3, p4, p5, p6, p7, p8 = profile
    one, zero = np.float32(1.0), np.float32(0.0)
    # Samples in the inner loop, so that it becomes lanes.
    for tap in range(taps):
        column, is_first = to + np.uint64(tap) * STEP, tap == 0
        for n in range(count):
            k = np.uint64(n)
            # Evaluate the filter, a polynomial in the squared distance, by Estrin's scheme.
            distance = np.float32((scratch[k + offset] + tap) * scratch[k + PER_REACH])
            v = distance * distance
            v2 = v * v
            v4 = v2 * v2
            weight = (p0 + v * p1) + v2 * (p2 + v * p3)
            weight += v4 * ((p4 + v * p5) + v2 * (p6 + v * p7)) + v4 * (v4 * p8)
            # Round to whole quanta, so that sums do not depend on their order.
            rounded = (float(weight if v < one else zero) + ROUND_WEIGHT) - ROUND_WEIGHT
            scratch[k + column] = rounded
            scratch[k + total] = rounded if is_first else scratch[k + total] + rounded


@kernel
def _share_out(scratch: Doubles, count: int) -> None:
    """Normalize amounts by the sums of weights."""
    for n in range(count):
        k = np.uint64(n)
        share = 1.0 / (scratch[k + TOTAL_X] * scratch[k + TOTAL_Y])
        scratch[k + AMOUNT] *= share
        scratch[k + BEHIND] *= share
        scratch[k + COVER] *= share


@kernel
def _fill_lines(amount: Doubles, scratch: Doubles, color: Floats, begin: int, count: int) -> None:
    """Write the eight amounts of each sample: the last two stay 0."""
    for n in range(count):
        k, line, sample = np.uint64(n), np.uint64(LINE * n), np.uint64(begin + n)
        # Opacity, colors times it, depth behind the sheet's front, and coverage.
        opacity = scratch[k + AMOUNT]
        amount[line] = opacity
        amount[line + np.uint64(1)] = opacity * color[sample, 0]
        amount[line + np.uint64(2)] = opacity * color[sample, 1]
        amount[line + np.uint64(3)] = opacity * color[sample, 2]
        amount[line + np.uint64(4)] = scratch[k + BEHIND]
        amount[line + np.uint64(5)] = scratch[k + COVER]


@kernel
def _spread_points(
    cells: Doubles,
    dirty: Dirty,
    ring: Ring,
    scratch: Doubles,
    amount: Doubles,
    count: int,
    taps: int,
    nearest: tuple[int, int],
) -> int:
    """Add a batch to the open sheets, from the nearest in its slot on; return the last touched."""
    front, slot = nearest
    pitch, behind = LINE * ring.columns, front
    low_row = low_column = 1 << 30
    high_row = high_column = 0
    # Skip points whose filter misses the canvas and its margin.
    for n in range(count):
        k = np.uint64(n)
        row, column = int(scratch[k + ROW]) + ring.around, int(scratch[k + COLUMN]) + ring.around
        if row < 0 or row + taps > ring.rows or column < 0 or column + taps > ring.columns:
            continue
        sheet = int(scratch[k + SHEET])
        # Points beside the view have no part in the run's key, and may lie in any sheet.
        if sheet < front or sheet >= front + SLOTS:
            continue
        # Extend the dirty rectangle of the batch.
        behind = max(behind, sheet)
        low_row, high_row = min(low_row, row), max(high_row, row)
        low_column, high_column = min(low_column, column), max(high_column, column)
        # Find the slot of the sheet in the ring, and spread the point.
        place = slot + sheet - front
        place -= SLOTS if place >= SLOTS else 0
        first = LINE * ((place * ring.rows + row) * ring.columns + column)
        around = (n + int(ACROSS), n + int(DOWN), BATCH, taps)
        spread(cells, (first, pitch), amount, LINE * n, ROUND, scratch, around)
    # Mark the rectangle in all sheets that the batch may have touched.
    if high_row + 1 > low_row:
        for sheet in range(front, behind + 1):
            place = (slot + sheet - front) % SLOTS
            touch(dirty, place, low_row, high_row + taps, low_column, high_column + taps)
    return behind


@kernel
def _taps(form: Spread, n: int) -> int:
    """Sub-pixels along an axis that a point is spread over, at most."""
    width = float(point_width(form.most_spacing * n, form.variance))
    return math.ceil(2.0 * form.extent * width)


@kernel
def _scales(form: Spread, sheet: int) -> Scales:
    return Scales(
        np.float32(form.opacity),
        np.float32(form.area),
        np.float32(sheet * form.layer),
        np.float32(form.layer),
    )


@kernel
def _sheet_of(run: Record, layer: Single) -> int:
    """Number of the nearest sheet that a run reaches."""
    sheet: int = math.floor(run["key"] / layer)
    return sheet


@parallel_kernel
def paint_point_runs(
    counter: Counter,
    tile_order: Indices,
    tiles: Tiles,
    runs: Runs,
    stage: Stage,
    profile: Profile,
    form: Spread,
    output: tuple[Film, Tally],
) -> None:
    """Paint the tiles listed in `tile_order` from the runs that each may show.

    A run at a time: close the sheets in front of it, check occlusion, cull it, project its points,
    weigh the sub-pixels around them, and add them to their sheets.

    `tile_order`: numbers of tiles, all of which have members. `tiles`: their members are runs.
    `runs`: at most BATCH samples in each, which span at most SLOTS - 1 sheets. `stage`: as for all
    painters; its layers are of depth, or around the eye. `profile`, `form`: filter of points as a
    polynomial in the squared distance, and how they are spread. `output`: film (H, W), filled; and
    a tally (T, 4), filled: points painted by the tiles that hold their centers, and grids.
    """
    sight, planes, size = outline_setup(stage, NO_REACH), stage.screen.planes, form.cells
    samples, start, known = runs.samples, runs.start, runs.known
    film, tally = output
    position, extinction = samples.position.reshape(-1), samples.extinction
    layer, opaque = np.float32(form.layer), np.float32(stage.style.opaque)
    cells = np.zeros(SLOTS * size * size * 8, np.float64)
    scratch, amount = np.empty(SCRATCH_SIZE, np.float64), np.zeros(LINE * BATCH, np.float64)
    for k in tasks(counter, tile_order.size):
        tile = tile_order[k]
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        home, place, height, width = laid_out(tile, tiles, stage)
        tally[tile, 3] = n = place.subpixels
        own = (place, home_of(home))
        rows, open_groups = new_rows(height, width), open_rows(height, width)
        taps = _taps(form, n)
        ring = Ring(height + 2 * taps, width + 2 * taps, taps)
        dirty = no_dirt(ring)
        in_order(known, members)
        front = _sheet_of(known[members[0]], layer)
        slot, behind, next_look, is_any_open = 0, front - 1, front + OCCLUSION_INTERVAL, True
        # Take the tile's runs nearest first.
        for m in range(members.size):
            run = members[m]
            sheet = _sheet_of(known[run], layer)
            while front < sheet and front <= behind:
                scales = _scales(form, front)
                close_sheet(cells, dirty, slot, ring, scales, rows, opaque)
                slot, front = (slot + 1) % SLOTS, front + 1
            front = sheet
            if front >= next_look:
                next_look = front + OCCLUSION_INTERVAL
                is_any_open = close_rows(open_groups, rows, width, opaque)
                if not is_any_open:
                    break
            if is_run_open(known[run], place, height, width, open_groups):
                begin, count = start[run], start[run + 1] - start[run]
                place_points(scratch, position, extinction, begin, count, sight, own, form)
                if planes.shape[0] > 0:
                    drop_clipped(scratch, position, begin, count, sight.optics.eye, planes)
                _weigh(scratch, X, ACROSS, TOTAL_X, count, taps, profile)
                _weigh(scratch, Y, DOWN, TOTAL_Y, count, taps, profile)
                _share_out(scratch, count)
                _fill_lines(amount, scratch, samples.color, begin, count)
                nearest = front, slot
                last = _spread_points(cells, dirty, ring, scratch, amount, count, taps, nearest)
                behind = max(behind, last)
                for number in range(count):
                    tally[tile, 0] += int(scratch[np.uint64(number) + HOME])
        while front <= behind:
            if is_any_open:
                close_sheet(cells, dirty, slot, ring, _scales(form, front), rows, opaque)
            else:
                empty_sheet(cells, dirty, slot, ring)
            slot, front = (slot + 1) % SLOTS, front + 1
        resolve_rows(rows, n, pixel_weights(stage.tables, n), home, film)
