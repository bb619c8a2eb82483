"""Camera paths around a volume, or away from it, frame by frame.

The paper's movies (section 5) as commands of `resample-volume`; `fetch aneurism`
downloads the second volume::

    CheckerBox          animate checker-box --path orbit -o CheckerBox.mp4
    Aneurism            animate aneurism.nhdr --transfer paper-aneurism --path orbit -o a.mp4
    AneurismZoom        animate aneurism.nhdr --transfer paper-aneurism --path threshold -o a.mp4
    AneurismZoom-Color  the same with --color-by primitive, and --method paper, under which
                        voxels become points at 1 px as in Figure 8a and not at 0.04 px
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from resample.cameras.models import AnyCamera
from resample.cameras.viewpoints import Orbit, Sphere, Viewpoint
from resample.command.films import Tour, is_file_of_path, tour_of
from resample.console import Progress
from resample.files.animations import Levels, Shots, check_count, fingerprint
from resample.files.saving import screen_levels
from resample.lazy import installed_version
from resample.measuring.color_bars import with_color_bar
from resample.resampler import Resampler
from resample.types import Floats
from resample_volume.multivolume.appearance import BY_DEFAULT
from resample_volume.rendering import Subject
from resample_volume.space.annotations import Annotations, annotated
from resample_volume.types import Volume

PATHS = ("orbit", "zoom", "threshold", "still")
FRAMES = 96
FARTHER = 16.0  # distance at the end of `zoom` over that at its start
SPLATS, POINTS = 2.0, 0.03  # px between neighbouring voxels at the ends of `threshold`


@dataclass(frozen=True)
class Flight:
    """A path that starts at an orbit of the volume and keeps looking at its center.

    Parameters
    ----------
    path
        `orbit`: once around at the start's elevation; the film loops without a seam.
        `zoom`: away, until everything appears at 1/16 of its size.
        `threshold`: away, at its own zooms: from voxels 2 px apart, all of which are splats, to
        voxels 0.03 px apart, all of which are points, by the paper's threshold and by ours. Both go
        away by the same factor from frame to frame. `still`: no motion; for volumes that change
        over time.
    frames
        Number of frames, 1 to `resample.files.animations.MOST_FRAMES`.
    start
        Camera of the first frame, except for the zoom of `threshold`.

    Raises
    ------
    ValueError
        The path is unknown, or there are too few or too many frames.
    """

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
        """Return the viewpoint of each frame.

        Parameters
        ----------
        spacing
            Distance of neighbouring voxels at the center of the volume at zoom 1, px.
        """
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
    """Return the path given by a name or a file; it does not depend on the volume.

    Parameters
    ----------
    frames
        Number of frames; None: `FRAMES`, or as the keyframes' times in seconds require.
    fps
        Frames per second.
    """
    if is_file_of_path(path, PATHS):
        return tour_of(Path(path), frames, fps, getattr(start, "fov", Orbit.fov))
    if not isinstance(start, Orbit):
        raise ValueError(
            f"the path {path} goes around the volume or away from it; give its camera as "
            "azimuth,elevation,zoom, or a file of keyframes or poses as the path"
        )
    return Flight(path, FRAMES if frames is None else frames, start)


def over_time(flight: Flight | Tour, frames: int | None, times: int) -> Flight | Tour:
    """Return the flight with one frame per time, unless a number of frames was given."""
    if frames is not None or isinstance(flight, Tour):
        return flight
    return replace(flight, frames=times)


class Course:
    """The subject at each time, all times framed alike.

    Parameters
    ----------
    times
        Number of times.
    subject
        Prepares one time.
    progress
        Called with the fraction of times scanned, 0 to 1.
    sphere
        Bounding sphere of everything visible, if known.
    """

    def __init__(
        self,
        times: int,
        subject: Callable[[int], Subject],
        progress: Progress | None = None,
        sphere: Sphere | None = None,
    ) -> None:
        self.times, self._subject = times, subject
        self._last: tuple[int, Subject] | None = None
        self.marks: list[str] = []
        self.sphere = around(self._subjects(progress)) if sphere is None else sphere

    def __getitem__(self, time: int) -> Subject:
        """Return the subject of a time; the last one is cached."""
        if self._last is None or self._last[0] != time:
            self._last = None  # two of them need not fit in memory
            self._last = time, replace(self._subject(time), sphere=self.sphere)
        return self._last[1]

    def _subjects(self, progress: Progress | None) -> Iterator[Subject]:
        for time in range(self.times):
            subject = self._subject(time)
            self.marks.append(subject.facts()["voxels"])
            yield subject
            if progress is not None:
                progress((time + 1) / self.times)


def cameras_of(subject: Subject, flight: Flight | Tour, size: tuple[int, int]) -> list[AnyCamera]:
    """Return the cameras of a flight's frames (height, width), all around one sphere."""
    # Distance of neighbouring voxels at the center at zoom 1, px
    start = flight.start if isinstance(flight, Flight) else Orbit()
    view = replace(start, zoom=1.0).around(subject.sphere, *size).view()
    depth = (view.rotation @ subject.sphere.center + view.translation)[2]
    voxel = np.cbrt(abs(np.linalg.det(subject.lattice)))
    viewpoints = flight.viewpoints(
        float(voxel * view.focal[0] / (depth if view.perspective else 1.0))
    )
    return [subject.camera(viewpoint, *size) for viewpoint in viewpoints]


@dataclass(frozen=True)
class FrameOptions:
    """How frames are painted, and their background."""

    resampler: Resampler = BY_DEFAULT
    size: tuple[int, int] = (400, 400)  # height and width, px
    background: tuple[float, float, float] = (0.0, 0.0, 0.0)  # linear light
    threads: int | None = None  # frames do not depend on it
    drawing: "FrameOverlay | None" = None


class FrameOverlay(NamedTuple):
    """Annotations drawn into frames, and color bars beside them."""

    volume: Volume  # around the scene's origin
    given: Annotations
    bars: Sequence[Floats]  # (H, B, 4) each


def shots(
    subject: Subject,
    cameras: Sequence[AnyCamera],
    paint: FrameOptions,
    about: Mapping[str, Any] | None = None,
    facts: Mapping[str, Any] | None = None,
) -> Shots:
    """Return the frames of a volume, and everything that they depend on.

    Parameters
    ----------
    cameras
        One per frame; see `cameras_of`.
    """
    overlay = paint.drawing
    numbers = [np.concatenate([np.ravel(part) for part in each.view()]) for each in cameras]
    job = {
        **(about or {}),
        "size": list(paint.size),
        "background": list(paint.background),
        "resampler": repr(subject.painter(paint.resampler)),
        **({} if overlay is None else {"drawn": repr(overlay.given)}),
        **({"bars": fingerprint(*overlay.bars)} if overlay is not None and overlay.bars else {}),
        **subject.facts(),
        **(facts or {}),
        "cameras": fingerprint(np.stack(numbers)),
        "version": installed_version(),
    }
    return Shots(len(cameras), lambda n: frame(subject, cameras[n], paint), job)


def frame(subject: Subject, camera: AnyCamera, paint: FrameOptions) -> Levels:
    """Paint one frame (H, W, 3), sRGB-encoded, with its annotations and color bars."""
    height, width = paint.size
    painted = subject.painter(paint.resampler)(
        subject.samples_for(camera),
        camera,
        height=height,
        width=width,
        threads=paint.threads,
        clip=subject.cuts(camera),
    )
    painted, overlay = subject.developed(painted), paint.drawing
    if overlay is not None and overlay.given.is_any:
        painted = annotated(painted, camera, overlay.volume, overlay.given)
    rgba = painted.rgba
    for bar in () if overlay is None else overlay.bars:
        rgba = with_color_bar(rgba, bar, paint.background)
    return screen_levels(rgba, background=paint.background)


def around(subjects: Iterable[Subject]) -> Sphere:
    """Return the bounding sphere of everything visible in some subjects, if anything is."""
    spheres: list[Sphere] = []
    empty: list[Sphere] = []
    for subject in subjects:
        (empty if subject.is_empty else spheres).append(subject.sphere)
    every = spheres or empty
    center = np.array([sphere.center for sphere in every])
    radius = np.array([[sphere.radius] for sphere in every])
    middle = ((center - radius).min(axis=0) + (center + radius).max(axis=0)) / 2
    away = np.linalg.norm(center - middle, axis=1)
    return Sphere(middle, float((away + radius[:, 0]).max()))
