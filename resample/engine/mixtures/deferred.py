"""Paint samples that each tile projects for itself, nearest runs first.

A tile knows which runs of neighbouring samples it may show, and the nearest key of each. It takes
runs in that order, culls those behind opaque sub-pixels, and projects the samples of the others. Of
these it paints what is nearer than any run not taken yet: the order is that of all samples. So
hidden runs cost next to nothing, and projected samples never leave the cache. This is occlusion
culling (Zhang, Manocha, Hudson and Hoff 1997) with the picture itself as occlusion map.
"""

import numpy as np

from resample.engine.ellipsoids.footprints import optics_of
from resample.engine.ellipsoids.lanes import paint_splats_on_rows
from resample.engine.ellipsoids.mixed import Mixture, limits_of
from resample.engine.ellipsoids.outlines import (
    BATCH,
    CUT,
    KEY,
    LEFT,
    NO_REACH,
    RIGHT,
    SCRATCH_SIZE,
    SPACING,
    Margin,
    OutlineSetup,
    Window,
    X,
    Y,
    clip_batch,
    form_batch,
    meet_batch,
    meet_outlined,
    outline_batch,
    outline_setup,
    pad_of_tile,
    reach_of,
    sides_of,
)
from resample.engine.ellipsoids.rows import (
    Groups,
    Members,
    SplatLimits,
    cast_rays_of_rows,
    close_rows,
    new_rows,
    open_rows,
    paint_cut_splat_on_rows,
    resolve_rows,
)
from resample.engine.ellipsoids.run_bounds import CHUNKS
from resample.engine.ellipsoids.runs import finest_of, home_of, in_order, is_run_open, may_be_finer
from resample.engine.ellipsoids.work_queue import (
    WorkQueue,
    enlarged,
    gather,
    new_queue,
    part,
    prefetch,
    put_in_order,
    take,
)
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.mixtures.keys import key_by_sheets
from resample.engine.mixtures.models import POINT, choose_points, form_models, tint_splats
from resample.engine.mixtures.sizes import gather_sizes, match_splat_opacity, resize
from resample.engine.points.point_sheets import (
    PointSheet,
    add_to_open_sheet,
    before_sheet,
    is_empty,
    new_sheet,
    put_behind,
)
from resample.engine.sorting import HALF, bits_of, key_of_bits, sort_pairs
from resample.engine.subpixels import grid, laid_out, pixel_weights
from resample.types import (
    Film,
    Floats,
    Formula,
    Indices,
    Layers,
    Records,
    Runs,
    Stage,
    Tally,
    Tiles,
)

TAKEN = 1024  # samples that a tile queues before it paints those that it can
TAKEN_EARLY = 64  # likewise, where all of them are nearer than the next run
AHEAD = 2  # runs by which prefetching is ahead
OCCLUSION_INTERVAL = 64  # splats painted between occlusion checks

Queue = tuple[int, int, np.uint64]  # samples queued, runs taken, largest pair of all samples

# Rows, groups of open ones, the sheet of points (without cells if there is no mixture), and limits.
TileTarget = tuple[Floats, Groups, PointSheet, SplatLimits]


@kernel
def margin_of(mixture: Mixture | None, stage: Stage) -> Margin:
    """Margin beyond their outlines within which samples are painted."""
    if mixture is None:
        return NO_REACH
    return reach_of(stage.style, stage.ellipsoid.radius)


@parallel_kernel
def find_spacings(
    counter: Counter, tiles: Tiles, runs: Runs, stage: Stage, are_mixed: bool
) -> None:
    """Find each tile's smallest spacing of samples, as exactly as its grid depends on it.

    `are_mixed` as for `outline_runs`.
    """
    margin = reach_of(stage.style, stage.ellipsoid.radius) if are_mixed else NO_REACH
    setup = outline_setup(stage, margin)
    planes, style = stage.screen.planes, stage.style
    position, extinction = runs.samples.position.reshape(-1), runs.samples.extinction
    start, scale = runs.start, runs.samples.scale
    scratch = np.empty(SCRATCH_SIZE, np.float32)
    for tile in tasks(counter, tiles.spacing.size):
        finest = np.inf
        # Project only runs that may make the grid finer.
        for run in tiles.member[tiles.start[tile] : tiles.start[tile + 1]]:
            if may_be_finer(runs.known[run], finest, style):
                begin, count = start[run], start[run + 1] - start[run]
                outline_batch(scratch, position, extinction, scale, begin, count, setup)
                if planes.shape[0] > 0:
                    clip_batch(scratch, position, scale, begin, count, setup, planes)
                finest = min(finest, finest_of(scratch, count, tile, tiles, stage.screen.margin))
        tiles.spacing[tile] = finest


@kernel
def take_runs(
    work_queue: WorkQueue,
    queue: Queue,
    members: Members,
    runs: Runs,
    setup: OutlineSetup,
    shown: tuple[Window, Groups],
    mixture: Mixture | None,
    sheets: tuple[Layers, bool] | None,
) -> Queue:
    """Queue samples of a tile's next runs, until there are enough, or the queue is full.

    Where samples are ordered by sheets, the keys of runs are those of sheets, too.
    """
    window, open_groups = shown
    # Take arrays out of their bundles once: threads contend for their reference counts.
    position, extinction = runs.samples.position.reshape(-1), runs.samples.extinction
    color, scale = runs.samples.color.reshape(-1), runs.samples.scale
    start, known = runs.start, runs.known
    found, outline, line = work_queue.found, work_queue.outline, work_queue.waiting
    waiting, next_run, farthest = queue
    before, place, height, width = waiting, window.place, window.height, window.width
    while next_run < members.size and waiting < before + TAKEN:
        # Stop early once the next run lies behind all that is queued.
        run = members[next_run]
        if waiting >= before + TAKEN_EARLY and bits_of(known[run]["key"]) > farthest >> HALF:
            break
        # Stop when the queue has no space for the run.
        begin, count = start[run], start[run + 1] - start[run]
        if waiting + count >= line.size:
            break
        next_run += 1
        # Prefetch a run some way ahead.
        if next_run + AHEAD < members.size:
            soon = members[next_run + AHEAD]
            prefetch(position, extinction, color, start[soon], start[soon + 1] - start[soon])
        # Cull runs behind opaque sub-pixels; cull the samples of the others by the tile's sides.
        if is_run_open(known[run], place, height, width, open_groups):
            if mixture is None or mixture.is_plain:
                meet_batch(found, position, extinction, scale, begin, count, setup, window)
            else:
                outline_batch(outline, position, extinction, scale, begin, count, setup)
                meet_outlined(found, outline, begin, count, window)
            # Replace keys by those of sheets, and append to the queue.
            if sheets is not None and sheets[1]:
                key_by_sheets(found, position, begin, count, sheets[0], setup.optics.eye)
            waiting, farthest = take(line, waiting, found, count, farthest)
    return waiting, next_run, farthest


@kernel
def make_ready(
    work_queue: WorkQueue, queue: Queue, members: Members, known: Records
) -> tuple[Queue, int]:
    """Sort the queued samples that no later run can precede; return how many they are."""
    waiting, next_run, farthest = queue
    # The limit is the nearest key of the next run.
    limit = np.float32(np.inf)
    if next_run < members.size:
        limit = known[members[next_run]]["key"]
    # Split the queue at it, and sort the near part.
    stay = part(work_queue.waiting, waiting, limit, work_queue.ready)
    count = waiting - stay
    sort_pairs(work_queue.ready[:count], work_queue.other[:count])
    return (stay, next_run, farthest), count


@kernel
def form(
    work_queue: WorkQueue,
    count: int,
    runs: Runs,
    setup: OutlineSetup,
    window: Window,
    stage: Stage,
    mixture: Mixture | None,
) -> None:
    """Project the ready samples, batch by batch."""
    position, planes = np.empty(3 * BATCH, np.float32), stage.screen.planes
    every, scratch, samples, style = work_queue.ready, work_queue.scratch, runs.samples, stage.style
    # Gather the batch and project it with exact footprints.
    for first in range(0, count, BATCH):
        size, begin = min(BATCH, count - first), first // BATCH * SCRATCH_SIZE
        ready, batch = every[first : first + size], scratch[begin : begin + SCRATCH_SIZE]
        gather(ready, samples, position, batch)
        scale = gather_sizes(batch, ready, samples.scale)
        form_batch(batch, position, scale, size, setup, window)
        # Replace footprints by the model's, where samples are a mixture.
        if mixture is not None:
            are_measured = mixture.least * window.place.subpixels <= style.threshold
            are_measured |= planes.shape[0] > 0
            form_models(batch, position, size, setup, window, style, are_measured)
            resize(batch, scale, size)
            for n in range(size):
                # The key tells sheets of points apart.
                batch[np.uint64(n) + KEY] = key_of_bits(np.uint32(ready[n] >> HALF))
        # Clip by planes, and turn small samples into points.
        if planes.shape[0] > 0:
            clip_batch(batch, position, scale, 0, size, setup, planes)
        if mixture is not None and are_measured:
            choose_points(batch, size, window, style)
            n = window.place.subpixels
            match_splat_opacity(batch, position, scale, size, setup, n, stage.tables.footprint)
    # Tint after points are chosen, as they keep their colors.
    if mixture is not None and style.tint_red >= 0.0:
        tint_splats(scratch, count, style)


@kernel
def _paint_samples(
    ground: TileTarget,
    work_queue: WorkQueue,
    count: int,
    window: Window,
    stage: Stage,
    formula: Formula,
    mixture: Mixture | None,
    tally: Tally,
) -> None:
    """Paint samples in order, and tally those at home in the tile that are not hidden."""
    (rows, open_groups, sheet, limits), scratch = ground, work_queue.scratch
    place, step = window.place, np.float32(1.0 / window.place.subpixels)
    every, at_home, points = work_queue.offset, 0, 0
    # Paint up to the next occlusion check.
    for first in range(0, count, OCCLUSION_INTERVAL):
        if not close_rows(open_groups, rows, window.width, limits.opaque):
            break
        n = first
        end = last = min(first + OCCLUSION_INTERVAL, count)
        # Stop where a sheet of points that lies in front must be composited.
        if mixture is not None:
            end = first + before_sheet(sheet, scratch, every[first:last], stage)
        while n < last:
            # Composite the sheet when its turn has come.
            if n == end:
                put_behind(sheet, rows, limits.opaque)
                end = last
            # Paint splats up to the first sample that is none.
            offset = every[n:end]
            painted, found = paint_splats_on_rows(
                rows, open_groups, scratch, offset, step, formula, limits, mixture
            )
            at_home += found
            n += painted
            if painted == offset.size:
                continue
            # Add a point to its sheet; a new sheet ends before the next splat behind it.
            if mixture is not None and scratch[np.uint64(every[n]) + CUT] == POINT:
                is_new = is_empty(sheet)
                points += add_to_open_sheet(
                    sheet, rows, open_groups, scratch, every[n], place, stage
                )
                if is_new:
                    end = n + before_sheet(sheet, scratch, every[n:last], stage)
                n += 1
            else:
                # Paint a splat that a plane cuts.
                at_home += paint_cut_splat_on_rows(
                    rows, open_groups, scratch, every[n], place, stage, limits
                )
                n += 1
    tally[0] += points
    tally[1] += at_home


@kernel
def _paint_tile(
    members: Members,
    runs: Runs,
    window: Window,
    stage: Stage,
    formula: Formula,
    mixture: Mixture | None,
    ground: TileTarget,
    tally: Tally,
) -> None:
    """Paint a tile's runs nearest first, until all is opaque.

    The order of samples is that of all runs together.
    """
    setup = outline_setup(stage, margin_of(mixture, stage))
    rows, open_groups, sheet, limits = ground
    # Sort the runs by key, and start with an empty pool.
    in_order(runs.known, members)
    work_queue, queue, is_any_open = new_queue(8 * TAKEN), (0, 0, np.uint64(0)), True
    shown = (window, open_groups)
    while is_any_open and (queue[1] < members.size or queue[0] > 0):
        # Queue samples of the nearest runs.
        work_queue = enlarged(work_queue, queue[0])
        queue = take_runs(work_queue, queue, members, runs, setup, shown, mixture, None)
        # Project those that no later run can precede, and put them in order.
        queue, count = make_ready(work_queue, queue, members, runs.known)
        form(work_queue, count, runs, setup, window, stage, mixture)
        if mixture is None and stage.style.tint_red >= 0.0:
            tint_splats(work_queue.scratch, count, stage.style)
        put_in_order(work_queue.ready[:count], work_queue.scratch, work_queue.offset)
        # Paint them, then check what is opaque by now.
        _paint_samples(ground, work_queue, count, window, stage, formula, mixture, tally)
        is_any_open = close_rows(open_groups, rows, window.width, limits.opaque)
    # Composite the last sheet of points.
    if mixture is not None:
        put_behind(sheet, rows, limits.opaque)


@parallel_kernel
def paint_runs(
    counter: Counter,
    tile_order: Indices,
    tiles: Tiles,
    runs: Runs,
    stage: Stage,
    formula: Formula,
    mixture: Mixture | None,
    output: tuple[Film, Tally],
) -> None:
    """Paint the tiles listed in `tile_order` from the runs that each may show.

    `tile_order`: numbers of tiles that have members. `tiles`: their members are runs. `runs`: at
    most BATCH samples in each. `stage`: what all painters share. `formula`: line integrals and
    opacities of the kernel. `mixture`: None: all samples are splats of exact footprint, and no
    other code is compiled. `output`: film (H, W), filled; and a tally (T, 4), filled: points and
    splats painted by the tiles that hold their centers, 0, and grids.
    """
    eye, shape, _ = optics_of(stage)
    margin, (film, tally) = margin_of(mixture, stage), output
    style, tables = stage.style, stage.tables
    for number in tasks(counter, tile_order.size):
        # Lay out the tile, and the margin within which samples may touch it.
        tile = tile_order[number]
        home, place, height, width = laid_out(tile, tiles, stage)
        tally[tile, 3] = n = place.subpixels
        pad = 0.0
        if mixture is not None:
            is_any_point = mixture.least * n <= style.threshold
            pad = pad_of_tile(style, margin.beyond, n) if is_any_point else float(margin.beyond)
        # Set up its window and its rays.
        sides = sides_of(eye, shape, place, (height, width), pad)
        window = Window(place, height, width, home_of(home), sides)
        rows = new_rows(height, width)
        least_ray = cast_rays_of_rows(rows, height, width, place, stage.camera, stage.ellipsoid)
        # Choose the limits that all splats share, and the canvas.
        linear, size = style.layer if style.linear_opacity else 0.0, (height, width)
        limits = limits_of(mixture, rows, size, style, least_ray, linear)
        size = (0, 0) if mixture is None else size
        sheet = new_sheet(size[0], size[1], runs.samples.scale is not None)
        ground = (rows, open_rows(height, width), sheet, limits)
        # Paint it.
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        _paint_tile(members, runs, window, stage, formula, mixture, ground, tally[tile])
        # Filter sub-pixels to pixels.
        resolve_rows(rows, n, pixel_weights(tables, n), home, film)


@parallel_kernel
def count_points(counter: Counter, tiles: Tiles, runs: Runs, stage: Stage, count: Indices) -> None:
    """Count visible samples (CHUNKS,) that are points in the tiles of their centers."""
    style, start, planes = stage.style, runs.start, stage.screen.planes
    position, extinction = runs.samples.position.reshape(-1), runs.samples.extinction
    setup = outline_setup(stage, reach_of(style, stage.ellipsoid.radius))
    scratch, tile_rows = np.empty(SCRATCH_SIZE, np.float32), tiles.spacing.size // tiles.columns
    scale = runs.samples.scale
    for chunk in tasks(counter, CHUNKS):
        size = runs.known.size
        for run in range(size * chunk // CHUNKS, size * (chunk + 1) // CHUNKS):
            begin, many = start[run], start[run + 1] - start[run]
            # Outline the run.
            outline_batch(scratch, position, extinction, scale, begin, many, setup)
            if planes.shape[0] > 0:
                clip_batch(scratch, position, scale, begin, many, setup, planes)
            # Look up the grid of the tile that holds the center, and compare the spacing there.
            for n in range(many):
                k = np.uint64(n)
                if scratch[k + LEFT] <= scratch[k + RIGHT] and scratch[k + CUT] == 0.0:
                    column = int(max(0.0, min(tiles.columns - 1.0, scratch[k + X] // tiles.size)))
                    row = int(max(0.0, min(tile_rows - 1.0, scratch[k + Y] // tiles.size)))
                    finest = grid(tiles.spacing[row * tiles.columns + column], style)
                    is_point = scratch[k + SPACING] * np.float32(finest) <= style.threshold
                    count[chunk] += 1 if is_point else 0
