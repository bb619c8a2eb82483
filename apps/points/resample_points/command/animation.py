"""Films of clouds: paths, frames, and frames made by workers."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from resample.lazy import installed_version
from resample_points.command.cameras import Shape
from resample_points.command.choices import CloudOptions, beside
from resample_points.command.rendering import CloudScene, scene_of

if TYPE_CHECKING:
    from resample.cameras.viewpoints import Viewpoint
    from resample.files.animations import Frames, Shots

PATHS = ("orbit", "sway")
FRAMES = 96
SWAY = 20.0  # degrees to each side


def path_of(path: str, frames: int | None, fps: float, start: "Viewpoint") -> "list[Viewpoint]":
    """Return the viewpoints of all frames of a film.

    Parameters
    ----------
    frames
        Number of frames; None: `FRAMES`, or as many as the keyframes' times (s) need.
    fps
        Frames per second.
    """
    from resample.cameras.viewpoints import Orbit
    from resample.command.films import is_file_of_path, tour_of
    from resample.files.animations import check_count
    from resample_points.geometry.framing import FIELD

    if is_file_of_path(path, PATHS):
        return tour_of(Path(path), frames, fps, FIELD).viewpoints()
    if not isinstance(start, Orbit):
        raise ValueError(
            f"the path {path} goes around the cloud; give --camera as azimuth/elevation/zoom, or a "
            "file of keyframes or poses as --path"
        )
    count = FRAMES if frames is None else frames
    check_count(count)
    turns = [n / count for n in range(count)]
    if path == "sway":
        angles = [start.azimuth + SWAY * math.sin(2.0 * math.pi * turn) for turn in turns]
    else:
        angles = [start.azimuth + 360.0 * turn for turn in turns]
    return [replace(start, azimuth=angle) for angle in angles]


def film_of(scene: CloudScene, cameras: Sequence[Any], shape: Shape, background: Any) -> "Shots":
    """Return the frames of a film of a cloud."""
    import numpy as np

    from resample.files.animations import Shots, fingerprint
    from resample.files.saving import screen_levels

    bar = scene.bar(shape[0], background)

    def frame(n: int) -> Any:
        rgba = beside(scene.picture(cameras[n], shape).rgba, bar, background)
        return screen_levels(rgba, background=background)

    surfels = scene.surfels
    job = {
        "cloud": fingerprint(surfels.origin, surfels.position, surfels.axes, surfels.color),
        "cameras": fingerprint(
            np.stack([camera.matrix for camera in cameras]),
            np.stack([camera.world_to_camera for camera in cameras]),
        ),
        "size": list(shape),
        "look": scene.options.model_dump(exclude={"threads", "no_cache"}),
        "background": list(background),
        "version": installed_version(),
    }
    return Shots(len(cameras), frame, job)


def frames_of(
    file: Path,
    look: CloudOptions,
    cameras: Sequence[Any],
    shape: Shape,
    background: Any,
    threads: int,
) -> "Frames":
    """Return the function that makes frames of a file's cloud."""
    from resample.command.session import Session

    scene = scene_of(Session(), file, look.model_copy(update={"threads": threads}))
    return film_of(scene, cameras, shape, background).frame
