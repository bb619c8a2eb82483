"""Camera paths near a depth image, frame by frame."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from resample.cameras.files import left_out, read_poses
from resample.colors import Background, as_levels
from resample.command.films import is_file_of_path
from resample.console import say
from resample.files.animations import Levels, Shots, check_count, fingerprint
from resample.types import Doubles, Floats
from resample_warp3d.projection_models import CameraModel
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
    """A closed path near a camera that keeps looking at the median distance.

    `amount`: its size, relative to the near distance; None: the path's in `AMOUNTS`.
    """

    path: str = "sway"
    frames: int = FRAMES
    amount: float | None = None

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
    poses: Sequence[Doubles],
    camera: CameraModel,
    render: Callable[[CameraModel], Floats],
    job: Mapping[str, object],
) -> Shots:
    """Return the frames of a path."""

    def frame(n: int) -> Levels:
        return as_levels(render(camera.moved(poses[n])))

    path, intrinsics = fingerprint(np.stack(poses)), camera_words(camera)
    return Shots(len(poses), frame, {**job, "path": path, "intrinsics": intrinsics})


def camera_words(camera: CameraModel) -> list[str]:
    """Return a camera's parameters, without its pose, to compare cameras."""
    known = sorted(f"{name} {value}" for name, value in vars(camera).items() if name in OWN)
    return [type(camera).__name__, *known]


def on_screen(warped: Warped, *, has_alpha: bool, background: Background) -> Floats:
    """Return a warped picture (H, W, 3) as a screen shows it, 0..1."""
    channels = warped.image.shape[2] - has_alpha
    if channels not in (1, 3):
        raise ValueError(f"a picture of {channels} channels; gray and RGB ones can be shown")
    from resample.measuring.compare import shown

    image = warped.image
    if not has_alpha:
        coverage = np.clip(warped.coverage, 0.0, 1.0)[..., None]
        image = np.concatenate([image, coverage], axis=2, dtype=np.float32)
    return shown(image, background)


def stepped(move: Sequence[float], turn: Sequence[float] = (0.0, 0.0, 0.0)) -> Doubles:
    """Return the pose (4, 4) of a camera after a move and a turn, in its previous axes.

    `move`: to the right, down and forward, scene units. `turn`: to the right, up and clockwise,
    degrees; in this order, each about the camera's new axes.
    """
    yaw, pitch, roll = np.radians(np.asarray(turn, np.float64))
    axes = _about(1, yaw) @ _about(0, pitch) @ _about(2, roll)  # columns: the new axes in the old
    pose = np.eye(4)
    pose[:3, :3] = axes.T
    pose[:3, 3] = -axes.T @ np.asarray(move, np.float64)
    return pose


def _about(axis: int, angle: float) -> Doubles:
    """Return the rotation (3, 3) about a camera's axis; 0 is x."""
    cosine, sine = math.cos(angle), math.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    turned = np.eye(3)
    turned[[first, second], [first, second]] = cosine
    turned[first, second], turned[second, first] = -sine, sine
    return turned
