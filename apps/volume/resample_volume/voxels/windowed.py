"""Dense volumes in bricks, painted window by window: what one window shows is in memory.

Each visible voxel is looked at once for what the picture has in common (`surveyed`), then once for
each window that it may be seen in (`_painted`). Parts of both can be done by several processes:
they depend on nothing but the work, and may be done again.
"""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.files.tiles import keep_tile, kept_tile
from resample.painting.plans import PicturePlan, Window
from resample.resampler import Resampler
from resample.types import Film, Floats, Samples
from resample.watching import Executor, Progress, look, shared_out, told
from resample_volume.types import Volume
from resample_volume.voxels.blocks import Blocks, Indices, Lattice, bounds_of, lattice_for
from resample_volume.voxels.bricks import Asked, Bricks
from resample_volume.voxels.parts import threads_at_work
from resample_volume.voxels.streaming import BYTES_PER_VOXEL, REMEDY
from resample_volume.voxels.visible import Voxels

LOOKING = 0.4  # share of the work until all visible voxels were looked at once, about
PARTS = 8  # in which several processes do so
BYTES_PER_SAMPLE = 40  # of a visible voxel of a window, lit, and what finds it

R = TypeVar("R")
Finish = Callable[[Indices, Voxels], Any]
Classified = Callable[[Volume, Finish], Iterator[Any]]  # what a job makes of bricks' voxels
Lit = Callable[[Voxels, Floats], Samples]  # of voxels, and of extreme gradients of all (2, 3)


class Work(NamedTuple):
    """How a volume in bricks is painted; for other processes all of it has to pickle."""

    volume: Volume  # around the scene's origin
    classified: Classified
    lit: Lit
    resampler: Resampler
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px
    memory: int  # bytes that a process may take for voxels and bricks
    threads: int | None = None  # that a process takes
    folder: Path | None = None  # windows are written there; None: they are in memory


class Surveyed(NamedTuple):
    """What is known of a picture after each visible voxel was looked at once."""

    plan: PicturePlan
    steepest: Floats  # (2, 3) least and greatest components of gradients; or (0, 3)
    blocks: Blocks


class FoundInLayers(NamedTuple):
    """What was found in some layers of blocks."""

    plans: list[PicturePlan]
    ends: list[Floats]  # (3,) components of gradients, among them the extreme ones
    seen: list[tuple[Indices, Indices]]  # blocks, by flat indices, and their visible voxels
    reads: int  # of bricks


class Task(NamedTuple):
    """A window that is to be painted."""

    window: Window
    asked: NDArray[np.uint8]  # bits of the blocks that have part in it
    voxels: int  # visible ones in these


class PaintedWindow(NamedTuple):
    """A window that was painted."""

    window: Window
    film: Film | None  # None: it is in its file
    voxels: int
    reads: int  # of bricks


def painted_in_windows(
    work: Work, tell: Progress, executor: Executor | None = None
) -> Iterator[tuple[Window, Film, int]]:
    """Windows that make up the picture, each with its voxels' number; none if nothing is seen.

    Parameters
    ----------
    work
        What is painted.
    tell
        Called with the share of the work that is done.
    executor
        Does parts of it; without one they are done here.

    Raises
    ------
    ValueError
        A tile's voxels do not fit, or the picture cannot be painted by windows.
    OSError
        A window cannot be written or read.
    """
    bricks: Bricks = work.volume.values  # type: ignore[assignment]
    known = surveyed(work, tell, executor)
    if known is None:
        return
    tasks = tasks_of(work, known)
    common = partial(_painted, work, known._replace(blocks=known.blocks.bare()))
    whole, before = sum(task.voxels for task in tasks), 0
    shares = np.cumsum([0] + [task.voxels for task in tasks]) / max(1, whole)
    parts = shared_out(executor, common, tasks)
    for n in range(len(tasks)):
        first, last = (LOOKING + (1 - LOOKING) * float(shares[at]) for at in (n, n + 1))
        with told(_between(tell, first, last)):
            window, film, voxels, reads = next(parts)
        bricks.reads += reads
        before += voxels
        if film is None and work.folder is not None:
            stored = kept_tile(work.folder, window)
            film = None if stored is None else stored[0]
        if film is None:
            raise OSError(f"{work.folder}: a window of the picture has gone; try again")
        yield window, film, voxels


def _between(tell: Progress, first: float, last: float) -> Progress:
    """Tells the share of a part of the work."""
    return lambda share: tell(first + (last - first) * share)


def surveyed(work: Work, tell: Progress, executor: Executor | None = None) -> Surveyed | None:
    """What a picture depends on, found a brick at a time; None if nothing is seen."""
    bricks: Bricks = work.volume.values  # type: ignore[assignment]
    lattice = lattice_for(bricks.shape)
    layers = _layers(bricks, lattice, 1 if executor is None else PARTS)
    found, parts = [], shared_out(executor, partial(_look, work, lattice), layers)
    for n in range(len(layers)):
        first, last = (LOOKING * at / len(layers) for at in (n, n + 1))
        with told(_between(tell, first, last)):
            found.append(next(parts))
        bricks.reads += found[-1].reads
    plans = [plan for part in found for plan in part.plans]
    if not plans:
        return None
    seen = np.zeros(int(np.prod(lattice.blocks)), np.int64)
    for index, count in (counted for part in found for counted in part.seen):
        seen[index] += count
    index = np.flatnonzero(seen)
    reach, view = work.resampler.reconstruction.radius, work.camera.view()
    bounds = bounds_of(work.volume, lattice, index, reach, view)
    ends = [end for part in found for end in part.ends]
    steepest = np.array([np.min(ends, axis=0), np.max(ends, axis=0)]) if ends else np.zeros((0, 3))
    blocks = Blocks(lattice, index, seen[index], bounds)
    return Surveyed(plans[0].merged(plans[1:]), steepest.astype(np.float32), blocks)


def _layers(bricks: Bricks, lattice: Lattice, parts: int) -> list[tuple[int, int]]:
    """Layers of blocks, from one to before another, that are looked at together."""
    count = bricks.count[0]
    cuts = [count * n // parts * bricks.side[0] // lattice.side for n in range(parts)]
    ends = [*sorted(set(cuts)), lattice.blocks[0]]
    return [(first, last) for first, last in pairwise(ends) if first < last]


def _look(work: Work, lattice: Lattice, layers: tuple[int, int]) -> FoundInLayers:
    """What is found of a picture in some layers of blocks."""
    from resample.engine.jit import threads

    is_asked = np.zeros(lattice.blocks, bool)
    is_asked[layers[0] : layers[1]] = True
    values: Bricks = work.volume.values  # type: ignore[assignment]
    bricks: Any = values.within(Asked(lattice.side, is_asked))
    found = FoundInLayers([], [], [], 0)

    def counted(place: Indices, voxels: Voxels) -> tuple[tuple[Indices, Indices], Voxels]:
        return lattice.counted(place), voxels

    height, width = work.size
    with threads(work.threads):
        for seen, voxels in work.classified(work.volume._replace(values=bricks), counted):
            if not len(voxels.position):
                continue
            if len(voxels.gradient):
                found.ends.extend([voxels.gradient.min(axis=0), voxels.gradient.max(axis=0)])
            samples = Samples(voxels.position, voxels.color, voxels.extinction, voxels.lattice)
            plan = work.resampler.plan(samples, work.camera, height=height, width=width)
            if plan.seen:
                found.plans.append(plan)
            found.seen.append(seen)
    return found._replace(reads=bricks.reads)


def tasks_of(work: Work, known: Surveyed) -> list[Task]:
    """Windows of whole tiles, each of which takes no more memory than is allowed.

    Raises
    ------
    ValueError
        One tile takes more.
    """
    (height, width), tile = known.plan.size, known.plan.tile
    found, waiting = [], [(0, 0, width, height)]
    while waiting:
        window = x0, y0, x1, y1 = waiting.pop()
        are_asked = known.blocks.within(window, known.plan.margin + 1)
        voxels = int(known.blocks.seen[are_asked].sum())
        most = (work.memory - _bytes_of_bricks(work, known.blocks, are_asked)) // BYTES_PER_SAMPLE
        if voxels <= most:
            asked = known.blocks.asked(are_asked)
            found.append(Task(window, np.packbits(asked.is_asked), voxels))
            continue
        columns, rows = -(-(x1 - x0) // tile), -(-(y1 - y0) // tile)
        if max(columns, rows) == 1:
            raise ValueError(
                f"a window of {tile} x {tile} px shows {voxels} visible voxels, and "
                f"{max(0, most)} fit in the memory that is allowed; {REMEDY}"
            )
        if columns >= rows:
            middle = x0 + columns // 2 * tile
            waiting += [(x0, y0, middle, y1), (middle, y0, x1, y1)]
        else:
            middle = y0 + rows // 2 * tile
            waiting += [(x0, y0, x1, middle), (x0, middle, x1, y1)]
    return found


def _bytes_of_bricks(work: Work, blocks: Blocks, are_asked: NDArray[np.bool_]) -> int:
    """What bricks take that are held together, and what is made of those that are looked at."""
    bricks: Bricks = work.volume.values  # type: ignore[assignment]
    if not are_asked.any():
        return 0
    lattice, seen = blocks.lattice, blocks.seen[are_asked]
    at = np.stack(np.unravel_index(blocks.number[are_asked], lattice.blocks), axis=1) * lattice.side
    last = np.minimum(at + lattice.side, bricks.shape) - 1
    is_near = np.zeros([n + 2 for n in bricks.count], bool)
    for ends in product((0, 1), repeat=3):
        z, y, x = (np.where(ends, last, at) // bricks.side + 1).T
        is_near[z, y, x] = True
    is_needed = is_near.copy()
    for axis, by in product(range(3), (-1, 1)):
        is_needed |= np.roll(is_needed, by, axis)
    layers = is_needed[1:-1, 1:-1, 1:-1].sum(axis=(1, 2))
    held = int((layers[1:] + layers[:-1]).max(initial=layers.max()))
    threads = work.threads or threads_at_work()
    within = np.ravel_multi_index(tuple((at // bricks.side).T), bricks.count)
    each = int(np.bincount(within, seen).max()) * BYTES_PER_VOXEL
    return (held + threads) * bricks.bytes_each + (threads + 1) * each


def _painted(work: Work, known: Surveyed, task: Task) -> PaintedWindow:
    """A window, after which nothing of its voxels is in memory."""
    if work.folder is not None:
        stored = kept_tile(work.folder, task.window)
        if stored is not None:  # by who ended before this was known
            return PaintedWindow(task.window, None, task.voxels, stored[1]["reads"])
    from resample.engine.jit import threads

    lattice = known.blocks.lattice
    asked = np.unpackbits(task.asked, count=int(np.prod(lattice.blocks))).view(bool)
    values: Bricks = work.volume.values  # type: ignore[assignment]
    bricks = values.within(Asked(lattice.side, asked.reshape(lattice.blocks)))
    with threads(work.threads):
        samples = _samples(work, bricks, known, task.voxels)
        frame = work.resampler.paint_window(samples, work.camera, known.plan, task.window)
    film = Film(frame.rgba, frame.depth, frame.first_depth, frame.coverage)
    if work.folder is None:
        return PaintedWindow(task.window, film, task.voxels, bricks.reads)
    keep_tile(work.folder, task.window, film, {"reads": bricks.reads})
    return PaintedWindow(task.window, None, task.voxels, bricks.reads)


def _samples(work: Work, bricks: Bricks, known: Surveyed, count: int) -> Samples:
    """All samples of a window, so many, with their light."""
    position, color = np.empty((2, count, 3), np.float32)
    extinction, done = np.empty(count, np.float32), 0
    values: Any = bricks
    volume = work.volume._replace(values=values)

    def lit(_: Indices, voxels: Voxels) -> Samples:
        return work.lit(voxels, known.steepest)

    lattice = np.eye(3)
    for part in work.classified(volume, lit):
        own = slice(done, done + len(part.position))
        position[own], color[own], extinction[own] = part[:3]
        lattice, done = part.lattice, own.stop
        look(done, count)
    return Samples(position[:done], color[:done], extinction[:done], lattice)
