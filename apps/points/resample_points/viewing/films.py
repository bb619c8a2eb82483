"""Films of a page: through its keyframes, around what a file holds."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from resample.command.settings import FrameFormat
from resample.files.animations import write_film
from resample.view.exports import KEYFRAMES, ORBITING, keyframes_as_toml
from resample.view.files import path_file
from resample.view.views import Settings
from resample.watching import Progress
from resample_points.command.choices import CloudStart
from resample_points.command.kinds import Filmed
from resample_points.command.rendering import path_of
from resample_points.geometry.framing import FIELD
from resample_points.scenes import cameras_of

FILM = "resample-points animate"
RATE = 24.0  # frames per second, of the command
AROUND = ("steady", "size", "background")  # options that all pictures and films share


def film_facts(options: Sequence[str]) -> dict[str, Any]:
    """Return what a page is told of films, which have these options."""
    return {"command": FILM, "options": [*options], **ORBITING}


def orbit_keyframes(cameras: Sequence[str], settings: Settings) -> str:
    """Return a keyframe file of cameras, see `resample.view.views.Filming`."""
    return keyframes_as_toml(cameras, {"fov": FIELD, **settings})


def check_film_settings(settings: Settings, options: Sequence[str]) -> None:
    """Refuse options of pictures that films do not have."""
    if unknown := [key for key in settings if key not in (*ORBITING["steered"], *options)]:
        raise ValueError(f"films have no {', '.join(unknown)}; leave that out")


def write_page_film(
    scene: Filmed, aim: CloudStart, form: FrameFormat, shape: tuple[int, int], keyframes: str,
    path: Path, progress: Progress,
) -> None:  # fmt: skip
    """Write the film that `animate` writes for a page's keyframes."""
    turned = scene.upright(aim)
    with path_file(KEYFRAMES, keyframes) as file:
        viewpoints = path_of(str(file), None, RATE, turned.start())
    cameras = cameras_of(scene.framing, viewpoints, shape, steady=turned.steady)
    film = scene.film(cameras, shape, form.behind() or (0.0, 0.0, 0.0))
    write_film(path, film, RATE, progress=progress)
