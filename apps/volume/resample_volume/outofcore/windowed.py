"""Paint dense volumes in bricks window by window, each window front to back.

Each visible voxel is scanned once for what all windows share (`surveyed`), then once for each
window that it may be visible in (`_painted`), unless others occlude it there. Several processes can
share both passes: parts depend on nothing but the work, and may be repeated.
"""

from collections import deque
from collections.abc import Callable, Iterator
from functools import partial, reduce
from itertools import product
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.files.painted import keep_tile, kept_tile
from resample.memory import trim
from resample.painting.scenes.plans import (
    ALL_PAINTERS,
    SPLATS,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    Window,
)
from resample.resampler import Resampler
from resample.types import Doubles, Film, Indices, Samples
from resample.watching import Executor, Progress, report, shared_out, told
from resample_volume.data.bricks import Bricks, bricks_in_memory, with_neighbours
from resample_volume.data.parts import threads_at_work
from resample_volume.data.statistics.caches import LruCache
from resample_volume.data.values import bricks_of, with_bricks
from resample_volume.outofcore.caching import cache_visible, cached_visible
from resample_volume.outofcore.outline import Classified, VisibleBlocks
from resample_volume.outofcore.passes import PassContext, between, passed
from resample_volume.types import Volume
from resample_volume.voxels.cropping import Steeps, merged_steeps, steeps_of
from resample_volume.voxels.fields import Blocks, Lattice, bounds_of, ends_of, lattice_for, widened
from resample_volume.voxels.streaming import BYTES_PER_VOXEL, REMEDY
from resample_volume.voxels.visible import BYTES_PER_CANDIDATE, lattice_of

SHARE_OF_SCAN = 0.4  # share of the work that the scan of all visible voxels takes, about
WINDOWS = 16  # windows of a picture that does not fit in memory at once, at least
RECENT = 4, 8  # memory over that of the brick cache: the largest that fits is taken
STEPS = 16  # steps of a window, about: the more, the fewer occluded bricks are read
LEAST = 1 << 19  # voxels of a step, at least
BYTES_PER_SAMPLE = 40  # bytes per visible voxel of a window, shaded, with temporaries
BYTES_IN_STEPS = 72  # the same where voxels are queued

Lit = Callable[
    [Indices, Any, Steeps], Samples
]  # of flat indices, voxels and the extreme gradients of all


class RenderJob(NamedTuple):
    """Paint job of a volume in bricks; must be picklable for other processes."""

    volume: Volume  # around the scene's origin; in `Bricks`, or several as `CombinedBricks`
    classified: Classified
    lit: Lit
    resampler: Resampler
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px
    clip: Doubles  # (M, 4) planes, for the resampler
    memory: int  # bytes for voxels and bricks, per process
    threads: int | None = None  # that a process takes
    folder: Path | None = None  # windows are written there; None: they are in memory
    sifts: bool = False  # whether possibly visible voxels may turn out to be transparent
    beside: int = 0  # bytes of the memory taken by something else
    volumes: int = 1  # volumes in the scene
    depends: Any = None  # cache key of what is visible; None: the classification itself

    @property
    def kind(self) -> Any:
        """Cache key: equal where the visible voxels are equal."""
        return self.depends or self.classified


class Surveyed(NamedTuple):
    """Facts about a picture from the scan of all visible voxels."""

    plan: PicturePlan
    steep: Steeps  # of voxels that have gradients
    blocks: Blocks


class Guess(NamedTuple):
    """Queries answered during the scan of visible voxels."""

    painters: tuple[str, ...]  # painters that may be able to paint all of them
    spaced: PicturePlan | None  # learns how fine tiles are; None: all are equally fine


class LayerScan(NamedTuple):
    """Result of the scan of some layers of blocks."""

    plans: list[PlansOfPart]
    steep: list[Steeps]  # of bricks
    visible: list[tuple[Indices, Indices]]  # blocks, by flat indices, and their visible voxels
    spaced: PicturePlan | None  # knows how fine the tiles are that show them


class WindowTask(NamedTuple):
    """A window to paint."""

    window: Window
    number: NDArray[np.int32]  # (N,) blocks visible in it, by flat indices
    visible: NDArray[np.int32]  # (N,) visible voxels of each
    step: int = 0  # blocks loaded together; 0: all of them
    recent: int = 0  # bytes of bricks kept from one step for the next

    @property
    def voxels(self) -> int:
        """Visible voxels of all its blocks."""
        return int(self.visible.sum(dtype=np.int64))


class PaintedWindow(NamedTuple):
    """A painted window."""

    window: Window
    film: Film | None  # None: it is in its file
    reads: int  # of bricks


def painted_in_windows(
    job: RenderJob, known: Surveyed, tell: Progress, executor: Executor | None = None
) -> Iterator[tuple[Window, Film]]:
    """Paint the windows that make up the picture.

    Parameters
    ----------
    tell
        Called with the fraction of the work done, 0 to 1.
    executor
        Runs parts of it; None: this process.
    """
    bricks = bricks_of(job.volume)
    tasks = tasks_of(job, known, 1 if executor is None else WINDOWS)
    common = partial(_painted, job, known._replace(blocks=known.blocks.bare()))
    done = np.cumsum([0] + [task.voxels for task in tasks])
    shares = done / max(1, done[-1])
    parts = shared_out(executor, common, tasks)
    for n in range(len(tasks)):
        first, last = (SHARE_OF_SCAN + (1 - SHARE_OF_SCAN) * float(shares[at]) for at in (n, n + 1))
        with told(between(tell, first, last)):
            window, film, reads = next(parts)
        bricks.reads += reads
        if film is None and job.folder is not None:
            stored = kept_tile(job.folder, window)
            film = None if stored is None else stored[0]
        if film is None:
            raise OSError(f"{job.folder}: a window of the picture is missing; try again")
        yield window, film


def surveyed(job: RenderJob, tell: Progress, executor: Executor | None = None) -> Surveyed | None:
    """Scan a picture's voxels, a brick at a time; None if nothing is visible."""
    bricks = bricks_of(job.volume)
    lattice = lattice_for(bricks.shape)
    before = _known_before(job, lattice)
    if before is not None:
        return before
    guess: Guess | None = _guessed(job)
    while guess is not None:
        looking = PassContext(executor, job.threads, between(tell, 0.0, SHARE_OF_SCAN))
        found = passed(bricks, lattice, partial(_scan_layers, job, lattice, guess), looking)
        if not any(part.visible for part in found):
            return None
        plan = _planned(job, found)
        guess = _better(job, guess, plan)
    seen = np.zeros(int(np.prod(lattice.blocks)), np.int64)
    for index, count in (counted for part in found for counted in part.visible):
        seen[index] += count
    index = np.flatnonzero(seen)
    steep = reduce(merged_steeps, [one for part in found for one in part.steep])
    cache_visible(job.volume, job.kind, VisibleBlocks(steep, index, seen[index]))
    if plan is None or not plan.visible:
        return None
    bounds = _in_parts(job, lattice, index, seen[index], plan).bounds
    return Surveyed(plan, steep, Blocks(lattice, index, seen[index], bounds))


def _known_before(job: RenderJob, lattice: Lattice) -> Surveyed | None:
    """Return facts from the scan for another picture, if they suffice."""
    looked = cached_visible(job.volume, job.kind)
    if looked is None:
        return None
    height, width = job.size
    source = _in_parts(job, lattice, looked.number, looked.visible)
    plan = job.resampler.plan_of_parts(source, job.camera, height=height, width=width)
    if plan is None:
        return None
    blocks = Blocks(lattice, looked.number, looked.visible, source.bounds)
    return Surveyed(plan, looked.steep, blocks)


def _guessed(job: RenderJob) -> Guess:
    """Guess spacings from the volume's corners, which usually bound all others."""
    scene = job.volume
    size = np.array(scene.values.shape[::-1]) - 1
    corner = np.array(list(product((0, 1), repeat=3))) * size @ lattice_of(scene).T + scene.origin
    alike = np.ones(len(corner), np.float32)
    samples = Samples(corner.astype(np.float32), np.ones_like(corner), alike, lattice_of(scene))
    height, width = job.size
    plan = job.resampler.plan(samples, job.camera, height=height, width=width)
    is_uneven = plan.visible > 0 and not job.resampler.is_even(plan)
    painters = (SPLATS,) if plan.painter == SPLATS else ALL_PAINTERS
    return Guess(painters, plan if is_uneven else None)


def _better(job: RenderJob, guess: Guess, plan: PicturePlan | None) -> Guess | None:
    """Return better queries if a plan is incomplete; None if it is complete."""
    if plan is None:
        return Guess(ALL_PAINTERS, guess.spaced)
    is_known = plan.spacing is not None or job.resampler.is_even(plan)
    return None if is_known else Guess(guess.painters, plan)


def _planned(job: RenderJob, found: list[LayerScan]) -> PicturePlan | None:
    """Return the plan of all samples; None: more painters must be queried."""
    height, width = job.size
    plans = [plan for part in found for plan in part.plans]
    by = (lattice_of(job.volume), job.camera)
    plan = job.resampler.plan_of(plans, *by, height=height, width=width)
    if plan is None:
        return None
    known = [part.spaced for part in found if part.spaced is not None]
    alike = [part for part in known if (part.tile, part.painter) == (plan.tile, plan.painter)]
    spacings = [part.spacing for part in alike if part.spacing is not None]
    return plan._replace(spacing=np.minimum.reduce(spacings)) if spacings else plan


def _scan_layers(job: RenderJob, lattice: Lattice, guess: Guess, bricks: Bricks) -> LayerScan:
    """Scan the requested layers of bricks for a picture."""
    found = LayerScan([], [], [], None)

    def counted(place: Indices, voxels: Any) -> tuple[tuple[Indices, Indices], Any]:
        return lattice.counted(place), voxels

    (height, width), spaced = job.size, guess.spaced
    by: dict[str, Any] = {
        "height": height,
        "width": width,
        "clip": job.clip,
        "painters": guess.painters,
    }
    for seen, voxels in job.classified(with_bricks(job.volume, bricks), counted):
        if not len(voxels.position):
            continue
        found.steep.append(steeps_of(voxels.parts, job.clip))
        samples = Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
        plans = job.resampler.plans(samples, job.camera, **by)
        found.plans.append(plans)
        if plans.visible and spaced is not None:
            spaced = job.resampler.with_spacing(spaced, samples, job.camera, job.clip)
        found.visible.append(seen)
    return found._replace(spaced=spaced)


def tasks_of(job: RenderJob, known: Surveyed, fewest: int = 1) -> list[WindowTask]:
    """Return windows of whole tiles, each within the memory limit.

    If the picture does not fit in memory at once, there is a least number of windows.
    """
    (height, width), tile = known.plan.size, known.plan.tile
    values = bricks_of(job.volume)
    found: list[WindowTask] = []
    waiting: deque[Window] = deque([(0, 0, width, height)])
    while waiting:
        window = x0, y0, x1, y1 = waiting.popleft()
        task, fits = _task(job, known, window)
        columns, rows = -(-(x1 - x0) // tile), -(-(y1 - y0) // tile)
        is_tile = max(columns, rows) == 1
        if fits and (task.step == 0 or is_tile or len(found) + len(waiting) + 1 >= fewest):
            found.append(task)
            continue
        if is_tile and values.pinned_bytes:
            values.pin_bricks(0)
            waiting.appendleft(window)
            continue
        if is_tile:
            raise ValueError(
                f"a window of {tile} x {tile} px shows {task.voxels} visible voxels, more than "
                f"fit in the allowed memory; {REMEDY}"
            )
        if columns >= rows:
            middle = x0 + columns // 2 * tile
            waiting += [(x0, y0, middle, y1), (middle, y0, x1, y1)]
        else:
            middle = y0 + rows // 2 * tile
            waiting += [(x0, y0, x1, middle), (x0, middle, x1, y1)]
    return found


def _task(job: RenderJob, known: Surveyed, window: Window) -> tuple[WindowTask, bool]:
    """Return a window, and whether it fits in the allowed memory."""
    blocks = known.blocks
    are_requested = blocks.within(window, known.plan.margin + 1)
    number, seen = (
        part[are_requested].astype(np.int32) for part in (blocks.number, blocks.visible)
    )
    task = WindowTask(window, number, seen)
    values = bricks_of(job.volume)
    free = (
        job.memory - job.beside - values.pinned_bytes - _bytes_of_bricks(job, blocks, are_requested)
    )
    if task.voxels * BYTES_PER_SAMPLE <= free or not job.resampler.can_step(known.plan):
        return task, task.voxels * BYTES_PER_SAMPLE <= free
    source = _source(job, known, task, values)
    kept, waiting = job.resampler.kept_between_steps(source, job.camera, known.plan, window)
    for recent in (job.memory // share for share in RECENT):
        # Queued voxels are tested again in each step.
        most = (free - kept - recent) // BYTES_IN_STEPS - waiting
        step = min(most, max(LEAST, task.voxels // STEPS))
        task = task._replace(step=step, recent=recent)
        if most >= max(LEAST, waiting):
            return task, True
    return task, False


def _bytes_of_bricks(job: RenderJob, blocks: Blocks, are_requested: NDArray[np.bool_]) -> int:
    """Bytes of the bricks held together, and of the temporaries of those being scanned."""
    bricks = bricks_of(job.volume)
    if not are_requested.any():
        return 0
    lattice, seen = blocks.lattice, blocks.visible[are_requested]
    at = (
        np.stack(np.unravel_index(blocks.number[are_requested], lattice.blocks), axis=1)
        * lattice.side
    )
    last = np.minimum(at + lattice.side, bricks.shape) - 1
    is_near = np.zeros(bricks.count, bool)
    for ends in product((0, 1), repeat=3):
        z, y, x = (np.where(ends, last, at) // bricks.side).T
        is_near[z, y, x] = True
    held = bricks_in_memory(with_neighbours(is_near))
    threads = job.threads or threads_at_work()
    within = np.ravel_multi_index(tuple((at // bricks.side).T), bricks.count)
    each = int(np.bincount(within, seen).max()) * BYTES_PER_VOXEL
    if job.sifts:
        most = min(int(np.bincount(within).max()) * lattice.side**3, prod(bricks.side))
        each = max(each, most * BYTES_PER_CANDIDATE)
    return (held + threads) * bricks.bytes_each + (threads + 1) * job.volumes * each


def _painted(job: RenderJob, known: Surveyed, task: WindowTask) -> PaintedWindow:
    """Paint a window, and release its voxels."""
    if job.folder is not None:
        stored = kept_tile(job.folder, task.window)
        if stored is not None:  # painted by a worker that ended before it could report
            return PaintedWindow(task.window, None, stored[1]["reads"])
    from resample.engine.jit import threads

    trim()
    values = bricks_of(job.volume)
    bricks = values.within(None, LruCache(task.recent) if task.step else None)
    with threads(job.threads):
        source = _source(job, known, task, bricks)
        by = (job.camera, known.plan, task.window)
        if task.step:
            frame = job.resampler.paint_nearest_first(source, *by, clip=job.clip)
        else:
            samples = source.load(np.arange(task.number.size))
            frame = job.resampler.paint_window(samples, *by, clip=job.clip)
    film = Film(frame.rgba, frame.depth, frame.first_depth, frame.coverage)
    if job.folder is None:
        return PaintedWindow(task.window, film, bricks.reads)
    keep_tile(job.folder, task.window, film, {"reads": bricks.reads})
    return PaintedWindow(task.window, None, bricks.reads)


def _source(job: RenderJob, known: Surveyed, task: WindowTask, bricks: Bricks) -> SamplesInParts:
    """Return the source of a window's blocks, which counts bricks read."""
    lattice, number = known.blocks.lattice, task.number.astype(np.int64)

    def load(parts: Indices) -> Samples:
        part = bricks.within(lattice.request(number[parts]), bricks.recent)
        samples = _samples(job, part, known, int(task.visible[parts].sum(dtype=np.int64)))
        bricks.reads += part.reads
        return samples

    parts = _in_parts(job, lattice, number, task.visible.astype(np.int64), known.plan)
    return parts._replace(load=load, step=task.step)


def _in_parts(
    job: RenderJob,
    lattice: Lattice,
    number: Indices,
    seen: Indices,
    plan: PicturePlan | None = None,
) -> SamplesInParts:
    """Return a source that only knows where blocks are; for painting by a plan, or as splats."""
    volume, reach = job.volume, job.resampler.reconstruction.radius
    steps, (low, high) = lattice_of(volume), ends_of(lattice, number)
    center = 0.5 * (low + high) @ steps.T + volume.origin
    corner = np.array(list(product((-0.5, 0.5), repeat=3)))
    away = (high - low)[:, np.newaxis] * corner @ steps.T
    radius = np.sqrt((away * away).sum(axis=2).max(axis=1))
    bounds = bounds_of(volume, lattice, number, reach, job.camera.view())
    if plan is not None:
        bounds = widened(bounds, *job.resampler.margin_beyond_window(plan, steps, job.camera))
    return SamplesInParts(center, radius, bounds, seen, steps, _refuse_to_load, 0)


def _refuse_to_load(_: Indices) -> Samples:
    raise RuntimeError("blocks of a planned picture cannot be loaded")


def _samples(job: RenderJob, bricks: Bricks, known: Surveyed, count: int) -> Samples:
    """Return all shaded samples of a window."""
    position, color = np.empty((2, count, 3), np.float32)
    extinction, done = np.empty(count, np.float32), 0
    volume = with_bricks(job.volume, bricks)

    def lit(place: Indices, voxels: Any) -> Samples:
        return job.lit(place, voxels, known.steep)

    lattice = np.eye(3)
    for part in job.classified(volume, lit):
        own = slice(done, done + len(part.position))
        position[own], color[own], extinction[own] = part[:3]
        lattice, done = part.lattice, own.stop
        report(done, count)
    return Samples(position[:done], color[:done], extinction[:done], lattice)
