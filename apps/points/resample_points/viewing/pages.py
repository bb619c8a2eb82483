"""Pages of point clouds and of 3D Gaussians, films of a page, and `picture` without a page.

A page's state is a set of `render` options. Films go through its keyframes.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from resample.cameras.models import Camera
from resample.command.session import Session
from resample.command.settings import Choices, FrameFormat, chosen, option_of
from resample.files.animations import write_film
from resample.files.saving import screen_levels
from resample.outofcore.passes import Memo, memoizing
from resample.progress import Cancel, Progress, cancellable
from resample.scene import PER, enlarged, pixel_at, place_at, preview_size
from resample.view.files import FileView, path_file, picture_function
from resample.view.views import (
    KEYFRAMES,
    ORBITING,
    PagePicture,
    Settings,
    Size,
    is_free,
    keyframes_as_toml,
    placed_by,
    settings_of,
)
from resample_points.command.choices import CloudAim, CloudOptions, CloudStart
from resample_points.command.gaussians import (
    SHARED,
    GaussianOptions,
    GaussianPictures,
    gaussians_of,
)
from resample_points.command.rendering import ColoredScene, Filmed, path_of, scene_of
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
    """Return a file's facts for a page, as `FileView.about`.

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

    def __init__(self, path: Path) -> None:
        self.path = path
        self._kept: tuple[Any, Any] | None = None  # options, and the scene read with them
        self._found: Memo = {}  # of the scene that is kept

    def kept(self, key: Any, read: Callable[[], Any]) -> Any:
        """Return the data read with some options, cached until these change."""
        if self._kept is None or self._kept[0] != key:
            self._kept, self._found = (key, read()), {}
        return self._kept[1]

    @abstractmethod
    def filmed(self, settings: Settings) -> tuple[Filmed, CloudStart, FrameFormat]:
        """Return a film's scene, start and format; the options are checked."""

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


SHOWN_OF_CLOUDS = (CloudOptions, CloudAim, FrameFormat)  # options that a page can change
LEFT_OUT_OF_CLOUDS = ("size", "bits", "color-bar")
FILMS_OF_CLOUDS = [  # options that pictures and films share
    *(option_of(CloudOptions, field) for field in CloudOptions.model_fields),
    *AROUND,
]
# Options that a prepared scene depends on
PREPARED = (
    *("also", "only", "crop", "color_by", "colormap"),
    *("span", "disc_limit", "level", "no_cache"),
)


class CloudPainter(FilmPainter):
    """Painter of a cloud for one page."""

    of_films = FILMS_OF_CLOUDS

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
        place = ", ".join(f"{n:.6g}" for n in found.position)
        return {"position": place, "depth": f"{found.depth:.5g}"}

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does."""
        form, cloud, camera = self._placed(settings, size)
        cloud.write(path, cloud.picture(camera, size[::-1]), form)

    def filmed(self, settings: Settings) -> tuple[ColoredScene, CloudAim, FrameFormat]:
        look, aim, form = _checked(settings)
        return self._scene(look), aim, form

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
        """Return the prepared cloud."""
        key = tuple(getattr(look, name) for name in PREPARED)
        kept: ColoredScene = self.kept(key, lambda: scene_of(Session(), self.path, look))
        return kept._replace(options=look)


def cloud_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a point cloud."""
    first = CloudPainter(path)
    settings = {"camera": "30,20,1", "steady": True, **settings_of(begin)}

    def described() -> dict[str, Any]:
        cloud = first.filmed(settings)[0].framing
        count = f"{len(cloud.position):,} points"
        return page_facts(path, count, FILMS_OF_CLOUDS, settings, begin, cloud)

    return FileView(first, described, _checked, left_out=LEFT_OUT_OF_CLOUDS)


def _checked(settings: Settings) -> tuple[CloudOptions, CloudAim, FrameFormat]:
    """Return the options, checked."""
    look, aim, form = chosen(settings, SHOWN_OF_CLOUDS)
    aim.check()
    look.check(Path("picture.png"), form.height_and_width()[0])
    return look, aim, form


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


class GaussianPainter(FilmPainter):
    """Painter of 3D Gaussians for one page."""

    of_films = OF_FILMS

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
        return {"position": ", ".join(f"{n:.6g}" for n in place), "depth": f"{depth:.5g}"}

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does."""
        form, scene, camera = self._placed(settings, size)
        scene.write(path, camera, form)

    def filmed(self, settings: Settings) -> tuple[GaussianPictures, CloudAim, FrameFormat]:
        look, options, aim, form = checked(settings)
        return self.scene(look, options), aim, form

    def scene(self, look: CloudOptions, options: GaussianOptions) -> GaussianPictures:
        """Return the scene, which caches its previews for the same options."""
        given = {**look.model_dump(), **options.model_dump()}
        key = tuple(given[name] for name in READ_WITH)
        kept: GaussianPictures = self.kept(
            key, lambda: gaussians_of(Session(), self.path, look, options)
        )
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
        scene = first.filmed(given)[0]
        settings = {"camera": "30,20,1", "up": scene.up, "steady": True, **given}
        count = f"{scene.count:,} Gaussians"
        return page_facts(path, count, OF_FILMS, settings, begin, scene.framing)

    return FileView(first, described, checked, left_out=LEFT_OUT)


def checked(settings: Settings) -> tuple[CloudOptions, GaussianOptions, CloudAim, FrameFormat]:
    """Return the options, checked."""
    look, options, aim, form = chosen(settings, SHOWN)
    if others := [name for name in look.model_fields_set if name not in SHARED]:
        raise ValueError(f"{min(others)} is an option of clouds of points; leave it out")
    aim.check()
    options.check()
    form.behind()
    return look, options, aim, form


def view_of(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of a file: a cloud, 3D Gaussians, or a snapshot's particles."""
    from resample_points.files.gaussians.formats import is_gaussians
    from resample_points.files.readers import SNAPSHOTS

    if path.suffix.lower() in SNAPSHOTS:
        from resample import registry

        particles: FileView = registry.load("pages", "points.density")(path, begin)
        return particles
    return gaussian_view(path, begin) if is_gaussians(path) else cloud_view(path, begin)


picture = picture_function(view_of)
