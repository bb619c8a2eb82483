"""Dense volumes in bricks, painted window by window: what one window shows is in memory."""

from collections.abc import Callable, Iterable, Iterator
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.painting.plans import PicturePlan, Window
from resample.resampler import Resampler
from resample.types import Floats, Frame, Samples
from resample.watching import Progress
from resample_volume.types import Volume
from resample_volume.voxels.bricks import Bricks, Step
from resample_volume.voxels.parts import threads_at_work
from resample_volume.voxels.streaming import BYTES_PER_VOXEL, REMEDY
from resample_volume.voxels.visible import Voxels, lattice_of

LOOKING = 0.3  # share of the work until all visible voxels were looked at once, about

Classified = Callable[[Volume], Voxels]
Lit = Callable[[Voxels, Floats], Samples]  # of voxels, and of extreme gradients of all (2, 3)


class Work(NamedTuple):
    """How a volume in bricks is painted."""

    volume: Volume  # around the scene's origin
    classified: Classified
    lit: Lit
    resampler: Resampler
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px


class Surveyed(NamedTuple):
    """What is known of a picture after each visible voxel was looked at once."""

    plan: PicturePlan
    steepest: Floats  # (2, 3) least and greatest components of gradients; or (0, 3)
    parts: dict[Step, PicturePlan]  # of bricks that are seen


def surveyed(work: Work, bricks: Bricks, tell: Progress) -> Surveyed | None:
    """What a picture depends on, found a row of bricks at a time; None if nothing is seen."""
    parts: dict[Step, PicturePlan] = {}
    ends = []
    for n, (z, y) in enumerate(product(range(bricks.count[0]), range(bricks.count[1]))):
        tell(LOOKING * n / (bricks.count[0] * bricks.count[1]))
        row = [(z, y, x) for x in range(bricks.count[2])]
        voxels = _voxels(work, bricks, row)
        if len(voxels.gradient):
            ends += [voxels.gradient.min(axis=0), voxels.gradient.max(axis=0)]
        for index, samples in _by_bricks(work, bricks, voxels):
            plan = _plan(work, samples)
            if plan.seen:
                parts[z, y, index] = plan
    if not parts:
        return None
    first, *others = parts.values()
    steepest = np.array([np.min(ends, axis=0), np.max(ends, axis=0)]) if ends else np.zeros((0, 3))
    return Surveyed(first.merged(others), steepest.astype(np.float32), parts)


def _plan(work: Work, samples: Samples) -> PicturePlan:
    height, width = work.size
    return work.resampler.plan(samples, work.camera, height=height, width=width)


def _voxels(work: Work, bricks: Bricks, among: Iterable[Step]) -> Voxels:
    """Visible voxels of some bricks, with the looks that they have in the whole."""
    some: Any = bricks.among(among)
    voxels = work.classified(work.volume._replace(values=some))
    bricks.reads += some.reads
    return voxels


def _by_bricks(work: Work, bricks: Bricks, voxels: Voxels) -> Iterator[tuple[int, Samples]]:
    """Samples without light of each brick along a row."""
    back = np.linalg.inv(lattice_of(work.volume))[0]
    place = np.rint((voxels.position - work.volume.origin) @ back).astype(np.int64)
    at = place // bricks.side[2]
    for index in np.unique(at):
        own = at == index
        yield (
            int(index),
            Samples(
                voxels.position[own], voxels.color[own], voxels.extinction[own], voxels.lattice
            ),
        )


def windows_of(known: Surveyed, most: int) -> list[Window]:
    """Windows of whole tiles that have at most so many voxels each.

    Raises
    ------
    ValueError
        One tile has more.
    """
    (height, width), tile = known.plan.size, known.plan.tile
    found, waiting = [], [(0, 0, width, height)]
    while waiting:
        window = x0, y0, x1, y1 = waiting.pop()
        count = sum(known.parts[index].seen for index in bricks_in(known, window))
        if count <= most:
            found.append(window)
            continue
        columns, rows = -(-(x1 - x0) // tile), -(-(y1 - y0) // tile)
        if max(columns, rows) == 1:
            raise ValueError(
                f"a window of {tile} x {tile} px shows bricks of {count} visible voxels, and "
                f"{most} fit in the memory that is allowed; {REMEDY}"
            )
        if columns >= rows:
            middle = x0 + columns // 2 * tile
            waiting += [(x0, y0, middle, y1), (middle, y0, x1, y1)]
        else:
            middle = y0 + rows // 2 * tile
            waiting += [(x0, y0, x1, middle), (x0, middle, x1, y1)]
    return found


def bricks_in(known: Surveyed, window: Window) -> list[Step]:
    """Bricks of which something may be seen in a window of whole tiles."""
    x0, y0, x1, y1 = window
    margin = known.plan.margin + 1
    found = []
    for index, part in known.parts.items():
        left, top, right, bottom = part.bounds
        is_beside = right < x0 - margin or left > x1 + margin
        if not (is_beside or bottom < y0 - margin or top > y1 + margin):
            found.append(index)
    return found


def painted_in_windows(
    work: Work, bricks: Bricks, memory: int, tell: Progress
) -> Iterator[tuple[Window, Frame]]:
    """Windows that make up the picture, one after the other; none if nothing is seen.

    Parameters
    ----------
    work
        What is painted.
    bricks
        Its values.
    memory
        Bytes that the visible voxels of a window may take.
    tell
        Called with the share of the work that is done.

    Raises
    ------
    ValueError
        A tile's do not fit, or the picture cannot be painted by windows.
    """
    known = surveyed(work, bricks, tell)
    if known is None:
        return
    windows = windows_of(known, _most_voxels(bricks, memory))
    for n, window in enumerate(windows):
        tell(LOOKING + (1 - LOOKING) * n / len(windows))
        yield window, _painted(work, bricks, known, window)


def _most_voxels(bricks: Bricks, memory: int) -> int:
    """Visible voxels that fit beside the bricks around those that are looked at."""
    deep, down, across = bricks.count
    held = min(deep * down * across, 2 * (down + 1) * across + 3 + threads_at_work())
    return max(0, memory - held * bricks.bytes_each) // BYTES_PER_VOXEL


def _painted(work: Work, bricks: Bricks, known: Surveyed, window: Window) -> Frame:
    """A window, after which nothing of its voxels is in memory."""
    samples = work.lit(_voxels(work, bricks, bricks_in(known, window)), known.steepest)
    return work.resampler.paint_window(samples, work.camera, known.plan, window)
