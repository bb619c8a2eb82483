"""Point clouds in the viewer's page, and `picture` without a page.

The page's state is a set of `render` options.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from resample.cameras.models import Camera
from resample.command.session import Session
from resample.command.settings import Choices, FrameFormat, chosen, option_of
from resample.files.saving import screen_levels
from resample.outofcore.passes import Memo, memoizing
from resample.progress import Cancel, cancellable
from resample.scene import preview_size
from resample.view.files import FileView
from resample.view.views import PagePicture, Settings, Size, placed_by, settings_of
from resample_points.command.choices import CloudAim, CloudOptions
from resample_points.command.rendering import ColoredScene, scene_of
from resample_points.geometry.spacing import Surfels
from resample_points.viewing.films import AROUND, FilmPainter, page_facts

SHOWN = (CloudOptions, CloudAim, FrameFormat)  # options that a page can change
LEFT_OUT = ("size", "bits", "color-bar")
OF_FILMS = [  # options that pictures and films share
    *(option_of(CloudOptions, field) for field in CloudOptions.model_fields),
    *AROUND,
]
# Options that a prepared scene depends on
PREPARED = (
    *("also", "only", "crop", "color_by", "colormap"),
    *("span", "disc_limit", "level", "no_cache"),
)


@dataclass
class CloudPainter(FilmPainter):
    """Painter of a cloud for one page.

    `path`: file of the cloud.
    """

    path: Path
    of_films = OF_FILMS
    _kept: tuple[Any, ColoredScene] | None = field(init=False, default=None)
    _found: Memo = field(init=False, default_factory=dict)  # of the cloud that is kept

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        size = preview_size(size) if quick else size
        with cancellable(cancel):
            form, cloud, camera = self._placed(settings, size, quick=quick)
            frame = cloud.shown(cloud.picture(camera, size[::-1]), form)
        levels = screen_levels(frame.rgba, background=form.behind())
        facts = placed_by(camera, size)
        if cloud.scale is not None and not cloud.scale.classes:
            facts["range"] = {"ends": list(cloud.scale.span), "log": False}
        return PagePicture(levels, quick, facts)

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the position seen at a pixel, see `resample.view.views.Painter`."""
        _, cloud, camera = self._placed(settings, size)
        found = cloud.scene.pick(x, y, camera, size=size, **cloud.choices())
        if found is None:
            return {}
        place = ", ".join(f"{part:.6g}" for part in found.position)
        return {"position": place, "depth": f"{found.depth:.5g}"}

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file cannot be read
        or written.
        """
        form, cloud, camera = self._placed(settings, size)
        cloud.write(path, cloud.picture(camera, size[::-1]), form)

    def filmed(self, settings: Settings) -> tuple[ColoredScene, CloudAim, FrameFormat]:
        look, aim, form = _checked(settings)
        return self._scene(look), aim, form

    def surfels(self, settings: Settings) -> Surfels:
        """Return the prepared cloud; raises as `save` does."""
        return self._scene(_checked(settings)[0]).scene.surfels

    def _placed(
        self, settings: Settings, size: Size, *, quick: bool = False
    ) -> tuple[FrameFormat, ColoredScene, Camera]:
        """Return the picture's format, the cloud or its preview, and the camera."""
        look, aim, form = _checked({**settings, "size": f"{size[0]}x{size[1]}"})
        whole = self._scene(look)
        with memoizing(self._found):
            camera = aim.camera_for(whole.scene.surfels, size[::-1])
        return form, whole._replace(scene=whole.scene.fewer) if quick else whole, camera

    def _scene(self, look: CloudOptions) -> ColoredScene:
        """Return the prepared cloud, cached until its options change."""
        key = tuple(getattr(look, name) for name in PREPARED)
        if self._kept is None or self._kept[0] != key:
            self._kept, self._found = (key, scene_of(Session(), self.path, look)), {}
        return self._kept[1]._replace(options=look)


def cloud_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a point cloud."""
    first = CloudPainter(path)
    settings = {"camera": "30,20,1", "steady": True, **settings_of(begin)}

    def described() -> dict[str, Any]:
        cloud = first.surfels(settings)
        count = f"{len(cloud.position):,} points"
        return page_facts(path, count, OF_FILMS, settings, begin, cloud)

    return FileView(first, described, _checked, left_out=LEFT_OUT)


def _checked(settings: Settings) -> tuple[CloudOptions, CloudAim, FrameFormat]:
    """Return the options, checked."""
    look, aim, form = chosen(settings, SHOWN)
    aim.check()
    look.check(Path("picture.png"), form.height_and_width()[0])
    return look, aim, form
