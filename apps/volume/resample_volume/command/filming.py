"""Films described by their options, so that any process can render their frames."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from math import prod
from typing import Any, NamedTuple

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Sphere
from resample.command.films import Tour
from resample.command.session import Session
from resample.command.settings import Resampling
from resample.command.workers import StartWorkers
from resample.console import progress_bar, say
from resample.files.animations import Frames, Levels, Shots
from resample.memory import available_memory, bytes_of
from resample.profiles.orders import Summing
from resample.progress import WorkerPool, told
from resample.resampler import Resampler
from resample.types import Floats
from resample_volume.classification.value_statistics import NO_LEVELS, Survey
from resample_volume.command.animation import (
    Course,
    Flight,
    FrameOptions,
    FrameOverlay,
    cameras_of,
    over_time,
    shots,
)
from resample_volume.command.animation import frame as frame_of
from resample_volume.command.choices import Added, AppearanceChoices, BesideFilm, ReadOptions
from resample_volume.command.inputs import (
    allowed_memory,
    read_as_whole,
    require_values,
    with_memory,
)
from resample_volume.command.inputs import over_time as read_over_time
from resample_volume.command.multivolume import (
    appearance_over_time,
    beside,
    can_stream,
    labelled,
    media,
    others,
    times_of,
    with_objects,
)
from resample_volume.command.rendering import say_missed, scene_of
from resample_volume.data.values import bricks_of, is_streamed
from resample_volume.multivolume.appearance import Appearance, VolumeLayer
from resample_volume.multivolume.series import Ready, Series, is_chunked, whole
from resample_volume.rendering import Subject
from resample_volume.types import Recording

Size = tuple[int, int]  # height and width, px


class Script(NamedTuple):
    """The content of a film, as options of the command line."""

    volume: str
    source: ReadOptions
    appearance: AppearanceChoices
    added: Added
    beside: BesideFilm
    resampling: Resampling
    frames: int | None  # that are asked for


class TimesStatistics(NamedTuple):
    """Statistics over all times of a volume."""

    survey: Survey  # without its levels
    appearance: Appearance  # without labels, meshes and planes
    sphere: Sphere


class ReadyFilm(NamedTuple):
    """A film, ready to be rendered."""

    shots: Shots
    cameras: Sequence[AnyCamera]
    paint: FrameOptions
    is_in_bricks: bool  # whether values stay in their file
    is_of_field: bool  # whether it is ray cast
    known: TimesStatistics | None = None  # if the volume changes over time


def film_of(
    script: Script,
    recording: Recording | None,
    flight: Flight | Tour,
    paint: FrameOptions,
    about: Mapping[str, Any],
    start_workers: StartWorkers | None = None,
) -> ReadyFilm:
    """Read and prepare the scene of a film."""
    times = None if recording is None else times_of(script.source, recording)
    if times is not None:
        return _film_of_times(script, times, flight, paint, about, start_workers)
    if recording is not None and is_chunked(recording):
        recording = None  # one of its volumes is read by itself
    shown, subject = _scene_for(script, paint.size, recording, start_workers)
    paint = replace(paint, drawing=_overlay(script, shown, subject, paint))
    cameras = cameras_of(subject, flight, paint.size)
    say_missed(shown, subject, cameras[0])
    made = shots(subject, cameras, paint, about)
    return ReadyFilm(made, cameras, paint, is_streamed(shown[0][0]), subject.is_of_field)


def _overlay(
    script: Script, shown: Sequence[VolumeLayer], subject: Subject, paint: FrameOptions
) -> FrameOverlay | None:
    """Return what is drawn into all frames and beside them, if anything is."""
    given, bars = script.beside.annotations(paint.background), list[Floats]()
    if script.beside.color_bar:
        require_values(shown[0][0], "a color bar")
        from resample_volume.space.color_bar import bar_of

        words = (paint.resampler, paint.size[0], paint.background, subject.tone)
        bars = [bar_of(medium, *words) for medium in shown]
    is_any = given.is_any or bars
    return FrameOverlay(subject.placed(shown[0][0]), given, bars) if is_any else None


def _film_of_times(
    script: Script,
    times: Recording,
    flight: Flight | Tour,
    paint: FrameOptions,
    about: Mapping[str, Any],
    start_workers: StartWorkers | None,
) -> ReadyFilm:
    """A film of a volume that changes over time; see `film_of`."""
    times, ready = _read(script, times, start_workers)
    count = prod(bricks_of(whole(times)).count) if is_chunked(times) else 0
    with progress_bar("scanning bricks", count) as progress, told(progress):
        series = Series.of(times, ready)
    look = appearance_over_time(series, script.appearance, paint.resampler)
    layers, subject = _scenes(script, series, look, paint.resampler)
    with progress_bar("scanning all times") as progress:
        course = Course(len(series), subject, progress)
    known = TimesStatistics(series.known._replace(levels=NO_LEVELS), look, course.sphere)
    first = layers(0)
    paint = replace(paint, drawing=_overlay(script, first, course[0], paint))
    cameras = cameras_of(course[0], over_time(flight, script.frames, course.times), paint.size)
    for camera in (None, cameras[0]):
        say_missed(first, course[0], camera)
    frames = _frames_over(course, cameras, paint)
    made = shots(course[0], cameras, paint, about, {"times": course.marks})._replace(frame=frames)
    return ReadyFilm(made, cameras, paint, is_chunked(times), course[0].is_of_field, known)


def _read(
    script: Script, times: Recording, start_workers: StartWorkers | None
) -> tuple[Recording, Ready]:
    """Return the times, streamed or as one array; and for streamed times, how they are read.

    Fields need arrays, and so do several volumes.
    """
    resampler = script.appearance.renderer(script.resampling, script.source.scale)
    is_alone = not script.added.also and script.added.channels is None
    if is_chunked(times) and not (is_alone and can_stream(resampler)):
        times = read_as_whole(times, script.source)
    if is_chunked(times):
        count, *_, deep, down, across = times.values.shape
        size = f"{count} times of {across} x {down} x {deep} voxels"
        say(f"{times.name}: {size} are read one after the other, brick by brick")
    allowed = allowed_memory(script.source)
    return times, partial(with_memory, allowed=allowed, start_workers=start_workers)


def _scenes(
    script: Script, series: Series, look: Appearance, resampler: Resampler
) -> tuple[Callable[[int], list[VolumeLayer]], Callable[[int], Subject]]:
    """Return functions of a time: the volumes of a script, all under one look, and their scene."""
    objects = script.beside.scene_objects(script.appearance, resampler).within(series.known.span)
    own = objects.beside(labelled(look, series, script.appearance))
    further = beside(others(script.added.also, script.source), script.appearance, resampler)

    def layers(time: int) -> list[VolumeLayer]:
        return [(series[time], own), *further]

    def subject(time: int) -> Subject:
        return Subject.of_several(layers(time), resampler, script.appearance.fit)

    return layers, subject


def _frames_over(course: Course, cameras: Sequence[AnyCamera], paint: FrameOptions) -> Frames:
    """Return a painter of frame numbers over which a changing volume's times are spread."""
    total = len(cameras)

    def frame(n: int) -> Levels:
        time = n * course.times // total
        return frame_of(course[time], cameras[n], paint)

    return frame


def _scene_for(
    script: Script,
    size: Size,
    recording: Recording | None = None,
    start_workers: StartWorkers | None = None,
) -> tuple[list[VolumeLayer], Subject]:
    """Read the volumes of a script, and prepare their scene for frames (height, width)."""
    look = script.appearance
    resampler = look.renderer(script.resampling, script.source.scale)
    objects = script.beside.scene_objects(look, resampler)
    words = (script.source, script.volume, look, script.added, resampler)
    given = media(*words, recording=recording, start_workers=start_workers)
    shown = with_objects(given, objects)
    return shown, scene_of(Session(), shown, resampler, look.fit, size)


def _frames(
    script: Script, cameras: Sequence[AnyCamera], paint: FrameOptions, threads: int
) -> Frames:
    """Return the frames of a script."""
    (_, subject), paint = _scene_for(script, paint.size), replace(paint, threads=threads)
    return lambda n: frame_of(subject, cameras[n], paint)


def _frames_of_times(
    script: Script,
    cameras: Sequence[AnyCamera],
    paint: FrameOptions,
    known: TimesStatistics,
    threads: int,
) -> Frames:
    """Return the frames of a changing volume, by statistics that another process found."""
    found = read_over_time(script.source, script.volume)
    times = None if found is None else times_of(script.source, found)
    if times is None:
        raise OSError(f"{script.volume} changed while it was filmed; try again")
    times, ready = _read(script, times, None)
    series, paint = Series.again(times, known.survey, ready), replace(paint, threads=threads)
    _, subject = _scenes(script, series, known.appearance, paint.resampler)
    course = Course(len(series), subject, sphere=known.sphere)
    return _frames_over(course, cameras, paint)


def again(
    script: Script, film: ReadyFilm, crew: WorkerPool | None
) -> Callable[[int], Frames] | None:
    """Return the function that makes a film's frames in other processes, if there are any.

    Each worker reads the scene itself. Workers on one machine share its memory limit.
    """
    if crew is None:
        return None
    script, memory = _decided(script, film), script.source.memory
    whole = available_memory() if memory is None else bytes_of(memory)
    if memory is None and film.is_in_bricks and whole is not None:
        whole //= 2
    if whole is not None and crew.is_local:
        share = f"{whole / crew.tasks / 1000:.3f}kB"
        script = script._replace(source=script.source.model_copy(update={"memory": share}))
    own = (script, film.cameras, film.paint)
    if film.known is None:
        return partial(_frames, *own)
    return partial(_frames_of_times, *own, film.known)


def _decided(script: Script, film: ReadyFilm) -> Script:
    """Resolve `auto`, which a worker with less memory might resolve otherwise."""
    look, resampling = script.appearance, script.resampling
    if look.classify != "auto":
        return script
    if not film.is_of_field:
        named = look.renderer(resampling, script.source.scale)
        order = None if named.order.summing is Summing.RAYS else resampling.order
        return script._replace(
            appearance=look.of_voxels(), resampling=resampling.model_copy(update={"order": order})
        )
    order = resampling.order or "rays:quality=usual"
    return script._replace(
        appearance=look.model_copy(update={"classify": "post"}),
        resampling=resampling.model_copy(update={"order": order}),
    )
