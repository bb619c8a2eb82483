"""Films of depth images through a page's cameras, as `animate` makes them."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from resample.cameras.files import read_pose
from resample.command.session import Session
from resample.command.settings import chosen, option_of
from resample.console import linear_color
from resample.files.animations import write_film
from resample.progress import Progress
from resample.types import Doubles
from resample.view.files import path_file
from resample.view.views import STEP, Settings
from resample_warp3d.command.animation import Range, poses_of, shots
from resample_warp3d.command.choices import Depth, DepthWarping
from resample_warp3d.command.inputs import DepthReader, Inputs, read_views
from resample_warp3d.command.rendering import film_of
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.target import Aim, TargetCamera

RATE = 24.0  # frames per second, of the command
EACH = round(STEP * RATE)  # frames from one keyframe to the next
MODELS = (SourceCamera, Depth, TargetCamera, DepthWarping)  # option models that the command shares
FILE = "poses.txt"
STEERED = ["move", "turn", "pose"]
OPTIONS = [
    "background",
    *(option_of(model, field) for model in MODELS for field in model.model_fields),
]
FILM = {
    "command": "resample-warp3d animate",
    "file": FILE,
    "steered": STEERED,
    "options": OPTIONS,
    "each": EACH,
}


def poses_as_text(cameras: Sequence[str], taken: Inputs, settings: Settings) -> str:
    """Return poses, world to camera, of cameras that a page writes as `move;turn`."""
    pose = settings.get("pose")
    start = taken.camera.world_to_camera if pose is None else read_pose(str(pose))
    return "\n".join(_lines(_step(camera) @ start) for camera in cameras)


def write_depth_film(
    inputs: tuple[str, str],
    settings: Settings,
    size: tuple[int, int],
    poses: str,
    path: Path,
    progress: Progress,
) -> None:
    """Write a film through poses as the command does.

    `size`: width and height, px. `progress`: called with the share that is done.
    """
    given = {key: value for key, value in settings.items() if key not in STEERED}
    if unknown := [key for key in given if key not in OPTIONS]:
        raise ValueError(f"films have no {', '.join(unknown)}; leave that out")
    background = linear_color(str(given.pop("background", "black"))) or (0.0, 0.0, 0.0)
    spelled = {**given, "size": f"{size[0]}x{size[1]}"}
    eye, meaning, target, warping = chosen(spelled, MODELS)
    target.check_target()
    taken = read_views(DepthReader.checked(eye, meaning), *inputs)
    with path_file(FILE, poses) as file:
        frames = EACH * (len(poses.split("\n\n")) - 1) + 1
        camera = target.camera_model(taken.camera, taken.shape, eye.convention)
        way = poses_of(str(file), frames, None, camera.world_to_camera, Range(1.0, 1.0))
    film = film_of(Session(), taken, size[::-1], warping, background)
    write_film(path, shots(way, camera, film.frame, film.job), RATE, progress=progress)


def _step(camera: str) -> Doubles:
    """Return the pose of a camera written as `move;turn`, relative to the initial one."""
    move, _, turn = camera.partition(";")
    return Aim(move=move, turn=turn or "0,0,0").step()


def _lines(pose: Doubles) -> str:
    """Write a pose as four lines, exactly."""
    rows = [" ".join(repr(float(number)) for number in row) for row in np.asarray(pose)]
    return "\n".join(rows) + "\n"
