"""Films by their words, so that any process can make frames of them."""

import io
from collections.abc import Mapping, Sequence
from contextlib import chdir, redirect_stderr
from dataclasses import dataclass, replace
from functools import lru_cache
from secrets import token_hex
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.command.console import say
from resample.command.session import Session
from resample.command.settings import Resampling
from resample.command.workers import Crew
from resample.engine.jit import threads
from resample.files.animations import Levels, Shots, fingerprint
from resample.memory import available_memory
from resample_volume.command.animation import (
    Flight,
    Paint,
    Tour,
    cameras_of,
    drawing,
    finished,
    over_time,
    shots,
    shots_over_time,
)
from resample_volume.command.choices import Added, Beside, Look, Source
from resample_volume.command.media import filmed, media, series_of, with_meshes
from resample_volume.command.rendering import scene_of
from resample_volume.rendering import Medium, Subject
from resample_volume.types import Recording, Volume
from resample_volume.voxels.bricks import Bricks, Values
from resample_volume.voxels.streaming import TooManyVoxelsError
from resample_volume.voxels.visible import finite_range
from resample_volume.windows import Spent, paint_in_windows, unseen

Size = tuple[int, int]  # height and width, px


class Script(NamedTuple):
    """What a film shows, as the command line names it."""

    volume: str
    source: Source
    look: Look
    added: Added
    beside: Beside
    resampling: Resampling
    frames: int | None  # that are asked for
    folder: str  # that names of files are relative to


class ReadScene(NamedTuple):
    """What a script names, read."""

    shown: list[Medium]
    subject: Subject  # without voxels where not all of them fit in memory
    is_whole: bool


class ReadyFilm(NamedTuple):
    """A film that is ready to be made."""

    shots: Shots
    cameras: Sequence[AnyCamera]
    paint: Paint
    is_of_times: bool  # whether the volume changes


@dataclass(frozen=True)
class Frames:
    """Frames of a script, for processes that know nothing of it yet."""

    script: Script
    cameras: Sequence[AnyCamera]
    paint: Paint
    run: str  # of the command: a later one reads anew what may have changed

    def __call__(self, n: int) -> Levels:
        """Frame (H, W, 3) as a screen takes it."""
        with threads(self.paint.threads), redirect_stderr(io.StringIO()):  # was said already
            scene = _kept_scene(self.script, self.paint.size, self.run)
            return frame_of(scene, self.cameras[n], self.paint)


def film_of(
    script: Script,
    recording: Recording | None,
    flight: Flight | Tour,
    paint: Paint,
    about: Mapping[str, Any],
) -> ReadyFilm:
    """A film, of which the scene is read and looked at.

    Parameters
    ----------
    script
        What it shows.
    recording
        Its volume, if that is read; several times make it a film of them.
    flight
        Where the camera goes.
    paint
        How frames are made.
    about
        Names of the above, see `animation.shots`.

    Raises
    ------
    ValueError, LookupError, OSError
        Something cannot be read, does not fit in memory, or is not allowed.
    """
    given = script.beside.annotations(paint.background)
    series = None if recording is None else series_of(script.source, recording)
    if series is None:
        scene = scene_for(script, paint.size, recording)
        if not scene.is_whole:
            say("not all that is seen fits in memory: frames are painted window by window")
        paint = replace(paint, drawing=drawing(scene.shown[0][0], scene.subject, given))
        cameras = cameras_of(scene.subject, flight, paint.size)
        return ReadyFilm(_shots(scene, cameras, paint, about), cameras, paint, is_of_times=False)
    resampler = paint.resampler
    meshes = script.beside.with_meshes(script.look, resampler)
    course = filmed(series, script.look, script.added, resampler, meshes)
    paint = replace(paint, drawing=drawing(series[0], course[0], given))
    flight = over_time(flight, script.frames, course.times)
    cameras = cameras_of(course[0], flight, paint.size)
    return ReadyFilm(
        shots_over_time(course, cameras, paint, about), cameras, paint, is_of_times=True
    )


def scene_for(script: Script, size: Size, recording: Recording | None = None) -> ReadScene:
    """What a script shows in frames (height, width); errors as of `film_of`."""
    look, resampler = script.look, script.look.renderer(script.resampling)
    meshes = script.beside.with_meshes(look, resampler)
    given = media(script.source, script.volume, look, script.added, resampler, recording=recording)
    shown = with_meshes(given, meshes)
    try:
        return ReadScene(
            shown, scene_of(Session(), shown, resampler, look.fit, size), is_whole=True
        )
    except TooManyVoxelsError as error:
        if look.fit != "volume":
            raise ValueError(
                f"{error}; with --fit volume frames are painted window by window"
            ) from None
        return ReadScene(shown, unseen(*shown[0]), is_whole=False)


@lru_cache(1)
def _kept_scene(script: Script, size: Size, _: str) -> ReadScene:
    """Scene of a script, in a process that makes frames of no other."""
    with chdir(script.folder):
        return scene_for(script, size)


def frame_of(scene: ReadScene, camera: AnyCamera, paint: Paint) -> Levels:
    """Frame (H, W, 3) of a scene, as a screen takes it."""
    if scene.is_whole:
        from resample_volume.command.animation import frame

        return frame(scene.subject, camera, paint)
    volume, look = scene.shown[0]
    bricks: Any = volume.values
    spent = Spent(bricks.memory or available_memory() or 0, paint.threads)
    painted, _ = paint_in_windows(volume, look, camera, paint.size, spent, paint.resampler)
    return finished(painted, camera, paint)


def _shots(
    scene: ReadScene, cameras: Sequence[AnyCamera], paint: Paint, about: Mapping[str, Any]
) -> Shots:
    """Frames of a scene, made here."""
    if scene.is_whole:
        return shots(scene.subject, cameras, paint, about)
    made = shots(scene.subject, cameras, paint, {**about, "values": _mark(*scene.shown[0])})
    return made._replace(frame=lambda n: frame_of(scene, cameras[n], paint))


def _mark(volume: Volume, look: Any) -> str:
    """Text that tells a volume in bricks and its look from others."""
    values: Values = volume.values
    if not isinstance(values, Bricks):
        raise TypeError("volumes in memory have voxels")
    known, (low, high) = values.glance, finite_range(values)
    some = np.linspace(low, high, 1 << 12).astype(values.dtype)
    looks = look.transfer.looks(some, None, (low, high), 0.0)
    return fingerprint(known.least, known.greatest, known.some, known.rim, *looks)


def shared_by(crew: Crew, script: Script, film: ReadyFilm) -> Shots:
    """Frames of a film as processes make them.

    Each reads the scene for itself. Those of one machine share what the memory may be.

    Raises
    ------
    ValueError
        The volume changes, so that its frames are not framed alike by themselves.
    """
    if film.is_of_times:
        raise ValueError("a film of several times is made by one process; leave workers out")
    free = available_memory()
    if crew.is_local and script.source.memory is None and free is not None:
        script = _with_memory(script, free // 2 // crew.tasks)
    elif crew.is_local and script.source.memory is not None:
        from resample.memory import bytes_of

        script = _with_memory(script, bytes_of(script.source.memory) // crew.tasks)
    return film.shots._replace(
        frame=Frames(script, film.cameras, replace(film.paint, threads=crew.threads), token_hex(8))
    )


def _with_memory(script: Script, count: int) -> Script:
    source = script.source.model_copy(update={"memory": f"{count / 1000:.3f}kB"})
    return script._replace(source=source)
