"""Paint tiles from runs of samples that are summed before they are composited.

As in `resample.engine.mixtures.deferred`, a tile takes runs nearest first, culls those behind
opaque sub-pixels, and projects the samples of the others. It sums them in slabs that cut splats, as
many of them open as a splat reaches over; in sheets of whole splats, one after the other; or all in
one sum. A slab is composited when no splat that is still to come can reach it.
"""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.footprints import optics_of
from resample.engine.ellipsoids.mixed import Mixture, limits_of
from resample.engine.ellipsoids.outlines import (
    CUT,
    DEPTH,
    OutlineSetup,
    Window,
    outline_setup,
    pad_of_tile,
    sides_of,
)
from resample.engine.ellipsoids.rows import (
    COLUMNS,
    PAIR,
    RAY,
    Members,
    cast_rays_of_rows,
    close_rows,
    index_of,
    new_rows,
    open_rows,
    resolve_rows,
)
from resample.engine.ellipsoids.runs import home_of, in_order
from resample.engine.ellipsoids.work_queue import WorkQueue, enlarged, new_queue, put_in_order
from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.mixtures.deferred import TAKEN, form, make_ready, margin_of, take_runs
from resample.engine.mixtures.keys import end_of_sheet, sort_by_depth
from resample.engine.mixtures.models import POINT
from resample.engine.points.adding import MOST_TAPS
from resample.engine.roles import making_role, plays
from resample.engine.subpixels import Home, grid, laid_out, pixel_weights
from resample.types import (
    ADDITIVE,
    Film,
    Floats,
    Indices,
    Layers,
    Place,
    Runs,
    Single,
    Stage,
    Tally,
    Tiles,
)
from resample_comparisons.volume.kernels.slabs.blends import Blend, Colors, Mixed, Values
from resample_comparisons.volume.kernels.slabs.colors import composite_colors
from resample_comparisons.volume.kernels.slabs.fields import (
    STATES,
    develop,
    new_state,
    resolve_value,
    take_in_values,
)
from resample_comparisons.volume.kernels.slabs.integrals import WORK, Integral
from resample_comparisons.volume.kernels.slabs.points import add_point
from resample_comparisons.volume.kernels.slabs.splats import OpenSlabs, Tools, add_splats, slant_of
from resample_comparisons.volume.kernels.slabs.sums import (
    Canvas,
    Ring,
    Slab,
    SphereCut,
    aligned,
    empty,
    empty_slab,
    new_sums,
    no_dirt,
)

PARTS, WHOLES, ALL = range(3)  # slabs cut splats; sheets of whole splats; one sum of all
FAR_AHEAD = -(1 << 60)  # number of a slab before all others

Projected = tuple[Runs, OutlineSetup, Window]  # samples, and their projection to a tile


class Summed(NamedTuple):
    """How samples are grouped into sums."""

    what: int  # PARTS, WHOLES or ALL
    thickness: float  # scene units, of a slab
    layers: Layers
    ring: Ring  # slabs that are open at a time


class Ways(NamedTuple):
    """How samples are summed and composited."""

    integral: Integral  # line integrals of the kernel
    summed: Summed
    blend: Blend


class Sweep(NamedTuple):
    """Progress through a tile: the first open slab and its slot, and the last touched one."""

    front: int
    slot: int
    behind: int
    is_open: bool  # not all sub-pixels are opaque


class Ready(NamedTuple):
    """Parameters for adding a tile's samples to slabs."""

    summed: Summed
    tools: Tools
    stage: Stage
    reach: float  # half an ellipsoid's extent along the view axis, scene units
    done: int  # slabs before this one were composited in an earlier step


@making_role
def state_of(blend: Blend, height: int, width: int, cutting: SphereCut) -> Floats:
    """Allocate the state of each sub-pixel's ray, besides what is painted."""
    raise NotImplementedError


@plays(state_of, Mixed)
@plays(state_of, Colors)
def _no_state(blend, height, width, cutting):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.zeros((0, 0, STATES), np.float32)


@plays(state_of, Values)
def _state_of_values(blend, height, width, cutting):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return new_state(height, width, cutting)


@making_role
def close(
    blend: Blend, canvas: Canvas, ring: Ring, slab: Slab, cutting: SphereCut, opaque: Single
) -> None:
    """Composite a slab, and clear it."""
    raise NotImplementedError


@plays(close, Mixed)
@plays(close, Colors)
def _close_colors(blend, canvas, ring, slab, cutting, opaque):  # type: ignore[no-untyped-def]  # noqa: ARG001
    composite_colors(canvas, ring, slab.slot, opaque, blend.is_linear)


@plays(close, Values)
def _close_values(blend, canvas, ring, slab, cutting, opaque):  # type: ignore[no-untyped-def]
    take_in_values(blend, canvas, ring, slab, cutting, opaque)


@making_role
def finish(blend: Blend, canvas: Canvas, n: int, weight: Floats, home: Home, value: Floats) -> None:
    """Resolve what was measured to pixels (H, W)."""
    raise NotImplementedError


@plays(finish, Mixed)
@plays(finish, Colors)
def _finish_colors(blend, canvas, n, weight, home, value):  # type: ignore[no-untyped-def]
    pass


@plays(finish, Values)
def _finish_values(blend, canvas, n, weight, home, value):  # type: ignore[no-untyped-def]
    if value.size > 0:
        develop(blend, canvas)
        resolve_value(canvas.state, n, weight, home, blend.projection == ADDITIVE, value)


@kernel
def _cast(
    rows: Floats, along: Floats, height: int, width: int, place: Place, stage: Stage
) -> Single:
    """Set up rays, and fill in |w|, with 1 beyond the tile; return the least 1 / |w|²."""
    # Beyond the last column amplitudes are 0; |w| must only be finite there.
    least = cast_rays_of_rows(rows, height, width, place, stage.camera, stage.ellipsoid)
    for row in range(2 * ((height + 1) // 2)):
        for column in range(width + COLUMNS):
            k = index_of(row, column)
            is_inside = row < height and column < width
            along[k] = np.float32(1.0 / math.sqrt(rows[k + RAY])) if is_inside else np.float32(1.0)
    return least


@kernel
def _most_pairs(tile_order: Indices, tiles: Tiles, stage: Stage) -> int:
    """Pairs of rows of the finest tile, margins included."""
    finest = 1
    for tile in tile_order:
        finest = max(finest, grid(tiles.spacing[tile], stage.style))
    return ((tiles.size + 2 * stage.tables.pixel_margin) * finest + 1) // 2


@kernel
def _closed(blend: Blend, canvas: Canvas, ready: Ready, sweep: Sweep, until: int) -> Sweep:
    """Composite the open slabs before number `until`."""
    # Close slabs from the front, up to the last one touched.
    summed, opaque, is_any_open = ready.summed, ready.tools.limits.opaque, True
    thickness, front, slot = summed.thickness, sweep.front, sweep.slot
    while front < until and front <= sweep.behind:
        # Sheets and sums are not cut by depths.
        near, far = front * thickness, (front + 1) * thickness
        if summed.what != PARTS:
            near, far = -np.inf, np.inf
        # Discard slabs that an earlier step has composited.
        if front < ready.done:
            empty_slab(canvas.sums, canvas.dirty, summed.ring, slot)
        else:
            slab = Slab(front, slot, near, far)
            close(blend, canvas, summed.ring, slab, ready.tools.cutting, opaque)
        # Stop once all sub-pixels are opaque.
        is_any_open = close_rows(canvas.open_groups, canvas.rows, canvas.width, opaque)
        front, slot = front + 1, (slot + 1) % summed.ring.slots
        if not is_any_open:
            break
    return Sweep(max(front, until), slot, sweep.behind, is_any_open)


@kernel
def _add(
    blend: Blend,
    canvas: Canvas,
    ready: Ready,
    sweep: Sweep,
    room: Floats,
    offset: Members,
    mixture: Mixture | None,
) -> tuple[Sweep, int, int]:
    """Add samples in order, and composite each slab once no later sample reaches it.

    Return the progress, and how many points and splats were at home in the tile.
    """
    summed, tools, stage, reach, _ = ready
    points, splats, n, thickness = 0, 0, 0, summed.thickness
    is_cutting = summed.what == PARTS
    while n < offset.size and sweep.is_open:
        # Close the slabs in front of the next sample.
        s = np.uint64(offset[n])
        if is_cutting:
            first = math.floor((float(room[s + DEPTH]) - reach) / thickness)
            sweep = _closed(blend, canvas, ready, sweep, first)
            if not sweep.is_open:
                break
        # Add one point, or splats up to the next that needs another slab.
        span = OpenSlabs(sweep.front, sweep.slot, summed.ring, thickness, reach)
        if mixture is not None and room[s + CUT] == POINT:
            found, behind = add_point(canvas, room, s, span, tools, blend, stage, is_cutting)
            n, points = n + 1, points + found
        else:
            count, found, behind = add_splats(
                canvas, room, offset[n:], span, tools, blend, mixture, is_cutting
            )
            n, splats = n + count, splats + found
        # Remember the last slab touched.
        sweep = Sweep(sweep.front, sweep.slot, max(sweep.behind, behind), True)
    return sweep, points, splats


@kernel
def _add_ready(
    blend: Blend,
    canvas: Canvas,
    ready: Ready,
    sweep: Sweep,
    taken: tuple[WorkQueue, int],
    seen: Projected,
    mixture: Mixture | None,
    tally: Tally,
) -> Sweep:
    """Add the samples whose turn it is; sheets of whole splats one by one."""
    (work_queue, count), (runs, setup, window), first = taken, seen, 0
    position = runs.samples.position.reshape(-1)
    while first < count and sweep.is_open:
        # Take all of them in one go, by default.
        last = count
        # A sheet of whole splats is sorted by depth.
        if ready.summed.what == WHOLES:
            last = end_of_sheet(work_queue.ready[:count], first)
            sort_by_depth(
                work_queue.ready[first:last],
                work_queue.other[first:last],
                position,
                setup.optics.eye,
            )
        # Project the samples of this part, in order.
        size = last - first
        sheet = WorkQueue(
            work_queue.waiting,
            work_queue.ready[first:last],
            work_queue.other[first:last],
            work_queue.offset[:size],
            work_queue.scratch,
            work_queue.found,
            work_queue.outline,
        )
        form(sheet, size, runs, setup, window, ready.stage, mixture)
        put_in_order(sheet.ready, sheet.scratch, sheet.offset)
        # Add them, and tally those at home.
        sweep, points, splats = _add(
            blend, canvas, ready, sweep, sheet.scratch, sheet.offset, mixture
        )
        tally[0] += points
        tally[1] += splats
        # Close a sheet of whole splats at once.
        if ready.summed.what == WHOLES:
            sweep = _closed(blend, canvas, ready, sweep, sweep.front + 1)
        first = last
    return sweep


@kernel
def _paint_tile(
    members: Members,
    seen: Projected,
    blend: Blend,
    canvas: Canvas,
    ready: Ready,
    mixture: Mixture | None,
    tally: Tally,
) -> Sweep:
    """Take a tile's runs nearest first, and sum their samples until all is opaque."""
    # Sort the runs by key, and start with an empty pool.
    (runs, setup, window), summed = seen, ready.summed
    sheets = (summed.layers, summed.what == WHOLES)
    in_order(runs.known, members)
    work_queue, queue = new_queue(8 * TAKEN), (0, 0, np.uint64(0))
    shown = (window, canvas.open_groups)
    # Slabs that cut splats begin before all others; sheets and sums begin at 0.
    begin = FAR_AHEAD if summed.what == PARTS else 0
    sweep = Sweep(begin, 0, 0 if summed.what == ALL else FAR_AHEAD, True)
    # Queue samples of the nearest runs, and add those that no later run can precede.
    while sweep.is_open and (queue[1] < members.size or queue[0] > 0):
        work_queue = enlarged(work_queue, queue[0])
        queue = take_runs(work_queue, queue, members, runs, setup, shown, mixture, sheets)
        queue, count = make_ready(work_queue, queue, members, runs.known)
        sweep = _add_ready(blend, canvas, ready, sweep, (work_queue, count), seen, mixture, tally)
    # Close what is still open.
    if sweep.is_open and summed.what == PARTS:
        sweep = _closed(blend, canvas, ready, sweep, sweep.behind + 1)
    return sweep


@parallel_kernel
def paint_summed_runs(
    counter: Counter,
    tile_order: Indices,
    tiles: Tiles,
    runs: Runs,
    stage: Stage,
    ways: Ways,
    mixture: Mixture | None,
    output: tuple[Film, Floats, Tally],
) -> None:
    """Paint the tiles listed in `tile_order` from the runs that each may show.

    `tile_order`, `tiles`, `runs`, `stage`: as of `resample.engine.mixtures.deferred.paint_runs`.
    `ways`: how samples are grouped, integrated and composited. `mixture`: models of samples that
    are not all splats of exact footprint; or None. `output`: film (H, W), filled; values (H, W) of
    projections, filled, or (0, 0); and a tally (T, 4), filled: points and splats painted by the
    tiles that hold their centers, 0, and grids.
    """
    # Allocate what all tiles of this thread use.
    (eye, shape, _), (film, value, tally) = optics_of(stage), output
    integral, summed, blend = ways
    style, tables, pairs = stage.style, stage.tables, _most_pairs(tile_order, tiles, stage)
    reach, setup = (
        math.sqrt(shape.covariance[2][2]),
        outline_setup(stage, margin_of(mixture, stage)),
    )
    work, sums, dirty = aligned(WORK), new_sums(summed.ring, pairs), no_dirt(summed.ring.slots)
    along, across = np.empty(pairs * PAIR, np.float32), np.empty(MOST_TAPS, np.float32)
    down = np.empty(MOST_TAPS, np.float32)
    # Take tiles until none is left.
    for number in tasks(counter, tile_order.size):
        tile = tile_order[number]
        # Lay out the sub-pixels, and set up their rays.
        home, place, height, width = laid_out(tile, tiles, stage)
        tally[tile, 3] = n = place.subpixels
        rows, open_groups = new_rows(height, width), open_rows(height, width)
        least_ray = _cast(rows, along, height, width, place, stage)
        # Choose limits and margins for culling.
        limits = limits_of(mixture, rows, (height, width), style, least_ray, 0.0)
        pad = 0.0 if mixture is None else pad_of_tile(style, setup.beyond.beyond, n)
        # Bundle the canvas and the projection of the tile.
        cutting = SphereCut(
            place, stage.camera, stage.ellipsoid, stage.screen.planes, tables.partial
        )
        state = state_of(blend, height, width, cutting)
        canvas = Canvas(
            rows, open_groups, along, sums, dirty, across, down, work,
            state, height, width,
        )  # fmt: skip
        sides = sides_of(eye, shape, place, (height, width), pad)
        seen = (runs, setup, Window(place, height, width, home_of(home), sides))
        tools = Tools(slant_of(eye, shape, place), limits, integral, cutting, np.float32(1.0))
        ready = Ready(summed, tools, stage, reach, FAR_AHEAD)
        # Paint it.
        members = tiles.member[tiles.start[tile] : tiles.start[tile + 1]]
        sweep = _paint_tile(members, seen, blend, canvas, ready, mixture, tally[tile])
        # Close the one sum, and clear all slabs for the next tile.
        if summed.what == ALL:
            _closed(blend, canvas, ready, sweep, 1)
        empty(sums, dirty, summed.ring)
        # Filter sub-pixels to pixels.
        weight = pixel_weights(tables, n)
        finish(blend, canvas, n, weight, home, value)
        resolve_rows(rows, n, weight, home, film)
