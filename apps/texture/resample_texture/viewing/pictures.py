"""Pictures in the viewer's page, and `picture` without a page."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resample import registry
from resample.command.session import Session
from resample.command.settings import Written, chosen
from resample.files.conversion import levels_of
from resample.progress import Cancel, cancellable
from resample.view.files import FileView, file_of, levels_in
from resample.view.views import PagePicture, Settings, Size, settings_of
from resample_texture.command.choices import (
    Outputs,
    PictureTarget,
    PictureWarping,
    WarpGeometry,
    region,
)
from resample_texture.command.jobs import Job, warp_file
from resample_texture.geometry.mappings import Homography
from resample_texture.scenes import PictureScene

if TYPE_CHECKING:
    from PIL.Image import Image

COMMAND = "resample-texture warp"
SHOWN = (WarpGeometry, PictureWarping, Written, Outputs)  # option models that a page can change
PLACES = {"matrix", "corners", "map", "flow", "lens"}
KINDS = [
    {"matrix": matrix}
    for matrix in ("2,0,0,0,2,0", "0.3,0,0,0,0.3,0", "0.3,0.1,0,0,0.5,0,0.01,0.01,1")
]
LEFT_OUT = ("size", "roi", "bits", "file-quality", "total")


@dataclass
class PicturePainter:
    """Painter of a picture for one page."""

    path: Path
    scene: PictureScene = field(init=False)

    def __post_init__(self) -> None:
        self.scene = PictureScene(self.path)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        if not quick:
            with cancellable(cancel):
                made = file_of(partial(self.save, settings, size), ".png")
            view = self._view(self._target(settings, size)[0])
            return PagePicture(levels_in(made), False, view)
        target, warping = self._target(settings, size)
        geometry = target.geometry
        shown = self.scene.render(
            geometry, size=target.shape[::-1], edge=warping.edge, quality="preview", cancel=cancel
        )
        return PagePicture(levels_of(shown, "color"), True, self._view(target))

    def _view(self, target: PictureTarget) -> dict[str, Any]:
        """Return the mapping of the picture's places, px, to the target, if it is a matrix."""
        if not isinstance(target.geometry, Homography):
            return {}
        matrix = target.geometry.oriented(self.scene.image.shape[:2])
        plane = matrix * (1.0, 1.0, 0.0)  # all of it at the third coordinate 0
        return {
            "view": {
                "rotation": plane.tolist(),
                "translation": matrix[:, 2].tolist(),
                "focal": (1.0, 1.0),
                "principal": (0.0, 0.0),
                "perspective": True,
                "size": target.shape[::-1],
            }
        }

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the texel at a pixel, see `resample.view.views.Painter`."""
        target, warping = self._target(settings, size)
        found = self.scene.pick(x, y, target.places, size=target.shape[::-1], edge=warping.edge)
        if found is None:
            return {}
        row, column = found
        place = [column + 0.5, row + 0.5, 1.0]
        if isinstance(target.geometry, Homography):
            place = (target.geometry.inverse() @ (x, y, 1.0)).tolist()
        texel = np.atleast_1d(self.scene.image[row, column])
        return {
            "column": column,
            "row": row,
            "value": ", ".join(f"{value:.6g}" for value in texel.tolist()),
            "position": ", ".join(f"{part / place[2]:.6g}" for part in place[:2]),
        }

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does."""
        _write(self.path, {**settings, "size": f"{size[0]}x{size[1]}"}, path)

    def __copy__(self) -> "PicturePainter":
        """Painter for another page, which reads the picture again."""
        return PicturePainter(self.path)

    def _target(self, settings: Settings, size: Size) -> tuple[PictureTarget, PictureWarping]:
        place, warping, *_ = _checked({**settings, "size": f"{size[0]}x{size[1]}"})
        shape = self.scene.image.shape[:2]
        return place.target((shape[0], shape[1])), warping


def picture_view(path: Path, begin: Sequence[Any] = ()) -> FileView:
    """Return what pages show of a picture, with initial options."""
    first, given = PicturePainter(path), settings_of(begin)

    def described() -> dict[str, Any]:
        height, width = first.scene.image.shape[:2]
        return {
            "title": path.name,
            "subtitle": f"{width} × {height}, {first.scene.image.dtype}",
            "names": {"method": registry.names("methods")},
            "command": COMMAND,
            "package": "resample_texture",
            "inputs": [str(path)],
            "gestures": "corners",
            "extent": [width, height],
            "measures": True,
            "unit": "px",
            "settings": given if PLACES & given.keys() else {**given, "corners": ""},  # page fits
        }

    return FileView(first, described, _checked, KINDS, LEFT_OUT)


def fitted(extent: Size, size: Size) -> str:
    """Return corners, px, of a picture in the middle: 1:1, or smaller where a target is small."""
    (across, down), (width, height) = extent, size
    scale = min(1.0, width / across, height / down)
    left, top = round((width - scale * across) / 2), round((height - scale * down) / 2)
    right, bottom = left + scale * across, top + scale * down
    return f"{left:g},{top:g} {right:g},{top:g} {right:g},{bottom:g} {left:g},{bottom:g}"


def picture(path: str | Path, settings: Mapping[str, Any]) -> "Image":
    """Return the picture that `resample-texture warp` makes with these options.

    Parameters
    ----------
    path
        File of the picture.
    settings
        Options by name, as in settings files: `{"corners": "0,0 90,9 90,90 0,99"}`.

    Returns
    -------
    A Pillow image of 8 bits per channel.

    Raises
    ------
    ValueError, LookupError, OSError
        As the command does.
    """
    from PIL import Image

    written = file_of(partial(_write, Path(path), settings), ".png")
    return Image.fromarray(levels_in(written))


def _checked(settings: Settings) -> list[Any]:
    """Return the option models, checked."""
    models = chosen(settings, SHOWN)
    place, warping, *_ = models
    place.check()
    warping.check()
    return models


def _write(source: Path, settings: Settings, path: Path) -> None:
    """Write the file that the command writes of a picture."""
    place, warping, written, outputs = _checked(settings)
    job = Job(place.target, warping, written.options(), region(outputs.roi))
    warp_file(Session(), source, path, job)
