"""Depth images in the viewer's page, and `picture` without a page.

The page's state is a set of `render` options.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from resample import registry
from resample.cameras.files import read_pose
from resample.cameras.models import Camera
from resample.cameras.panoramic import Equirectangular
from resample.command.session import Session
from resample.command.settings import Choices, Written, chosen, option_of
from resample.console import film_background
from resample.files.animations import write_film
from resample.files.formats import WriteOptions, page_of
from resample.files.pictures import Kind, Picture
from resample.files.saving import write_picture
from resample.files.writing import save_array
from resample.progress import Cancel, Progress, cancellable
from resample.scene import pixel_at, position_at, preview_size
from resample.view.files import FileView, image_of, path_file, shown
from resample.view.views import STEP, PagePicture, Settings, Size, placed_by, settings_of
from resample_warp3d.command.animation import Range, poses_of, shots
from resample_warp3d.command.choices import Depth, DepthWarping, Joint, Showing
from resample_warp3d.command.inputs import DepthReader, Inputs, read_views, view_names
from resample_warp3d.command.rendering import Prepared, film_of, joined, joining_of, prepared
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.command.target import Aim, TargetCamera
from resample_warp3d.command.writing import made_of
from resample_warp3d.projection_models import CameraModel
from resample_warp3d.types import Hole, Warped

if TYPE_CHECKING:
    from PIL.Image import Image

    from resample.view.widgets import Viewer

COMMAND = "resample-warp3d render"
# Options that a page changes
SHOWN = (SourceCamera, Depth, Aim, Joint, DepthWarping, Written, Showing)
RATE = 24.0  # frames per second, of the command
EACH = round(STEP * RATE)  # frames from one keyframe to the next
MODELS = (SourceCamera, Depth, TargetCamera, DepthWarping)  # option models that the command shares
FILE = "poses.txt"
STEERED = ["move", "turn", "pose"]
OPTIONS = [
    "background",
    *(option_of(model, field) for model in MODELS for field in model.model_fields),
]
COMMON = {"file": FILE, "steered": STEERED, "options": OPTIONS, "each": EACH}
FILM = {"command": "resample-warp3d animate", **COMMON}
LEFT_OUT = ("size", "bits", "file-quality", "export-as")
KINDS: Sequence[Settings] = ({"fill": True}, {"method": "mesh"}, {"method": "mcmillan"})
HOLES = {
    Hole.NONE: "none",
    Hole.DISOCCLUDED: "hidden in the source",
    Hole.OUTSIDE: "outside of the source",
    Hole.NO_DEPTH: "without depth",
    Hole.CRACK: "a crack that is filled",
}


class _DepthRequest(NamedTuple):
    """Checked options of a page."""

    eye: SourceCamera
    meaning: Depth
    aim: Aim
    joint: Joint
    warping: DepthWarping
    written: Written
    showing: Showing

    @property
    def options(self) -> WriteOptions:
        """Format of the picture to write."""
        if self.warping.unmixed:
            return WriteOptions(self.written.bits, is_light=False)
        return self.written.options()


class _Rendering(NamedTuple):
    """A rendered view and its options."""

    request: _DepthRequest
    kind: Kind
    warped: Warped
    target: CameraModel  # camera of the view

    def picture(self) -> Picture:
        """Return the picture to write."""
        request = self.request
        return made_of(self.warped, self.kind, request.warping, request.showing.show)


@dataclass
class DepthPainter:
    """Painter of a depth image for one page.

    `color`, `depth`: files, as the command takes them. `further`: further views, COLOR,DEPTH,POSE.
    """

    color: str
    depth: str
    further: Sequence[str] = ()
    _ready: tuple[Any, tuple[Inputs, list[Prepared]]] | None = field(init=False, default=None)
    _last: _Rendering | None = field(init=False, default=None)  # the view to pick from

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        with cancellable(cancel):
            if quick:
                size = preview_size(size)
                seen = self._rendered(settings, size)
            else:
                seen = self._last = self._rendered(settings, size)
            page = page_of(Path("picture.png"), seen.picture(), seen.request.options)
        return PagePicture(shown(page.data), quick, placed_by(seen.target, size))

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return depth, magnification and more of a pixel, see `resample.view.views.Painter`."""
        seen = self._last
        if seen is None or seen.warped.coverage.shape != size[::-1]:
            seen = self._rendered(settings, size)
        warped = seen.warped
        at = pixel_at(size, x, y)
        hole = HOLES[Hole(int(warped.holes[at]))]
        if not np.isfinite(warped.depth[at]):
            return {"hole": hole}
        target, position = seen.target, {}
        if not isinstance(target, Equirectangular) and placed_by(target, size):
            place = position_at(target.view(), at, float(warped.depth[at])).tolist()
            position = {"position": ", ".join(f"{part:.6g}" for part in place)}
        return {
            "depth": f"{warped.depth[at]:.5g}",
            "magnification": f"{warped.magnification[at]:.3g}",
            "confidence": f"{warped.confidence[at]:.2f}",
            "hole": hole,
            **position,
        }

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file cannot be read
        or written.
        """
        seen = self._rendered(settings, size)
        write_picture(path, seen.picture(), seen.request.options)

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """Return a file of poses, see `resample.view.views.Filming`.

        Poses are from world to camera, four lines each; cameras are `move;turn`, relative to the
        initial one.
        """
        pose, poses = settings.get("pose"), []
        start = (
            self.taken(settings).camera.world_to_camera if pose is None else read_pose(str(pose))
        )
        for camera in cameras:
            move, _, turn = camera.partition(";")
            moved = np.asarray(Aim(move=move, turn=turn or "0,0,0").step() @ start)
            rows = [" ".join(repr(float(number)) for number in row) for row in moved]
            poses.append("\n".join(rows) + "\n")
        return "\n".join(poses)

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write a film through poses as `animate` does, see `resample.view.views.Filming`."""
        if self.further:
            raise ValueError("films are made from one view; open the page without --view")
        given = {key: value for key, value in settings.items() if key not in STEERED}
        if unknown := [key for key in given if key not in OPTIONS]:
            raise ValueError(f"films have no {', '.join(unknown)}; leave that out")
        background = film_background(str(given.pop("background", "black")))
        spelled = {**given, "size": f"{size[0]}x{size[1]}"}
        eye, meaning, target, warping = chosen(spelled, MODELS)
        target.check_target()
        taken = read_views(DepthReader.checked(eye, meaning), self.color, self.depth)
        with path_file(FILE, keyframes) as file:
            frames = EACH * (len(keyframes.split("\n\n")) - 1) + 1
            camera = target.camera_model(taken.camera, taken.shape, eye.convention)
            way = poses_of(str(file), frames, None, camera.world_to_camera, Range(1.0, 1.0))
        film = film_of(Session(), taken, size[::-1], warping, background)
        write_film(path, shots(way, camera, film.frame, film.job), RATE, progress=progress)

    def taken(self, settings: Settings) -> Inputs:
        """Return the files, read and prepared; errors as in `save`."""
        return self._sources(_checked(settings))[0]

    def _rendered(self, settings: Settings, size: Size) -> _Rendering:
        request = _checked({**settings, "size": f"{size[0]}x{size[1]}"})
        taken, sources = self._sources(request)
        target = request.aim.camera_model(taken.camera, taken.shape, request.eye.convention)
        joining = joining_of(taken, request.joint, unmixed=request.warping.unmixed)
        together = joined(Session(), sources, target, size[::-1], request.warping, joining)
        return _Rendering(request, taken.picture.kind, together.warped, target)

    def _sources(self, request: _DepthRequest) -> tuple[Inputs, list[Prepared]]:
        """Return the sources, read and prepared; cached while only the camera moves."""
        eye, meaning, warping = request.eye, request.meaning, request.warping
        key = eye, meaning, warping.noise, warping.refine, warping.unmixed, warping.has_layer
        if self._ready is None or self._ready[0] != key:
            reader = DepthReader.checked(eye, meaning, labels=warping.unmixed)
            further = [view_names(text) for text in self.further]
            taken = read_views(reader, self.color, self.depth, further)
            self._ready = key, (taken, prepared(Session(), taken.views, warping))
        return self._ready[1]


def depth_view(
    color: str,
    depth: str,
    begin: Sequence[Choices] = (),
    further: Sequence[str] = (),
) -> FileView:
    """Return what pages show of a depth image.

    `color`, `depth`: files, as the command takes them. `begin`: initial options. `further`: further
    views, COLOR,DEPTH,POSE.
    """
    first = DepthPainter(color, depth, further)
    settings = {"move": "0,0,0", **settings_of(begin)}

    def described() -> dict[str, Any]:
        taken = first.taken(settings)
        height, width = taken.shape
        focal = []  # of a pinhole, and its principal point
        if isinstance(taken.camera, Camera):
            focal = [float(taken.camera.matrix[n]) for n in ((0, 0), (1, 1), (0, 2), (1, 2))]
        far = Range.of(np.concatenate([view.image.nearness.ravel() for view in taken.views]))
        return {
            "title": Path(color).name,
            "subtitle": f"{width} × {height}, from {far.near:.4g} on, mostly {far.middle:.4g}",
            "command": COMMAND,
            "package": "resample_warp3d",
            "inputs": [color, depth],
            "fixed": {"view": list(further)} if further else {},
            **({} if further else {"film": FILM}),
            "names": {"method": registry.names("warps")},
            "gestures": "walk",
            "extent": [width, height],
            "distance": [far.near, far.middle],
            "focal": focal,
            "measures": True,
            "settings": settings,
        }

    kinds = [{**settings, **kind} for kind in KINDS]
    return FileView(first, described, _checked, kinds, LEFT_OUT)


def view(color: Any, depth: Any, /, **settings: Any) -> "Viewer":
    """Show a depth image in a notebook's cell: navigate, copy the Python code.

    Parameters
    ----------
    color
        Picture of a depth image: a file, or 8 or 16 bits as `as_picture` takes them. Arrays are
        written to temporary files that live as long as the widget.
    depth
        Depth of the picture: a file, or an array (H, W).
    settings
        Initial options of `resample-warp3d render`: `fov=60`.

    Returns
    -------
    A widget with `settings`, `frame` and `to_python()`. It needs the extra `notebook`.

    Raises
    ------
    ValueError, LookupError, OSError, TypeError
        An option is invalid, or a file cannot be read.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import view
    >>> shown = view(np.zeros((24, 32, 3), np.uint8), np.full((24, 32), 2.0), fov=60)
    >>> shown.frame.size
    (480, 360)
    """
    from resample.view import widgets

    picture, folder = widgets.kept("color.png", color, widgets.write_levels)
    file, folder = widgets.kept("depth.npy", depth, save_array, folder)
    begin = widgets.named(settings)
    return widgets.Viewer(depth_view(picture, file, chosen(begin, SHOWN)), begin, folder)


def picture(color: str | Path, depth: str | Path, settings: Mapping[str, Any]) -> "Image":
    """Return the picture that `resample-warp3d render` makes with these options.

    Parameters
    ----------
    color, depth
        Files, as the command takes them.
    settings
        Options by name, as in settings files: `{"fov": 60, "move": "0.1,0,0"}`.

    Returns
    -------
    A Pillow image of 8 bits per channel.

    Raises
    ------
    ValueError, LookupError, OSError
        As the command does.
    """
    given = dict(settings)
    painter = DepthPainter(str(color), str(depth), given.pop("view", ()))
    (aim,) = (part for part in _checked(given) if isinstance(part, Aim))
    size = aim.shape(painter.taken(given).shape)[::-1]
    return image_of(painter, given, size)


def _checked(settings: Settings) -> _DepthRequest:
    """Return the options, checked."""
    request = _DepthRequest(*chosen(settings, SHOWN))
    request.aim.check()
    request.showing.check(unmixed=request.warping.unmixed)
    request.warping.built()
    return request
