"""Films of a page: through its keyframes, around what a file holds."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from resample.command.settings import Choices, FrameFormat
from resample.files.animations import write_film
from resample.progress import Progress
from resample.view.files import path_file
from resample.view.views import KEYFRAMES, ORBITING, Settings, Size, is_free, keyframes_as_toml
from resample_points.command.choices import CloudStart
from resample_points.command.films import Filmed
from resample_points.command.rendering import path_of
from resample_points.data.cloud import Cloud
from resample_points.geometry.framing import FIELD, ball_around
from resample_points.geometry.spacing import Surfels
from resample_points.scenes import cameras_of

FILM = "resample-points animate"
RATE = 24.0  # frames per second, of the command
AROUND = ("steady", "size", "background")  # options that all pictures and films share


def page_facts(
    path: Path,
    subtitle: str,
    films: Sequence[str],
    settings: Settings,
    begin: Sequence[Choices],
    cloud: Surfels | Cloud,
) -> dict[str, Any]:
    """Return what a page is told of a file, as `FileView.about`.

    `films`: options that pictures and films share. `settings`: those that the page begins with;
    `begin`: those that are given. `cloud`: what cameras are framed around.
    """
    return {
        "title": path.name,
        "subtitle": subtitle,
        "command": "resample-points render",
        "film": {"command": FILM, "options": [*films], **ORBITING},
        "package": "resample_points",
        "inputs": [str(path)],
        "settings": settings,
        "fills": is_free(begin),
        "measures": True,
        "middle": ball_around(cloud)[0].tolist(),  # where the scale bar holds
    }


class FilmPainter(ABC):
    """Painter that makes films, see `resample.view.views.Filming`."""

    of_films: ClassVar[Sequence[str]]  # options that pictures and films share

    @abstractmethod
    def filmed(self, settings: Settings) -> tuple[Filmed, CloudStart, FrameFormat]:
        """Return what films show, where they start and their format; the options are checked."""

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        return keyframes_as_toml(cameras, {"fov": FIELD, **settings})

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        shared = (*ORBITING["steered"], *self.of_films)
        if unknown := [key for key in settings if key not in shared]:
            raise ValueError(f"films have no {', '.join(unknown)}; leave that out")
        scene, start, form = self.filmed(settings)
        turned = scene.upright(start)
        with path_file(KEYFRAMES, keyframes) as file:
            viewpoints = path_of(str(file), None, RATE, turned.start())
        cameras = cameras_of(scene.framing, viewpoints, size[::-1], steady=turned.steady)
        film = scene.film(cameras, size[::-1], form.behind() or (0.0, 0.0, 0.0))
        write_film(path, film, RATE, progress=progress)
