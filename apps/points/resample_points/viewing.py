"""Point clouds in the viewer's page, and `picture` without a page.

The page's state is a set of `render` options.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample.cameras.models import Camera
from resample.command.session import Session
from resample.command.settings import Choices, FrameFormat
from resample.files.animations import write_film
from resample.files.saving import screen_levels
from resample.view.exports import KEYFRAMES, ORBITING, keyframes_as_toml
from resample.view.files import FileView, image_of, path_file
from resample.view.views import (
    PagePicture,
    Settings,
    Size,
    chosen,
    option_of,
    pixel_at,
    preview_size,
    settings_of,
)
from resample.watching import Cancel, Progress, cancellable
from resample_points.command.animation import film_of, path_of
from resample_points.command.cameras import cameras_of, start_of
from resample_points.command.choices import CloudAim, CloudOptions
from resample_points.command.rendering import CloudScene, scene_of
from resample_points.files.readers import is_cloud
from resample_points.geometry.framing import FIELD
from resample_points.geometry.spacing import Surfels

if TYPE_CHECKING:
    from PIL.Image import Image

    from resample.view.widgets import Viewer

COMMAND, FILM = "resample-points render", "resample-points animate"
RATE = 24.0  # frames per second, of the command
SHOWN = (CloudOptions, CloudAim, FrameFormat)  # options that a page can change
LEFT_OUT = ("size", "bits", "color-bar")
OF_FILMS = [  # options that pictures and films share
    *(option_of(CloudOptions, field) for field in CloudOptions.model_fields),
    *("steady", "size", "background"),
]
FEW = 200_000  # most points of previews
PREPARED = (
    "color_by",
    "colormap",
    "span",
    "disc_limit",
    "level",
    "no_cache",
)  # options that a prepared scene depends on


class _CloudRequest(NamedTuple):
    """Checked options of a page."""

    options: CloudOptions
    aim: CloudAim
    form: FrameFormat


@dataclass
class CloudPainter:
    """Painter of a cloud for one page.

    Parameters
    ----------
    path
        File of the cloud.
    """

    path: Path
    _kept: tuple[Any, CloudScene, CloudScene] | None = field(init=False, default=None)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        size = preview_size(size) if quick else size
        with cancellable(cancel):
            request, scene, camera = self._placed(settings, size, quick=quick)
            frame = scene.shown(scene.picture(camera, size[::-1]), request.form)
        return PagePicture(screen_levels(frame.rgba, background=request.form.behind()), quick)

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the position seen at a pixel, see `resample.view.views.Painter`."""
        _, scene, camera = self._placed(settings, size)
        frame = scene.picture(camera, size[::-1])
        row, column = pixel_at(size, x, y)
        depth = float(frame.depth[row, column])
        if not np.isfinite(depth):
            return {}
        place = _place(camera, column + 0.5, row + 0.5, depth)
        return {"position": ", ".join(f"{part:.6g}" for part in place), "depth": f"{depth:.5g}"}

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does.

        Raises
        ------
        ValueError, LookupError, OSError
            An option is not allowed, or a file cannot be read or written.
        """
        request, scene, camera = self._placed(settings, size)
        scene.write(path, scene.picture(camera, size[::-1]), request.form)

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """Return a keyframe file of cameras around the cloud, see `resample.view.views.Filming`."""
        return keyframes_as_toml(cameras, {"fov": FIELD, **settings})

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write a film as `animate` does, see `resample.view.views.Filming`."""
        if unknown := [key for key in settings if key not in (*ORBITING["steered"], *OF_FILMS)]:
            raise ValueError(f"films have no {', '.join(unknown)}; leave that out")
        request, shape = _checked(settings), size[::-1]
        with path_file(KEYFRAMES, keyframes) as file:
            viewpoints = path_of(
                str(file), None, RATE, start_of(request.aim.camera, request.aim.up)
            )
        scene = self._scene(request.options)[0]._replace(options=request.options)
        cameras = cameras_of(scene.surfels, viewpoints, shape, steady=request.aim.steady)
        behind = request.form.behind() or (0.0, 0.0, 0.0)
        write_film(path, film_of(scene, cameras, shape, behind), RATE, progress=progress)

    def surfels(self, settings: Settings) -> Surfels:
        """Return the prepared cloud; raises as `save` does."""
        return self._scene(_checked(settings).options)[0].surfels

    def _placed(
        self, settings: Settings, size: Size, *, quick: bool = False
    ) -> tuple[_CloudRequest, CloudScene, Camera]:
        """Return the options, the cloud or its preview, and the camera."""
        request = _checked({**settings, "size": f"{size[0]}x{size[1]}"})
        whole, few = self._scene(request.options)
        camera = request.aim.camera_for(whole.surfels, size[::-1])
        scene = few if quick else whole
        return request, scene._replace(options=request.options), camera

    def _scene(self, look: CloudOptions) -> tuple[CloudScene, CloudScene]:
        """Return the prepared cloud and its preview, cached until their options change."""
        key = tuple(getattr(look, name) for name in PREPARED)
        if self._kept is None or self._kept[0] != key:
            scene = scene_of(Session(), self.path, look)
            self._kept = key, scene, scene._replace(surfels=_fewer(scene.surfels))
        return self._kept[1:]


def cloud_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a point cloud."""
    first = CloudPainter(path)
    settings = {"camera": "30/20/1", "steady": True, **settings_of(begin)}

    def described() -> dict[str, Any]:
        return {
            "title": path.name,
            "subtitle": f"{len(first.surfels(settings).position):,} points",
            "command": COMMAND,
            "film": {"command": FILM, "options": OF_FILMS, **ORBITING},
            "package": "resample_points",
            "inputs": [str(path)],
            "settings": settings,
        }

    return FileView(first, described, _checked, left_out=LEFT_OUT)


def view(cloud: str | Path, /, **settings: Any) -> "Viewer":
    """Show a point cloud in a notebook's cell: navigate, copy the Python code.

    Parameters
    ----------
    cloud
        File of the cloud.
    settings
        Initial options of `resample-points render`: `color_by="z"`.

    Returns
    -------
    A widget with `settings`, `frame` and `to_python()`. It needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError
        An option is invalid, or the file cannot be read.

    Examples
    --------
    >>> import resample
    >>> from resample_points import view
    >>> view(resample.sample_path("sample:knot-points"), camera="top").settings["camera"]
    'top'
    """
    from resample.view.widgets import Viewer, named

    return Viewer(cloud_view(Path(cloud)), named(settings))


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file of a cloud."""
    if len(names) != 1 or not Path(names[0]).is_file():
        return False
    return is_cloud(Path(names[0]))


def picture(path: str | Path, settings: Mapping[str, Any]) -> "Image":
    """Return the picture that `resample-points render` makes with these options.

    Parameters
    ----------
    path
        File of the cloud.
    settings
        Options by name, as in settings files: `{"camera": "40/20/1.5", "up": "y"}`.

    Returns
    -------
    A Pillow image of 8 bits per channel.

    Raises
    ------
    ValueError, LookupError, OSError
        As the command does.
    """
    size = _checked(settings).form.height_and_width()[::-1]
    return image_of(CloudPainter(Path(path)), settings, size)


def _checked(settings: Settings) -> _CloudRequest:
    """Return the options, checked."""
    request = _CloudRequest(*chosen(settings, SHOWN))
    request.aim.check()
    request.options.check(Path("picture.png"), request.form.height_and_width()[0])
    return request


def _fewer(surfels: Surfels) -> Surfels:
    """Thin out the points, enlarging those that stay."""
    per = -(-len(surfels.position) // FEW)
    if per < 2:
        return surfels
    return surfels._replace(
        position=np.ascontiguousarray(surfels.position[::per]),
        axes=np.ascontiguousarray(surfels.axes[::per] * np.float32(np.sqrt(per))),
        color=np.ascontiguousarray(surfels.color[::per]),
    )


def _place(camera: Camera, x: float, y: float, depth: float) -> Any:
    """Return the scene position (3,) at a depth behind a point of the picture."""
    ray = np.linalg.solve(camera.matrix, [x, y, 1.0])
    pose = camera.world_to_camera
    return pose[:3, :3].T @ (depth * ray / ray[2] - pose[:3, 3])
