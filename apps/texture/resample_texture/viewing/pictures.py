"""Pictures in the viewer's page, and `picture` without a page."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from resample.command.settings import Written
from resample.files.exchange import levels_of
from resample.view.files import LITTLE, file_of, levels_in
from resample.view.views import PagePicture, Settings, Size, chosen, pixel_at, settings_of
from resample.watching import Cancel, cancellable
from resample_texture.arguments import geometry_of
from resample_texture.command.choices import Besides, PictureWarping, WarpGeometry, region
from resample_texture.command.inputs import PictureTarget, target_of
from resample_texture.command.jobs import Job, warp_file
from resample_texture.scenes import PictureScene

if TYPE_CHECKING:
    from PIL.Image import Image

COMMAND = "resample-texture warp"
SHOWN = (WarpGeometry, PictureWarping, Written, Besides)  # option models that a page can change
PLACES = {"matrix", "corners", "map", "flow", "lens"}
SUFFIXES, TIFF = (".png", ".jpg", ".jpeg", ".exr", ".webp", ".bmp"), (".tif", ".tiff")
KINDS = ("2,0,0,0,2,0", "0.3,0,0,0,0.3,0", "0.3,0.1,0,0,0.5,0,0.01,0.01,1")  # matrices
LEFT_OUT = ("size", "roi", "bits", "total")


@dataclass
class PicturePainter:
    """Painter of a picture for one page.

    Parameters
    ----------
    path
        File of the picture.
    """

    path: Path
    _scene: PictureScene = field(init=False)

    def __post_init__(self) -> None:
        self._scene = PictureScene(self.path)

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        if not quick:
            with cancellable(cancel):
                return PagePicture(levels_in(self.file(settings, size, ".png")), is_preview=False)
        target, warping = self._target(settings, size)
        geometry = geometry_of(target.places, target.shape, "corner", inverse=False)
        made = self._scene.render(
            geometry, size=target.shape[::-1], edge=warping.edge, quality="preview", cancel=cancel
        )
        return PagePicture(levels_of(made, "color"), is_preview=True)

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the texel at a pixel, see `resample.view.views.Painter`."""
        target, warping = self._target(settings, size)
        ids = self._scene.sample_ids(target.places, size=target.shape[::-1], edge=warping.edge)
        row, column = ids[pixel_at(target.shape[::-1], x, y)].tolist()
        if row < 0:
            return {}
        texel = np.atleast_1d(self._scene.image[row, column])
        return {
            "column": column,
            "row": row,
            "value": ", ".join(f"{value:.6g}" for value in texel.tolist()),
        }

    def file(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """Return the file that the command writes."""
        return _written(self.path, {**settings, "size": f"{size[0]}x{size[1]}"}, suffix)

    def _target(self, settings: Settings, size: Size) -> tuple[PictureTarget, PictureWarping]:
        place, warping, *_ = _checked({**settings, "size": f"{size[0]}x{size[1]}"})
        shape = self._scene.image.shape[:2]
        return target_of(place, (shape[0], shape[1])), warping


@dataclass
class PictureView:
    """A picture for the viewer's pages.

    Parameters
    ----------
    path
        File of the picture.
    begin
        Initial options.
    controls
        Controls from `resample.view.views.controls_of`; empty: a page without controls.
    """

    path: Path
    begin: Sequence[Any] = ()
    controls: Sequence[dict[str, Any]] = ()

    @cached_property
    def about(self) -> dict[str, Any]:
        """Facts for the page, see `resample.view.views.Viewable`."""
        image = PictureScene(self.path).image
        height, width = image.shape[:2]
        begin = settings_of(self.begin)
        places = PLACES & begin.keys()
        return {
            "title": self.path.name,
            "subtitle": f"{width} × {height}, {image.dtype}",
            "command": COMMAND,
            "package": "resample_texture",
            "inputs": [str(self.path)],
            "controls": [control for control in self.controls if control["key"] not in LEFT_OUT],
            "gestures": "corners",
            "extent": [width, height],
            "settings": begin if places else {**begin, "corners": ""},  # the page fits them
        }

    def check(self, settings: Settings | None = None) -> None:
        """Read the picture and try options, see `resample.view.views.Viewable`."""
        self.painter()
        if settings is not None:
            _checked(settings)

    def painter(self) -> PicturePainter:
        """What paints for a page that has been opened."""
        return PicturePainter(self.path)

    def warm(self) -> Iterator[None]:
        """Compile the kernels by small pictures, see `views.Warming`."""
        painter = self.painter()
        for matrix in KINDS:
            painter.paint({"matrix": matrix}, (LITTLE, LITTLE), quick=False, cancel=Cancel())
            yield

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """Return the file that the command would write."""
        return self.painter().file(settings, size, suffix)


def suits(names: Sequence[str]) -> bool:
    """Whether the names are one file with one picture."""
    import cv2

    if len(names) != 1 or not Path(names[0]).is_file():
        return False
    suffix = Path(names[0]).suffix.lower()
    if suffix in TIFF:
        return bool(cv2.imcount(names[0]) == 1)  # several pages may be a volume
    return suffix in SUFFIXES


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

    return Image.fromarray(levels_in(_written(Path(path), settings, ".png")))


def _checked(settings: Settings) -> list[Any]:
    """Return the option models, checked."""
    models = chosen(settings, SHOWN)
    place, warping, *_ = models
    place.check()
    warping.check()
    return models


def _written(path: Path, settings: Settings, suffix: str) -> bytes:
    """Return the file that the command writes of a picture."""
    place, warping, written, besides = _checked(settings)
    job = Job(partial(target_of, place), warping, written.options(), region(besides.roi))
    return file_of(lambda target: warp_file(path, target, job), suffix)
