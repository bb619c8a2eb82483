"""3D Gaussians in the viewer's page."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from resample.cameras.models import Camera
from resample.command.session import Session
from resample.command.settings import Choices, FrameFormat, chosen, option_of
from resample.files.saving import screen_levels
from resample.outofcore.passes import Memo, memoizing
from resample.progress import Cancel, cancellable
from resample.scene import PER, enlarged, pixel_at, place_at, preview_size
from resample.view.files import FileView
from resample.view.views import PagePicture, Settings, Size, placed_by, settings_of
from resample_points.command.choices import CloudAim, CloudOptions
from resample_points.command.gaussians import (
    SHARED,
    GaussianOptions,
    GaussianPictures,
    gaussians_of,
)
from resample_points.viewing.films import AROUND, FilmPainter, page_facts

SHOWN = (CloudOptions, GaussianOptions, CloudAim, FrameFormat)  # options that a page can change
OF_CLOUDS = [
    option_of(CloudOptions, name) for name in CloudOptions.model_fields if name not in SHARED
]
LEFT_OUT = ("size", "bits", *OF_CLOUDS)
OF_FILMS = [  # options that pictures and films share
    *(option_of(GaussianOptions, name) for name in GaussianOptions.model_fields),
    *(option_of(CloudOptions, name) for name in SHARED),
    *AROUND,
]
READ_WITH = ("also", "crop", "least_opacity", "largest")  # options that the scene depends on


@dataclass
class GaussianPainter(FilmPainter):
    """Painter of 3D Gaussians for one page.

    `path`: file of the scene.
    """

    path: Path
    of_films = OF_FILMS
    _kept: tuple[Any, GaussianPictures] | None = field(init=False, default=None)
    _found: Memo = field(init=False, default_factory=dict)  # of the scene that is kept

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        with cancellable(cancel):
            form, scene, camera = self._placed(settings, size)
            shape = size[::-1]
            if quick and isinstance(camera, Camera):
                few = preview_size(size)
                eye = replace(camera, matrix=np.diag([1 / PER, 1 / PER, 1.0]) @ camera.matrix)
                options = scene.options.model_copy(update={"subpixels": 1, "order": "depth"})
                shown = replace(scene.fewer, options=options)
                small = shown.picture(eye, few[::-1], form.behind())
                levels = screen_levels(small.rgba, background=form.behind())
                levels = enlarged(levels, PER, shape, smooth=True)
            else:
                rgba = scene.picture(camera, shape, form.behind()).rgba
                levels = screen_levels(rgba, background=form.behind())
        return PagePicture(levels, quick, placed_by(camera, size))

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the position seen at a pixel, see `resample.view.views.Painter`."""
        _, scene, camera = self._placed(settings, size)
        frame = scene.picture(camera, size[::-1])
        depth = float(frame.value[pixel_at(size, x, y)])
        place = place_at(camera, x, y, depth) if isinstance(camera, Camera) else None
        if place is None:
            return {}
        return {
            "position": ", ".join(f"{part:.6g}" for part in place),
            "depth": f"{depth:.5g}",
        }

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does.

        Raises ValueError, LookupError, OSError: an option is not allowed, or a file cannot be read
        or written.
        """
        form, scene, camera = self._placed(settings, size)
        scene.write(path, camera, form)

    def filmed(self, settings: Settings) -> tuple[GaussianPictures, CloudAim, FrameFormat]:
        look, options, aim, form = checked(settings)
        return self.scene(look, options), aim, form

    def scene(self, look: CloudOptions, options: GaussianOptions) -> GaussianPictures:
        """Return the scene, cached until the options change that it is read with."""
        given = {**look.model_dump(), **options.model_dump()}
        key = tuple(given[name] for name in READ_WITH)
        if self._kept is None or self._kept[0] != key:
            self._kept, self._found = (key, gaussians_of(Session(), self.path, look, options)), {}
        kept = self._kept[1]
        if (kept.options, kept.threads) != (options, look.threads):
            kept = replace(kept, options=options, threads=look.threads)
            self._kept = key, kept
        return kept

    def _placed(self, settings: Settings, size: Size) -> tuple[FrameFormat, GaussianPictures, Any]:
        """Return the picture's format, the scene and the camera."""
        look, options, aim, form = checked({**settings, "size": f"{size[0]}x{size[1]}"})
        scene = self.scene(look, options)
        with memoizing(self._found):
            camera = scene.upright(aim).camera_for(scene.framing, size[::-1])
        return form, scene, camera


def gaussian_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of 3D Gaussians."""
    first = GaussianPainter(path)
    given = settings_of(begin)

    def described() -> dict[str, Any]:
        look, options, *_ = checked(given)
        scene = first.scene(look, options)
        settings = {"camera": "30,20,1", "up": scene.up, "steady": True, **given}
        count = f"{scene.count:,} Gaussians"
        return page_facts(path, count, OF_FILMS, settings, begin, scene.framing)

    return FileView(first, described, checked, left_out=LEFT_OUT)


def checked(
    settings: Settings,
) -> tuple[CloudOptions, GaussianOptions, CloudAim, FrameFormat]:
    """Return the options, checked."""
    look, options, aim, form = chosen(settings, SHOWN)
    if others := [name for name in look.model_fields_set if name not in SHARED]:
        raise ValueError(f"{min(others)} is an option of clouds of points; leave it out")
    aim.check()
    options.check()
    form.behind()
    return look, options, aim, form
