"""Volume rendering beside VTK's CPU ray caster: the paper's five volumes and Figure 9's views."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from typing import Any

from benchmarks.contest import AbsentError, Contender, Goal, Options, Workload, contest
from benchmarks.measure import Run
from benchmarks.tables import Row, Section
from resample.cameras.models import AnyCamera
from resample.painting.choices import Primitive
from resample.resampler import Resampler
from resample.types import Field, LatticeField, Samples
from resample.types import View as Perspective
from resample_volume.baselines.peers import Peer, VtkRenderer
from resample_volume.figures import timing
from resample_volume.figures.paper import VolumeFolder
from resample_volume.media.appearance import Appearance, Classification
from resample_volume.rendering import Subject
from resample_volume.voxels.shading import Light
from tests.benchmarks.volume_scenes import object_psnr

VIEWS = ("all splats", "mixed", "all points")
DISTANCE = {"all splats": "close", "mixed": "middle", "all points": "distant"}
HYBRID = Resampler()
FOUR_RAYS = Resampler(primitive=Primitive.SPLATS, subpixels=2)
POINTS = Resampler(primitive=Primitive.POINTS)
FOUR_POINTS = Resampler(primitive=Primitive.POINTS, subpixels=2)
PAPER = Resampler(primitive=Primitive.PAPER, threshold=timing.THRESHOLD)
REFERENCE_RAYS, CONVERGED_RAYS = 8, 16  # per side of a pixel: 64 and 256 rays
LADDER = (1, 2, 3, 4, 5, 6, 8)  # rays per side of a pixel, choices for VTK
WHOLE = 400  # px; quality of larger pictures is measured in the center
PART = 256  # px, side of that center
PAPER_OPACITY, LOW_OPACITY = 0.3, 0.02
HYBRID_NAME, DISTANT_NAME = "hybrid", "points, 2 × 2 sub-pixels"

# Targets at 400 × 400: contender, volume, view, opacity.
GOALS = {
    (DISTANT_NAME, "engine", "all points", PAPER_OPACITY): Goal(25, 11, decibels=50),
    (HYBRID_NAME, "engine", "all splats", PAPER_OPACITY): Goal(60, 30),
    (HYBRID_NAME, "engine", "all splats", LOW_OPACITY): Goal(150, 100),
    (HYBRID_NAME, "aneurism", "all splats", PAPER_OPACITY): Goal(20, 5),
    (HYBRID_NAME, "checker-box", "all splats", PAPER_OPACITY): Goal(16),
}


@dataclass(frozen=True)
class Shown:
    """A volume with an opacity, prepared."""

    case: timing.Case
    subject: Subject  # lit


@dataclass(frozen=True, eq=False)
class Cropped:
    """A camera whose picture is shifted by `offset` px to the right and down."""

    camera: AnyCamera
    offset: float

    def view(self) -> Perspective:
        view = self.camera.view()
        return view._replace(principal=view.principal - self.offset)


@dataclass(frozen=True)
class View:
    """One volume from one viewpoint; data are loaded on demand."""

    name: str  # of the volume
    place: str  # one of `VIEWS`
    side: int  # px
    opacity: float
    options: Options

    @property
    def shown(self) -> Shown:
        """The prepared volume."""
        return _shown(self.name, self.opacity, self.options)

    @cached_property
    def camera(self) -> AnyCamera:
        """The camera."""
        return self.shown.case.camera(
            _zooms(self.name, self.side, self.options)[self.place], self.side
        )

    @cached_property
    def samples(self) -> Samples | Field | LatticeField:
        """Samples lit for the camera."""
        return self.shown.subject.samples_for(self.camera)

    def paint(self, form: Resampler, seen: Samples | Field | LatticeField) -> Any:
        """RGBA."""
        return form(seen, self.camera, height=self.side, width=self.side).rgba

    @property
    def part(self) -> int:
        """Side in px of the central part for quality measurements, since references take long."""
        return self.side if self.side <= WHOLE else PART

    @cached_property
    def part_camera(self) -> AnyCamera:
        """Camera of that part."""
        return Cropped(self.camera, (self.side - self.part) / 2)

    def paint_part(self, form: Resampler) -> Any:
        """RGBA of the central part."""
        side = self.part
        return form(self.samples, self.part_camera, height=side, width=side).rgba

    @cache  # noqa: B019 - a view lives as long as its table is made
    def rays(self, count: int) -> Any:
        """Central part with count × count of our rays per pixel."""
        return self.paint_part(Resampler(primitive=Primitive.SPLATS, subpixels=count))

    def quality(self, form: Resampler, count: int = REFERENCE_RAYS) -> float:
        """PSNR against count × count rays, dB."""
        return object_psnr(self.paint_part(form), self.rays(count))

    def vtk(self, rays: int, side: int) -> VtkRenderer:
        """VTK with the volume in a window of that size."""
        case, look = self.shown.case, self.shown.subject.appearance
        if isinstance(look.transfer, str):
            raise TypeError(f"a transfer function by name, {look.transfer}; give the function")
        peer = Peer(rays=rays, light=look.light)
        try:
            return VtkRenderer(case.volume, look.transfer, height=side, width=side, look=peer)
        except ValueError as error:
            raise AbsentError(str(error)) from None

    @cached_property
    def vtk_reference(self) -> Any:
        """Central part by VTK with 64 rays per pixel."""
        return self.vtk(REFERENCE_RAYS, self.part).render(self.part_camera)

    @cache  # noqa: B019 - a view lives as long as its table is made
    def vtk_decibels(self, rays: int) -> float:
        """Quality of VTK relative to its own 64 rays; infinite for these."""
        picture = self.vtk(rays, self.part).render(self.part_camera)
        return object_psnr(picture, self.vtk_reference)

    @cached_property
    def decibels(self) -> float:
        """Quality of the default."""
        return self.quality(HYBRID)

    @cached_property
    def vtk_rays(self) -> int:
        """Rays per side of a pixel that VTK needs for the quality of our default."""
        return next(
            rays
            for rays in LADDER
            if rays == REFERENCE_RAYS or self.vtk_decibels(rays) >= self.decibels
        )


@cache
def _case(name: str, options: Options) -> timing.Case:
    folder = options.volumes
    shelf = VolumeFolder(folder if folder.is_dir() else None)
    choices = timing.QUICK if options.quick else timing.Effort()
    case = timing.case_of(name, shelf, choices)
    if case is None:
        raise AbsentError(f"there is no {name}.nhdr in {folder}, and none was fetched")
    return case


@cache
def _zooms(name: str, side: int, options: Options) -> dict[str, float]:
    return timing.zooms(_case(name, options), side)


@cache
def _shown(name: str, opacity: float, options: Options) -> Shown:
    case = _case(name, options)
    transfer = case.transfer
    if opacity != PAPER_OPACITY:
        transfer = transfer.thinned(opacity / PAPER_OPACITY)
    look = Appearance(transfer, Light(), classification=Classification.PRE)
    return Shown(case, Subject.of(case.volume, look))


def workloads(options: Options) -> Sequence[Workload]:
    """Volumes × sizes × views, the Engine at two opacities."""
    return [_workload(view) for view in _views(options)]


def _views(options: Options) -> Iterator[View]:
    names = ("checker-box", "aneurism") if options.quick else tuple(timing.PAPER)
    for name in names:
        opacities = (PAPER_OPACITY, LOW_OPACITY) if name == "engine" else (PAPER_OPACITY,)
        for side in (48,) if options.quick else options.sides:
            for opacity in opacities:
                for place in VIEWS[::2] if options.quick else VIEWS:
                    yield View(name, place, side, opacity, options)


def _workload(view: View) -> Workload:
    title = f"{_title(view)}, {view.side} × {view.side} px, {DISTANCE[view.place]} ({view.place})"
    return Workload(
        title,
        "",
        list(_contenders(view)),
        quality="dB against 64 rays",
        has_memory=_has_memory(view),
        further=_beside_paper(view),
    )


def _has_memory(view: View) -> bool:
    """Whether memory is measured, which takes a process per contender."""
    if view.options.quick and view.name != "checker-box":
        return False
    return view.place == "all splats" and view.opacity == PAPER_OPACITY


def _title(view: View) -> str:
    names = {**{name: name.capitalize() for name in timing.PAPER}, "checker-box": "Checker Box"}
    opacity = f", opacity {view.opacity:g}" if view.name == "engine" else ""
    return names[view.name] + opacity


def _contenders(view: View) -> Iterator[Contender]:
    """Ours and VTK; the first uses prepared samples, as for a fixed camera."""

    def goal(name: str) -> Goal | None:
        return GOALS.get((name, view.name, view.place, view.opacity)) if view.side == 400 else None

    def ours(name: str, form: Resampler) -> Contender:
        def prepare() -> Run:
            samples = view.samples
            return lambda: view.paint(form, samples)

        def quality() -> float:
            return view.quality(form)

        return Contender(name, prepare, quality, goal(name))

    yield ours(HYBRID_NAME, HYBRID)
    yield Contender("hybrid, with light", lambda: _lit(view, lambda: view.shown.subject))
    if view.place == "all points":
        yield replace(ours(DISTANT_NAME, FOUR_POINTS), remark=lambda: _converged(view))
        yield ours("splats, 2 × 2 rays", FOUR_RAYS)
        yield ours("points", POINTS)
    yield ours("paper’s form", PAPER)
    yield Contender("VTK, 1 ray", lambda: _vtk(view, 1), lambda: view.vtk_decibels(1))
    yield Contender(
        "VTK, as many rays as our dB take",
        lambda: _vtk(view, view.vtk_rays),
        lambda: view.vtk_decibels(view.vtk_rays),
        remark=lambda: _rays(view),
        is_ready=True,
        has_memory=False,  # it would search for the number of rays again
    )


def _lit(view: View, subject: Callable[[], Subject]) -> Run:
    """Including lighting for the camera."""
    chosen = subject()
    return lambda: view.paint(HYBRID, chosen.samples_for(view.camera))


def _vtk(view: View, rays: int) -> Run:
    renderer = view.vtk(rays, view.side)
    return lambda: renderer.draw(view.camera)


def _converged(view: View) -> str:
    decibels = view.quality(FOUR_POINTS, CONVERGED_RAYS)
    return f"{DISTANT_NAME}: {decibels:.1f} dB against {CONVERGED_RAYS} × {CONVERGED_RAYS} rays"


def _rays(view: View) -> str:
    rays = view.vtk_rays
    said = f"VTK took {rays * rays} rays per pixel for the hybrid’s {view.decibels:.1f} dB"
    return said + (", which are its reference" if rays == REFERENCE_RAYS else "")


def _beside_paper(view: View) -> Callable[[str, float, float | None], Row]:
    """Speedup over the paper, for pictures that it timed."""
    paper = timing.PAPER[view.name]
    seconds = dict(zip(VIEWS, (paper.splats, paper.mixed, paper.points), strict=True))[view.place]
    is_timed = view.side == 400 and view.opacity == PAPER_OPACITY

    def column(name: str, median: float, decibels: float | None) -> Row:  # noqa: ARG001
        if not is_timed or name not in (HYBRID_NAME, "paper’s form"):
            return {}
        faster = seconds / median
        row: Row = {f"times the paper’s speed ({seconds:g} s)": faster}
        if name == "paper’s form":
            row |= {"target": "≥ 100 × the paper", "met": "yes" if faster >= 100 else "no"}
        return row

    return column


def sections(options: Options) -> Iterator[Section]:
    """A table for each workload; a missing volume is reported once."""
    absent: set[str] = set()
    for view in _views(options):
        if view.name in absent:
            continue
        try:
            section = contest(__name__, _workload(view), options)
        except AbsentError as error:
            absent.add(view.name)
            yield Section(view.name.capitalize(), "", notes=[f"left out: {error}"])
            continue
        section.text = _said(view)
        yield section


def _said(view: View) -> str:
    case = view.shown.case
    note = f" {case.subject.note}." if case.subject.note else ""
    spacing = case.spacing(_zooms(view.name, view.side, view.options)[view.place], view.side)
    part = "" if view.part == view.side else f" Quality is that of the middle {PART} × {PART} px."
    return (
        f"{len(case.samples.position):,} visible voxels, shaded (Blinn), {spacing.min():.2f} to "
        f"{spacing.max():.2f} px per voxel.{note}{part} The ratio is to the hybrid."
    )
