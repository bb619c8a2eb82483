"""Animate a camera that moves in a film with depth: one pose and one picture per frame."""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from resample.colors import Background, as_levels
from resample.command.films import write_shared
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.command.workers import at_work
from resample.console import say
from resample.files.animations import Levels, Shots, fingerprint
from resample.lazy import installed_version
from resample.types import Doubles
from resample_warp3d.command.animation import Range, camera_words, on_screen, poses_of
from resample_warp3d.command.choices import DepthWarping, Joint, Travel
from resample_warp3d.command.depths import DepthFrames, appearing
from resample_warp3d.command.filming.choices import FilmInput
from resample_warp3d.command.filming.footage import Footage, footage_of
from resample_warp3d.command.filming.sources import DepthRanges, FilmSources, ranges_of, with_depth
from resample_warp3d.command.inputs import DepthReader
from resample_warp3d.command.rendering import check_memory, joined, joining_of
from resample_warp3d.command.target import TargetCamera
from resample_warp3d.projection_models import CameraModel
from resample_warp3d.types import Warped


class FlightSettings(NamedTuple):
    """What the frames of a flight through a film depend on besides the film."""

    reader: DepthReader
    ranges: DepthRanges
    warping: DepthWarping
    shape: tuple[int, int]  # height and width, px
    background: Background
    poses: Sequence[Doubles]
    camera: CameraModel


class FilmFlight:
    """Renderer of the frames of a flight through a film; a longer flight shows the film again."""

    def __init__(self, settings: FlightSettings, footage: Footage) -> None:
        read = with_depth(footage, settings.reader, settings.ranges)
        self._settings, self._session, self._count = settings, Session(), len(footage)
        self._sources = FilmSources(self._session, footage, read, settings.ranges, settings.warping)

    def frame(self, n: int) -> tuple[Levels, Warped]:
        """Return a frame as a screen shows it, and its warp."""
        given = self._settings
        taken, sources = self._sources.prepared(n % self._count)
        camera, joining = given.camera.moved(given.poses[n]), joining_of(taken, Joint.usual())
        seen = joined(self._session, sources, camera, given.shape, given.warping, joining).warped
        has_alpha = taken.picture.kind.has_alpha
        shown = on_screen(seen, has_alpha=has_alpha, background=given.background)
        return as_levels(shown), seen


def frames_elsewhere(
    settings: FlightSettings, color: str, depth: str, threads: int
) -> Callable[[int], Levels]:
    """Return the function that makes frames without depth, for workers."""
    footage = footage_of(color, depth)
    if footage is None:
        raise ValueError(f"{color} is not a film any more")
    warping = settings.warping.model_copy(update={"threads": threads})
    flight = FilmFlight(settings._replace(warping=warping), footage)
    return lambda n: flight.frame(n)[0]


def flight_shots(settings: FlightSettings, footage: Footage, depths: DepthFrames | None) -> Shots:
    """Return the frames of a flight, that also write depth if requested."""
    flight = FilmFlight(settings, footage)

    def frame(n: int) -> Levels:
        levels, seen = flight.frame(n)
        if depths is not None:
            depths.write(n, seen.depth)
        return levels

    eye, meaning = settings.reader.eye, settings.reader.meaning
    job = {
        "source": footage.fingerprint,
        "camera": [eye.model_dump(), meaning.model_dump()],
        "size": list(settings.shape),
        "choices": settings.warping.model_dump(exclude={"threads"}),
        "background": list(settings.background),
        "version": installed_version(),
        "path": fingerprint(np.stack(settings.poses)),
        "intrinsics": camera_words(settings.camera),
        "ranges": None if settings.ranges.ends is None else [*map(list, settings.ranges.ends)],
        **({} if depths is None else {"depth": depths.job}),
    }
    shots = Shots(len(settings.poses), frame, job)
    return shots if depths is None else shots._replace(has_more=depths.holds)


def write_flight(
    footage: Footage, reader: DepthReader, warping: DepthWarping, depths: DepthFrames | None,
    output: Path, travel: Travel, target: TargetCamera, filming: FilmInput, behind: Background,
    sharing: Sharing, *, resume: bool,
) -> None:  # fmt: skip
    """Write a film of a camera that moves in a film."""
    footage.check_apart(output)
    if footage.frames.has_tracks:
        say(f"{footage.color}: sound and subtitles are not copied to a film that plays it anew")
    if depths is not None:
        footage.check_apart(depths.folder)
    ranges = ranges_of(Session(), footage, reader, filming)
    taken = with_depth(footage, reader, ranges)(0)
    shape = target.shape(taken.shape)
    check_memory(taken.views, shape, output, sharing.workers or 0)
    camera = target.camera_model(taken.camera, taken.shape, reader.eye.convention)
    distance = Range.of(np.concatenate([view.image.nearness.ravel() for view in taken.views]))
    frames = len(footage) if travel.frames is None else travel.frames
    poses = poses_of(travel.path, frames, travel.amount, camera.world_to_camera, distance)
    settings = FlightSettings(reader, ranges, warping, shape, behind, poses, camera)
    shots = flight_shots(settings, footage, depths)
    again = partial(frames_elsewhere, settings, footage.color, footage.depth)
    fps = filming.fps or len(footage) / sum(footage.frames.seconds)
    with appearing(depths, resume=resume), at_work(sharing, warping.threads) as crew:
        write_shared(output, shots, again, crew, fps=fps, resume=resume)
