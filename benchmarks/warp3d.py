"""Depth image warps: the shared scene at a megapixel, moved back, sideways and forward."""

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path
from typing import Any

from benchmarks.contest import AbsentError, Contender, Goal, Options, Workload, contest
from benchmarks.measure import Run, Spread, take_turns
from benchmarks.tables import Section
from resample import registry
from resample_warp3d.figures.compare import WarpCase
from resample_warp3d.figures.scoring import score
from tests.benchmarks import warp3d_table as scene

VIEWS = {"side": "same scale", "back4": "moved back, 4 × smaller", "in3": "moved in, 3 × larger"}
OURS = ("hybrid", "paper", "preview")
GOALS = {("side", "hybrid"): Goal(60)}
ELSEWHERE = (
    "Not run here: RVS, Open3D, PyTorch3D, softmax splatting, Pose-Warping, gsplat. They are no "
    "part of what is installed for tests"
)


@cache
def _source(options: Options) -> tuple[Any, Any]:
    """The workload, cached on disk since ray tracing takes a minute, and its source."""
    if not scene.BENCH.is_dir():
        raise AbsentError(f"the workload is not here: {scene.BENCH.resolve()}")
    size = 128 if options.quick else 1024
    work = scene.workload(size, Path(options.scratch) / f"warp3d-{size}.npz")
    return work, scene.source_of(work.color, work.depth)


def _case(view: str, options: Options) -> WarpCase:
    work, source = _source(options)
    return scene.case_of(work, view, source)


def workloads(options: Options) -> Sequence[Workload]:
    """A table for each view."""
    names = [*OURS, *(name for name in registry.names("warps") if name not in OURS)]
    if options.quick:
        names = [*OURS, "mesh", "opencv"]
    side = 128 if options.quick else 1024
    return [
        Workload(
            f"Depth image, {side} × {side} px, {words}",
            "PSNR of what the source sees whole, holes counting as black. Times are without the "
            "preparation of\nthe source, which is made once for all views. The ratio is to the "
            "hybrid.",
            [_contender(name, view, options) for name in names],
            has_memory=view == "side" and not options.quick,
        )
        for view, words in VIEWS.items()
    ]


def _contender(name: str, view: str, options: Options) -> Contender:
    goal = None if options.quick else GOALS.get((view, name))
    return Contender(name, _warp(name, view, options), _quality(name, view, options), goal)


def _warp(name: str, view: str, options: Options) -> Callable[[], Run]:
    def prepare() -> Run:
        case, method = _case(view, options), registry.build("warps", name)
        shape = case.target.mask.shape
        return lambda: method(case.source, case.equation, shape)

    return prepare


def _quality(name: str, view: str, options: Options) -> Callable[[], float]:
    def quality() -> float:
        case = _case(view, options)
        return score(scene.warped(case, name), case.target)["psnr"] or 0.0

    return quality


def sections(options: Options) -> Iterator[Section]:
    """The tables, and the time to prepare a source."""
    for workload in workloads(options):
        section = contest(__name__, workload, options)
        section.notes.append(ELSEWHERE)
        section.notes.append(_preparation(options))
        yield section


@cache
def _preparation(options: Options) -> str:
    work, _ = _source(options)
    run: Run = lambda: scene.source_of(work.color, work.depth)  # noqa: E731
    times = take_turns({"prepare": run}, options.rounds)["prepare"]
    return f"preparation of the source: {1000 * Spread.of(times).median:.0f} ms"
