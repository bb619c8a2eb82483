"""Camera paths around a volume, or away from it, frame by frame.

The paper's movies (section 5) as commands of `resample-volume`; `fetch aneurism`
downloads the second volume::

    CheckerBox          animate checker-box --path orbit -o CheckerBox.mp4
    Aneurism            animate aneurism.nhdr --transfer paper-aneurism --path orbit -o a.mp4
    AneurismZoom        animate aneurism.nhdr --transfer paper-aneurism --path threshold -o a.mp4
    AneurismZoom-Color  the same with --color-by primitive, and --method paper, under which
                        voxels become points at 1 px as in Figure 8a and not at 0.04 px
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere, Viewpoint
from resample.command.films import Tour, is_file_of_path, tour_of
from resample.command.session import Session
from resample.command.settings import Resampling
from resample.command.workers import StartWorkers
from resample.console import Progress, progress_bar, say
from resample.files.animations import Frames, Levels, Shots, check_count, fingerprint
from resample.files.saving import screen_levels
from resample.lazy import installed_version
from resample.measuring.color_bars import with_color_bar
from resample.memory import available_memory, bytes_of
from resample.painting.choices import Projection
from resample.profiles.orders import Summing
from resample.progress import WorkerPool, told
from resample.resampler import Resampler
from resample.types import Floats
from resample_volume.annotations import Annotations, annotated, bar_of
from resample_volume.appearance import BY_DEFAULT, Appearance, VolumeLayer
from resample_volume.classification.value_statistics import NO_LEVELS, Survey
from resample_volume.command import inputs
from resample_volume.command.choices import Added, AppearanceChoices, FilmExtras, ReadOptions
from resample_volume.command.rendering import scene_of, slab_missed
from resample_volume.data.values import bricks_of, is_streamed
from resample_volume.rendering import Subject
from resample_volume.series import Ready, Series, chunked, whole
from resample_volume.types import Recording, Volume

PATHS = ("orbit", "zoom", "threshold", "still")
FRAMES = 96
BY_RAYS = "rays:quality=usual"  # the order of fields under `auto`
FARTHER = 16.0  # distance at the end of `zoom` over that at its start
SPLATS, POINTS = 2.0, 0.03  # px between neighbouring voxels at the ends of `threshold`


@dataclass(frozen=True)
class Flight:
    """A path that starts at an orbit of the volume and keeps looking at its center."""

    path: str = "orbit"
    frames: int = FRAMES
    start: Orbit = field(default_factory=Orbit)

    def __post_init__(self) -> None:
        if self.path not in PATHS:
            raise ValueError(
                f"unknown path {self.path!r}; known: {', '.join(PATHS)}, or a file of "
                "keyframes or poses"
            )
        check_count(self.frames)

    def viewpoints(self, spacing: float) -> list[Viewpoint]:
        """Return the viewpoint of each frame."""
        start = self.start
        if self.path == "orbit":
            angles = start.azimuth + 360.0 * np.arange(self.frames) / self.frames
            return [replace(start, azimuth=angle) for angle in angles.tolist()]
        if self.path == "still":
            return [start] * self.frames
        ends = (start.zoom, start.zoom / FARTHER)
        if self.path == "threshold":
            ends = (SPLATS / spacing, POINTS / spacing)
        zooms = np.geomspace(*ends, self.frames)
        return [replace(start, zoom=zoom) for zoom in zooms.tolist()]


def flight_of(path: str, frames: int | None, fps: float, start: Viewpoint) -> Flight | Tour:
    """Return the path given by a name or a file; it does not depend on the volume."""
    if is_file_of_path(path, PATHS):
        return tour_of(Path(path), frames, fps, getattr(start, "fov", Orbit.fov))
    if not isinstance(start, Orbit):
        raise ValueError(
            f"the path {path} goes around the volume or away from it; give its camera as "
            "azimuth,elevation,zoom, or a file of keyframes or poses as the path"
        )
    return Flight(path, FRAMES if frames is None else frames, start)


class Course:
    """The subject at each time, all times framed alike."""

    def __init__(
        self, times: int, subject: Callable[[int], Subject], progress: Progress | None = None,
        sphere: Sphere | None = None,
    ) -> None:  # fmt: skip
        self.times, self._subject = times, subject
        self._last: tuple[int, Subject] | None = None
        self.marks: list[str] = []
        if sphere is None:
            seen = []
            for time in range(times):
                one = subject(time)
                self.marks.append(one.facts()["voxels"])
                seen.append((one.is_empty, one.sphere))
                if progress is not None:
                    progress((time + 1) / times)
            sphere = around(seen)
        self.sphere = sphere

    def __getitem__(self, time: int) -> Subject:
        """Return the subject of a time; the last one is cached."""
        if self._last is None or self._last[0] != time:
            self._last = None  # two of them need not fit in memory
            self._last = time, replace(self._subject(time), sphere=self.sphere)
        return self._last[1]


def cameras_of(subject: Subject, flight: Flight | Tour, size: tuple[int, int]) -> list[AnyCamera]:
    """Return the cameras of a flight's frames (height, width), all around one sphere."""
    # Distance of neighbouring voxels at the center at zoom 1, px
    start = flight.start if isinstance(flight, Flight) else Orbit()
    view = replace(start, zoom=1.0).around(subject.sphere, *size).view()
    depth = (view.rotation @ subject.sphere.center + view.translation)[2]
    voxel = np.cbrt(abs(np.linalg.det(subject.lattice)))
    spacing = float(voxel * view.focal[0] / (depth if view.perspective else 1.0))
    return [subject.camera(viewpoint, *size) for viewpoint in flight.viewpoints(spacing)]


@dataclass(frozen=True)
class FrameOptions:
    """Options and background of frames."""

    resampler: Resampler = BY_DEFAULT
    size: tuple[int, int] = (400, 400)  # height and width, px
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear light
    threads: int | None = None  # frames do not depend on it
    drawn: Annotations | None = None  # into frames
    bars: Sequence[Floats] = ()  # (H, B, 4) color bars beside them
    volume: Volume | None = None  # around the scene's origin, of the annotations


def shots(
    subject: Subject, cameras: Sequence[AnyCamera], paint: FrameOptions,
    about: Mapping[str, Any] | None = None, facts: Mapping[str, Any] | None = None,
) -> Shots:  # fmt: skip
    """Return the frames of a volume, and all their dependencies."""
    numbers = [np.concatenate([np.ravel(part) for part in each.view()]) for each in cameras]
    job = {
        **(about or {}),
        "size": list(paint.size),
        "background": list(paint.background),
        "resampler": repr(subject.painter(paint.resampler)),
        **({} if paint.drawn is None else {"drawn": repr(paint.drawn)}),
        **({"bars": fingerprint(*paint.bars)} if paint.bars else {}),
        **subject.facts(),
        **(facts or {}),
        "cameras": fingerprint(np.stack(numbers)),
        "version": installed_version(),
    }
    return Shots(len(cameras), lambda n: frame_of(subject, cameras[n], paint), job)


def frame_of(subject: Subject, camera: AnyCamera, paint: FrameOptions) -> Levels:
    """Paint one frame (H, W, 3), sRGB-encoded, with its annotations and color bars."""
    seen, cuts = subject.samples_for(camera), subject.cuts(camera)
    shape: dict[str, Any] = {"height": paint.size[0], "width": paint.size[1]}
    resampler = subject.painter(paint.resampler)
    painted = resampler(seen, camera, **shape, threads=paint.threads, clip=cuts)
    painted = subject.tone.developed(painted)
    if paint.volume is not None and paint.drawn is not None and paint.drawn.is_any:
        painted = annotated(painted, camera, paint.volume, paint.drawn)
    rgba = painted.rgba
    for bar in paint.bars:
        rgba = with_color_bar(rgba, bar, paint.background)
    return screen_levels(rgba, background=paint.background)


def around(seen: Sequence[tuple[bool, Sphere]]) -> Sphere:
    """Return the bounding sphere of spheres; empty scenes' are ignored if one is not empty."""
    spheres = [sphere for is_empty, sphere in seen if not is_empty] or [one[1] for one in seen]
    center = np.array([sphere.center for sphere in spheres])
    radius = np.array([[sphere.radius] for sphere in spheres])
    middle = ((center - radius).min(axis=0) + (center + radius).max(axis=0)) / 2
    away = np.linalg.norm(center - middle, axis=1)
    return Sphere(middle, float((away + radius[:, 0]).max()))


class Script(NamedTuple):
    """The content of a film, as options of the command line."""

    volume: str
    source: ReadOptions
    appearance: AppearanceChoices
    added: Added
    extras: FilmExtras
    resampling: Resampling
    frames: int | None  # that are asked for


# Statistics over all times of a volume without levels, their look without labels, meshes and
# planes, and the sphere around the visible part.
TimesStatistics = tuple[Survey, Appearance, Sphere]


class ReadyFilm(NamedTuple):
    """A film, ready to be rendered."""

    shots: Shots
    cameras: Sequence[AnyCamera]
    paint: FrameOptions
    is_in_bricks: bool  # whether values stay in their file
    is_of_field: bool  # whether it is ray cast
    known: TimesStatistics | None = None  # if the volume changes over time


def film_of(
    script: Script, recording: Recording | None, flight: Flight | Tour, paint: FrameOptions,
    about: Mapping[str, Any], start_workers: StartWorkers | None = None,
) -> ReadyFilm:  # fmt: skip
    """Read and prepare the scene of a film."""
    times = None if recording is None else inputs.times_of(script.source, recording)
    if times is not None:
        return _film_of_times(script, times, flight, paint, about, start_workers)
    if recording is not None and chunked(recording) is not None:
        recording = None  # one of its volumes is read by itself
    shown, subject = _scene_for(script, paint.size, recording, start_workers)
    paint = overlaid(paint, script.extras, shown, subject)
    cameras = cameras_of(subject, flight, paint.size)
    if missed := slab_missed(shown, subject, cameras[0]):
        say(missed)
    made = shots(subject, cameras, paint, about)
    return ReadyFilm(made, cameras, paint, is_streamed(shown[0][0]), subject.is_of_field)


def overlaid(
    paint: FrameOptions, extras: FilmExtras, shown: Sequence[VolumeLayer], subject: Subject
) -> FrameOptions:
    """Return the options with the annotations and color bars of all frames."""
    drawn, bars = extras.annotations(paint.background), list[Floats]()
    if extras.color_bar:
        words = (paint.resampler, paint.size[0], paint.background, subject.tone)
        bars = [bar_of(medium, *words) for medium in shown]
    if not (drawn.is_any or bars):
        return paint
    return replace(paint, drawn=drawn, bars=bars, volume=subject.placed(shown[0][0]))


def _film_of_times(
    script: Script, times: Recording, flight: Flight | Tour, paint: FrameOptions,
    about: Mapping[str, Any], start_workers: StartWorkers | None,
) -> ReadyFilm:  # fmt: skip
    """A film of a volume that changes over time; see `film_of`."""
    times, ready = _read(script, times, start_workers)
    count = prod(bricks_of(whole(times)).count) if chunked(times) is not None else 0
    with progress_bar("scanning bricks", count) as progress, told(progress):
        series = Series.of(times, ready)
    look = inputs.appearance_over_time(series, script.appearance, paint.resampler)
    layers, subject = _scenes(script, series, look, paint.resampler)
    with progress_bar("scanning all times") as progress:
        course = Course(len(series), subject, progress)
    known = series.known._replace(levels=NO_LEVELS), look, course.sphere
    first = layers(0)
    if script.extras.color_bar:
        inputs.require_values(first[0][0], "a color bar")
    paint = overlaid(paint, script.extras, first, course[0])
    if script.frames is None and isinstance(flight, Flight):
        flight = replace(flight, frames=course.times)
    cameras = cameras_of(course[0], flight, paint.size)
    for camera in (None, cameras[0]):
        if missed := slab_missed(first, course[0], camera):
            say(missed)
    frames = partial(_frame_over, course, cameras, paint)
    made = shots(course[0], cameras, paint, about, {"times": course.marks})._replace(frame=frames)
    return ReadyFilm(made, cameras, paint, chunked(times) is not None, course[0].is_of_field, known)


def _read(
    script: Script, times: Recording, start_workers: StartWorkers | None
) -> tuple[Recording, Ready]:
    """Return the times, streamed or as one array, and how streamed times are read."""
    resampler = script.appearance.renderer(script.resampling, script.source.scale)
    is_alone = not script.added.also and script.added.channels is None
    can_stream = is_alone and resampler.projection is Projection.COMPOSITE
    if chunked(times) is not None and not can_stream:
        times = inputs.read_as_whole(times, script.source)
    if chunked(times) is not None:
        count, *_, deep, down, across = times.values.shape
        size = f"{count} times of {across} x {down} x {deep} voxels"
        say(f"{times.name}: {size} are read one after the other, brick by brick")
    allowed = inputs.allowed_memory(script.source)
    return times, partial(inputs.with_memory, allowed=allowed, start_workers=start_workers)


def _scenes(
    script: Script, series: Series, look: Appearance, resampler: Resampler
) -> tuple[Callable[[int], list[VolumeLayer]], Callable[[int], Subject]]:
    """Return functions of a time: the volumes of a script, all under one look, and their scene."""
    objects = script.extras.scene_objects(script.appearance, resampler)
    if objects:
        spanned = (plane.within(series.known.span) for plane in objects["planes"])
        objects = {**objects, "planes": tuple(spanned)}
    if script.appearance.labels is not None:
        look = replace(look, labels=script.appearance.labels_of(series[0]))
    own = replace(look, **objects)
    others = inputs.others(script.added.also, script.source)
    further = inputs.further_layers(others, script.appearance, resampler)

    def layers(time: int) -> list[VolumeLayer]:
        return [(series[time], own), *further]

    def subject(time: int) -> Subject:
        return Subject.of_several(layers(time), resampler, script.appearance.fit)

    return layers, subject


def _frame_over(
    course: Course, cameras: Sequence[AnyCamera], paint: FrameOptions, n: int
) -> Levels:
    """Return a frame of a film over which a changing volume's times are spread."""
    return frame_of(course[n * course.times // len(cameras)], cameras[n], paint)


def _scene_for(
    script: Script, size: tuple[int, int], recording: Recording | None = None,
    start_workers: StartWorkers | None = None,
) -> tuple[list[VolumeLayer], Subject]:  # fmt: skip
    """Read the volumes of a script, and prepare their scene for frames (height, width)."""
    look = script.appearance
    resampler = look.renderer(script.resampling, script.source.scale)
    objects = script.extras.scene_objects(look, resampler)
    words = (script.source, script.volume, look, script.added, resampler)
    given = inputs.media(*words, recording=recording, start_workers=start_workers)
    shown = inputs.with_objects(given, objects)
    if script.extras.color_bar:
        inputs.require_values(shown[0][0], "a color bar")
    return shown, scene_of(Session(), shown, resampler, look.fit, size)


def _frames(
    script: Script, cameras: Sequence[AnyCamera], paint: FrameOptions,
    known: TimesStatistics | None, threads: int,
) -> Frames:  # fmt: skip
    """Return the frames of a script in another process, of times by statistics found before."""
    paint = replace(paint, threads=threads)
    if known is None:
        _, scene = _scene_for(script, paint.size)
        return lambda n: frame_of(scene, cameras[n], paint)
    found = inputs.over_time(script.source, script.volume)
    times = None if found is None else inputs.times_of(script.source, found)
    if times is None:
        raise OSError(f"{script.volume} changed while it was filmed; try again")
    times, ready = _read(script, times, None)
    series = Series.again(times, known[0], ready)
    _, subject = _scenes(script, series, known[1], paint.resampler)
    course = Course(len(series), subject, sphere=known[2])
    return partial(_frame_over, course, cameras, paint)


def again(
    script: Script, film: ReadyFilm, crew: WorkerPool | None
) -> Callable[[int], Frames] | None:
    """Return the function that makes a film's frames in other processes; None without any.

    Each worker reads the scene itself. Workers on one machine share its memory limit.
    """
    if crew is None:
        return None
    look, resampling, source = script.appearance, script.resampling, script.source
    if look.classify == "auto":  # resolve it here: a worker with less memory might choose otherwise
        order = resampling.order
        if film.is_of_field:
            look, order = look.model_copy(update={"classify": "post"}), order or BY_RAYS
        else:
            is_by_rays = look.renderer(resampling, source.scale).order.summing is Summing.RAYS
            look, order = look.of_voxels(), None if is_by_rays else order
        resampling = resampling.model_copy(update={"order": order})
    whole = available_memory() if source.memory is None else bytes_of(source.memory)
    if source.memory is None and film.is_in_bricks and whole is not None:
        whole //= 2
    if whole is not None and crew.is_local:
        source = source.model_copy(update={"memory": f"{whole / crew.tasks / 1000:.3f}kB"})
    script = script._replace(source=source, appearance=look, resampling=resampling)
    return partial(_frames, script, film.cameras, film.paint, film.known)
