"""Samples in parts, more than memory holds, painted window by window by a `Resampler`.

A first pass over all samples finds what windows have in common (`plan_by_passes`). Each window then
loads the parts that it shows: all together, or the nearest first and none that others hide.
"""

from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from typing import Any, NamedTuple, Protocol, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import AnyCamera
from resample.memory import trim
from resample.outofcore.boxes import PartBoxes
from resample.outofcore.passes import passed
from resample.outofcore.windows import Budget, WindowTask, painted_in_windows, split_windows
from resample.painting.scenes.plans import (
    ALL_PAINTERS,
    SPLATS,
    PicturePlan,
    PlansOfPart,
    SamplesInParts,
    Window,
)
from resample.painting.scenes.scene import nothing_painted
from resample.resampler import Resampler
from resample.types import Doubles, Film, Floats, Frame, Indices, Samples, Statistics
from resample.watching import Progress

SHARE_OF_SCAN = 0.4  # share of the work that the pass over all samples takes, about
WINDOWS = 16  # windows of a picture that does not fit in memory at once, at least, for executors
RECENT = 4, 8  # memory over that kept from one step for the next: the largest that fits is taken
STEPS = 16  # steps of a window, about: the more, the fewer hidden parts are loaded
LEAST = 1 << 19  # samples of a step, at least
BYTES_PER_SAMPLE = 40  # bytes per sample of a window, with temporaries
BYTES_IN_STEPS = 72  # the same where samples are queued

R = TypeVar("R")


class SampleSource(Protocol):
    """Samples in parts, which have numbers; an application says their bounds, and loads them.

    It is pickled for other processes.
    """

    lattice: Doubles  # (3, 3) as of `Samples`
    reads: int = 0  # what counts as reads
    what: str = "samples"  # for messages
    remedy: str = "give more memory"

    def bounds(self, number: Indices, /) -> PartBoxes:
        """Where the samples of some parts (P,) are."""

    def load(self, number: Indices, count: int, /) -> Samples:
        """The samples of some parts, in any order; at most `count`."""

    def held(self, number: Indices, sizes: Indices, /) -> int:  # noqa: ARG002
        """Bytes that loading some parts takes besides their samples."""
        return 0

    def opened(self, recent: int, /) -> Self:  # noqa: ARG002
        """What loads the parts of one window and counts its reads; it may keep so many bytes."""
        own = copy(self)
        own.reads = 0
        return own

    def unpinned(self) -> bool:
        """Free what only saves time; whether there was any."""
        return False


class PictureQuery(NamedTuple):
    """A picture of samples that is asked for."""

    resampler: Resampler
    camera: AnyCamera
    size: tuple[int, int]  # height and width, px
    clip: Doubles = np.zeros((0, 4))  # planes

    @property
    def shape(self) -> dict[str, int]:
        """Height and width by name."""
        return {"height": self.size[0], "width": self.size[1]}

    def in_parts(
        self,
        source: SampleSource,
        number: Indices,
        sizes: Indices,
        plan: PicturePlan | None = None,
    ) -> SamplesInParts:
        """Return where parts are; with a plan, where they are painted. They cannot be loaded."""
        boxes = source.bounds(number)
        bounds = boxes.on_screen(self.camera.view(), self.resampler.reconstruction.radius)
        if plan is not None:
            is_mirrored, away = self.resampler.margin_beyond_window(
                plan, source.lattice, self.camera
            )
            low, high = bounds[:, :2], bounds[:, 2:]
            aside = away + (high - low if is_mirrored else 0)
            bounds = np.column_stack([low - aside, high + aside]).astype(np.float32)
        return SamplesInParts(*boxes.balls(), bounds, sizes, source.lattice, _refuse_to_load, 0)


class PlanQuery(NamedTuple):
    """What is asked of samples during a pass over all of them."""

    painters: tuple[str, ...]  # painters that may be able to paint all of them
    spaced: PicturePlan | None  # learns how fine tiles are; None: all are equally fine


class PlanAnswer(NamedTuple):
    """What some samples say of a picture."""

    plans: list[PlansOfPart]
    spaced: PicturePlan | None  # knows how fine the tiles are that show them

    def with_more(self, picture: PictureQuery, query: PlanQuery, samples: Samples) -> "PlanAnswer":
        """Return the answer of these and more samples."""
        by: dict[str, Any] = {"clip": picture.clip, "painters": query.painters, **picture.shape}
        plans = picture.resampler.plans(samples, picture.camera, **by)
        spaced = self.spaced
        if plans.visible and spaced is not None:
            spaced = picture.resampler.with_spacing(spaced, samples, picture.camera, picture.clip)
        return PlanAnswer([*self.plans, plans], spaced)


def plan_by_passes(
    picture: PictureQuery,
    lattice: Doubles,
    boxes: PartBoxes,
    scan: Callable[[PlanQuery], tuple[Sequence[PlanAnswer], R]],
) -> tuple[PicturePlan | None, R]:
    """Plan a picture by passes over all samples, which boxes contain; mostly one.

    `scan` makes a pass, and returns the answers of parts and what else it finds: the last is
    returned with the plan, which is None if there are no samples.
    """
    query: PlanQuery | None = _first_query(picture, lattice, boxes.corners())
    while query is not None:
        answers, found = scan(query)
        if not any(answer.plans for answer in answers):
            return None, found
        plan = _planned(picture, lattice, answers)
        query = _better(picture, query, plan)
    return plan, found


def _first_query(picture: PictureQuery, lattice: Doubles, corner: Doubles) -> PlanQuery:
    """Guess spacings from the corners of all, which usually bound all others."""
    alike = np.ones(len(corner), np.float32)
    samples = Samples(corner.astype(np.float32), np.ones_like(corner), alike, lattice)
    plan = picture.resampler.plan(samples, picture.camera, **picture.shape)
    is_uneven = plan.visible > 0 and not picture.resampler.is_even(plan)
    painters = (SPLATS,) if plan.painter == SPLATS else ALL_PAINTERS
    return PlanQuery(painters, plan if is_uneven else None)


def _better(picture: PictureQuery, query: PlanQuery, plan: PicturePlan | None) -> PlanQuery | None:
    """Return a better query if a plan is incomplete; None if it is complete."""
    if plan is None:
        return PlanQuery(ALL_PAINTERS, query.spaced)
    is_known = plan.spacing is not None or picture.resampler.is_even(plan)
    return None if is_known else PlanQuery(query.painters, plan)


def _planned(
    picture: PictureQuery, lattice: Doubles, answers: Sequence[PlanAnswer]
) -> PicturePlan | None:
    """Return the plan of all samples; None: more painters must be queried."""
    plans = [plan for answer in answers for plan in answer.plans]
    plan = picture.resampler.plan_of(plans, lattice, picture.camera, **picture.shape)
    if plan is None:
        return None
    known = [answer.spaced for answer in answers if answer.spaced is not None]
    alike = [part for part in known if (part.tile, part.painter) == (plan.tile, plan.painter)]
    spacings = [part.spacing for part in alike if part.spacing is not None]
    return plan._replace(spacing=np.minimum.reduce(spacings)) if spacings else plan


class SampledPicture(NamedTuple):
    """A planned picture of samples in parts, as `InParts`."""

    source: SampleSource
    picture: PictureQuery
    plan: PicturePlan
    memory: int  # bytes for samples and what loads them
    number: Indices  # (P,) of the parts
    sizes: Indices  # (P,) samples of each, at most
    places: Floats  # (P, 4) left, top, right and bottom, px

    def bounds(self, window: Window) -> WindowTask | None:
        """Return the parts that may show in a window; None if they do not fit in memory."""
        are_near = self._are_near(window)
        number, sizes = self.number[are_near], self.sizes[are_near]
        task = WindowTask(window, number.astype(np.int32), sizes.astype(np.int32))
        fitting = self._fitting(task, self.memory - self.source.held(number, sizes))
        x0, y0, x1, y1 = window
        if fitting is not None or max(x1 - x0, y1 - y0) > self.plan.tile:
            return fitting
        if self.source.unpinned():
            return self.bounds(window)
        raise ValueError(
            f"a window of {self.plan.tile} x {self.plan.tile} px shows {task.samples} "
            f"{self.source.what}, more than fit in the allowed memory; {self.source.remedy}"
        )

    def _are_near(self, window: Window) -> NDArray[np.bool_]:
        """Return which parts (P,) may be visible in a window with its margin."""
        (left, top, right, bottom), margin = self.places.T, self.plan.margin + 1
        x0, y0, x1, y1 = window
        is_across = (right >= x0 - margin) & (left <= x1 + margin)
        return np.asarray(is_across & (bottom >= y0 - margin) & (top <= y1 + margin))

    def _fitting(self, task: WindowTask, free: int) -> WindowTask | None:
        """Return how a window is painted within some bytes; None if it does not fit."""
        resampler = self.picture.resampler
        if task.samples * BYTES_PER_SAMPLE <= free:
            return task
        if not resampler.can_step(self.plan):
            return None
        by = self._of_window(self.source, task), self.picture.camera, self.plan, task.window
        kept, waiting = resampler.kept_between_steps(*by)
        for recent in (self.memory // share for share in RECENT):
            # Queued samples are tested again in each step.
            most = (free - kept - recent) // BYTES_IN_STEPS - waiting
            if most >= max(LEAST, waiting):
                step = min(most, max(LEAST, task.samples // STEPS))
                return task._replace(step=step, recent=recent)
        return None

    def load(self, task: WindowTask) -> Samples:
        """Return all samples of a window."""
        return self.source.load(task.number.astype(np.int64), task.samples)

    def paint(self, task: WindowTask) -> tuple[Film, int]:
        """Paint a window, and release its samples; also return the number of reads."""
        trim()
        own = self._replace(source=self.source.opened(task.recent if task.step else 0))
        paint, camera, _, clip = self.picture
        by = (camera, self.plan, task.window)
        if task.step:
            frame = paint.paint_nearest_first(own._of_window(own.source, task), *by, clip=clip)
        else:
            frame = paint.paint_window(own.load(task), *by, clip=clip)
        film = Film(frame.rgba, frame.depth, frame.first_depth, frame.coverage)
        return film, own.source.reads

    def _of_window(self, source: SampleSource, task: WindowTask) -> SamplesInParts:
        """Return the parts of a window, to be loaded."""
        number, sizes = task.number.astype(np.int64), task.sizes.astype(np.int64)

        def load(parts: Indices) -> Samples:
            return source.load(number[parts], int(sizes[parts].sum()))

        parts = self.picture.in_parts(source, number, sizes, self.plan)
        return parts._replace(load=load, step=task.step)


def paint_samples(
    source: SampleSource,
    sizes: Indices,
    picture: PictureQuery,
    budget: Budget,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """Paint samples in parts, numbered from 0; also return the number of windows.

    Parameters
    ----------
    sizes
        (P,) samples of each part, at most.
    progress
        Called with the fraction of the work done, 0 to 1.
    """
    number = np.flatnonzero(sizes)
    known = picture.in_parts(source, number, sizes[number])
    plan = picture.resampler.plan_of_parts(known, picture.camera, **picture.shape)
    scanning = budget.context(progress).portion(0.0, SHARE_OF_SCAN)

    def scan(query: PlanQuery) -> tuple[list[PlanAnswer], None]:
        job = partial(_answered, source, picture, query)
        parts = [(int(n), int(sizes[n])) for n in number]
        return list(passed(job, parts, scanning, [size for _, size in parts])), None

    if plan is None and number.size:
        plan, _ = plan_by_passes(picture, source.lattice, source.bounds(number), scan)
    if plan is None or not plan.visible:
        return nothing_shown(picture.size), 0
    return paint_planned(source, (number, sizes[number]), picture, plan, budget, progress)


def _answered(
    source: SampleSource, picture: PictureQuery, query: PlanQuery, part: tuple[int, int]
) -> PlanAnswer:
    """Return what the samples of a part say of a picture."""
    samples = source.load(np.array([part[0]]), part[1])
    answer = PlanAnswer([], query.spaced)
    return answer.with_more(picture, query, samples) if len(samples.extinction) else answer


def paint_planned(
    source: SampleSource,
    parts: tuple[Indices, Indices],
    picture: PictureQuery,
    plan: PicturePlan,
    budget: Budget,
    progress: Progress | None = None,
) -> tuple[Frame, int]:
    """Paint numbered parts, of given sizes, of a planned picture; also return the windows."""
    places = picture.in_parts(source, *parts, plan).bounds
    scene = SampledPicture(source, picture, plan, budget.memory, *parts, places)
    fewest = 1 if budget.executor is None else WINDOWS
    tasks = split_windows(picture.size, plan.tile, scene.bounds, fewest)
    painting, none = budget.context(progress).portion(SHARE_OF_SCAN, 1.0), parts[0][:0]
    frame = nothing_shown(picture.size, int(parts[1].sum()))
    whole = (frame.rgba, frame.depth, frame.first_depth, frame.coverage)
    bare = scene._replace(number=none, sizes=none, places=places[:0])  # tasks have their own
    windows = painted_in_windows(bare, tasks, painting, budget.folder)
    for (x0, y0, x1, y1), film, reads in windows:
        source.reads += reads
        for layer, part in zip(whole, film, strict=True):
            layer[y0:y1, x0:x1] = part
    return frame, len(tasks)


def nothing_shown(size: tuple[int, int], samples: int = 0) -> Frame:
    """Return a transparent picture (height, width)."""
    return Frame(*nothing_painted(*size).film, Statistics(samples, 0, 0, 0, 1, {}))


def _refuse_to_load(_: Indices) -> Samples:
    raise RuntimeError("parts of a planned picture cannot be loaded")
