"""A camera that moves in a picture or film with depth, frame by frame."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from resample.cameras.files import left_out, read_poses
from resample.colors import Background, as_levels
from resample.command.films import is_file_of_path, write_shared
from resample.command.session import Session
from resample.command.settings import Sharing
from resample.command.workers import at_work
from resample.console import say
from resample.files.animations import Levels, Shots, check_count, fingerprint
from resample.lazy import installed_version
from resample.types import Doubles, Floats
from resample_warp3d.command.choices import DepthWarping, FilmInput, Joint, Travel
from resample_warp3d.command.depths import DepthFrames, appearing
from resample_warp3d.command.films import DepthRanges, FilmSources, ranges_of, with_depth
from resample_warp3d.command.footage import Footage, footage_of
from resample_warp3d.command.inputs import DepthReader, read_views
from resample_warp3d.command.rendering import (
    CameraFilm,
    check_memory,
    film_of,
    joined,
    joining_of,
    on_screen,
)
from resample_warp3d.command.target import TargetCamera
from resample_warp3d.projection_models import CameraModel, stepped
from resample_warp3d.types import Warped

PATHS = ("sway", "orbit", "dolly")
AMOUNTS = {"sway": 0.1, "orbit": 0.1, "dolly": 0.3}
NEAR = 0.9  # quantile of the nearness that defines the near distance
FRAMES = 48
OWN = ("matrix", "distortion", "model", "sx", "sy", "cx", "cy")  # of cameras, without their poses

Poses = Callable[[int], Doubles]


@dataclass(frozen=True)
class Range:
    """Near and median distance of a picture, scene units."""

    near: float
    middle: float

    @classmethod
    def of(cls, nearness: Floats) -> "Range":
        """Return the range of the known nearness; at least one value must be known."""
        known = nearness[nearness > 0].astype(np.float64)
        near, middle = np.quantile(known, [NEAR, 0.5])
        return cls(1.0 / float(near), 1.0 / float(middle))


@dataclass(frozen=True)
class NearbyPath:
    """A closed path near a camera that keeps looking at the median distance."""

    path: str = "sway"
    frames: int = FRAMES
    amount: float | None = None  # relative to the near distance; None: the path's in `AMOUNTS`

    def __post_init__(self) -> None:
        if self.path not in PATHS:
            raise ValueError(
                f"unknown path {self.path!r}; known: {', '.join(PATHS)}, or a file of poses"
            )
        if self.amount is not None and not 0.0 < self.amount < math.inf:
            raise ValueError(f"an amount of {self.amount:g}; give a share above 0, such as 0.1")
        check_count(self.frames)

    def pose(self, n: int, start: Doubles, distance: Range) -> Doubles:
        """Return a frame's pose (4, 4), world to camera, of a camera that starts at `start`."""
        amount = AMOUNTS[self.path] if self.amount is None else self.amount
        reach, phase = amount * distance.near, 2.0 * math.pi * n / self.frames
        if self.path == "dolly":
            return stepped([0.0, 0.0, reach * (1.0 - math.cos(phase)) / 2.0]) @ start
        right = reach * math.sin(phase)
        down = 0.5 * reach * math.cos(phase) if self.path == "orbit" else 0.0
        yaw, pitch = -math.atan2(right, distance.middle), math.atan2(down, distance.middle)
        return stepped([right, down, 0.0], [math.degrees(yaw), math.degrees(pitch), 0.0]) @ start


def poses_between(poses: Sequence[Doubles], count: int) -> list[Doubles]:
    """Interpolate poses evenly: straight lines between positions, slerp between rotations."""
    from scipy.spatial.transform import Rotation, Slerp

    check_count(count)
    if len(poses) == 1:
        return [poses[0]] * count
    back = np.linalg.inv(np.stack(poses))  # cameras move in straight lines, not the world
    time, wanted = np.arange(len(poses)), np.linspace(0, len(poses) - 1, count)
    turned = Slerp(time, Rotation.from_matrix(back[:, :3, :3]))(wanted).as_matrix()
    place = np.stack([np.interp(wanted, time, back[:, axis, 3]) for axis in range(3)], axis=1)
    made = np.tile(np.eye(4), (count, 1, 1))
    made[:, :3, :3] = turned
    made[:, :3, 3] = place
    return list(np.linalg.inv(made))


def check_path(path: str, frames: int | None, amount: float | None) -> None:
    """Refuse a path that `poses_of` would refuse, before any work is done."""
    poses_of(path, frames, amount, np.eye(4), Range(1.0, 1.0))


def poses_of(
    path: str, frames: int | None, amount: float | None, start: Doubles, distance: Range
) -> list[Doubles]:
    """Return the poses of all frames of a path."""
    if is_file_of_path(path, PATHS, "poses"):
        if amount is not None:
            raise ValueError(f"an amount belongs to the paths {', '.join(PATHS)}, not to a file")
        poses = read_poses(path)
        complaint = left_out(path, poses=True)
        if complaint is not None:
            say(complaint)
        return poses_between(poses, len(poses) if frames is None else frames)
    flight = NearbyPath(path, FRAMES if frames is None else frames, amount)
    return [flight.pose(n, start, distance) for n in range(flight.frames)]


def shots(
    poses: Sequence[Doubles], camera: CameraModel, film: CameraFilm,
    depths: DepthFrames | None = None,
) -> Shots:  # fmt: skip
    """Return the frames of a path, whose depth is also written if requested."""
    render, screen, job = film

    def frame(n: int) -> Levels:
        seen = render(camera.moved(poses[n]))
        if depths is not None:
            depths.write(n, seen.depth)
        return as_levels(screen(seen))

    job = {**job, "path": fingerprint(np.stack(poses)), "intrinsics": camera_words(camera)}
    if depths is None:
        return Shots(len(poses), frame, job)
    return Shots(len(poses), frame, {**job, "depth": depths.job}, has_more=depths.holds)


def camera_words(camera: CameraModel) -> list[str]:
    """Return a camera's parameters, without its pose, to compare cameras."""
    known = sorted(f"{name} {value}" for name, value in vars(camera).items() if name in OWN)
    return [type(camera).__name__, *known]


def frames_of(
    files: tuple[DepthReader, str, str],
    warping: DepthWarping,
    shape: tuple[int, int],
    background: Background,
    poses: Sequence[Doubles],
    camera: CameraModel,
    threads: int,
) -> Callable[[int], Levels]:
    """Return the function that makes frames without depth; raises as `read_views` does."""
    warping = warping.model_copy(update={"threads": threads})
    film = film_of(Session(), read_views(*files), shape, warping, background)
    return shots(poses, camera, film).frame


def flight_frames(
    footage: Footage, reader: DepthReader, ranges: DepthRanges, warping: DepthWarping,
    shape: tuple[int, int], background: Background, poses: Sequence[Doubles], camera: CameraModel,
) -> Callable[[int], tuple[Levels, Warped]]:  # fmt: skip
    """Return the function that makes a frame of a flight, which shows the film again and again."""
    session = Session()
    sources = FilmSources(session, footage, with_depth(footage, reader, ranges), ranges, warping)

    def frame(n: int) -> tuple[Levels, Warped]:
        taken, ready = sources.prepared(n % len(footage))
        moved, joining = camera.moved(poses[n]), joining_of(taken, Joint.usual())
        seen = joined(session, ready, moved, shape, warping, joining).warped
        has_alpha = taken.picture.kind.has_alpha
        return as_levels(on_screen(seen, has_alpha=has_alpha, background=background)), seen

    return frame


def frames_elsewhere(
    color: str, depth: str, reader: DepthReader, ranges: DepthRanges, warping: DepthWarping,
    shape: tuple[int, int], background: Background, poses: Sequence[Doubles], camera: CameraModel,
    threads: int,
) -> Callable[[int], Levels]:  # fmt: skip
    """Return the function that makes frames without depth, for workers."""
    footage = footage_of(color, depth)
    if footage is None:
        raise ValueError(f"{color} is not a film any more")
    warping = warping.model_copy(update={"threads": threads})
    frame = flight_frames(footage, reader, ranges, warping, shape, background, poses, camera)
    return lambda n: frame(n)[0]


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
    settings = reader, ranges, warping, shape, behind, poses, camera
    make = flight_frames(footage, *settings)

    def frame(n: int) -> Levels:
        levels, seen = make(n)
        if depths is not None:
            depths.write(n, seen.depth)
        return levels

    job: dict[str, object] = {
        "source": footage.fingerprint,
        "camera": [reader.eye.model_dump(), reader.meaning.model_dump()],
        "size": list(shape),
        "choices": warping.model_dump(exclude={"threads"}),
        "background": list(behind),
        "version": installed_version(),
        "path": fingerprint(np.stack(poses)),
        "intrinsics": camera_words(camera),
        "ranges": None if ranges.ends is None else [*map(list, ranges.ends)],
        **({} if depths is None else {"depth": depths.job}),
    }
    shots = Shots(len(poses), frame, job)
    shots = shots if depths is None else shots._replace(has_more=depths.holds)
    again = partial(frames_elsewhere, footage.color, footage.depth, *settings)
    fps = filming.fps or len(footage) / sum(footage.frames.seconds)
    with appearing(depths, resume=resume), at_work(sharing, warping.threads) as crew:
        write_shared(output, shots, again, crew, fps=fps, resume=resume)
