"""Particles of simulations in the viewer's page."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from resample.command.session import Session
from resample.command.settings import Choices, FrameFormat, chosen, option_of
from resample.files.saving import screen_levels
from resample.outofcore.passes import Memo, memoizing
from resample.progress import Cancel, cancellable
from resample.scene import PER, enlarged, preview_size
from resample.view.files import FileView, picture_function
from resample.view.views import PagePicture, Settings, Size, placed_by, settings_of
from resample_particles.choices import DensityOptions, write_map
from resample_particles.files import kinds_in
from resample_particles.pictures import ParticlePictures, pictures_of
from resample_points.command.choices import CloudStart
from resample_points.painting.bending import shrunken
from resample_points.scenes import camera_of
from resample_points.viewing.pages import AROUND, FilmPainter, page_facts

COMMAND = "resample-points density"
SHOWN = (DensityOptions, CloudStart, FrameFormat)  # options that a page can change
LEFT_OUT = ("size", "bits", "axis", "steady")
OF_FILMS = [  # options that pictures and films share
    *(option_of(DensityOptions, name) for name in DensityOptions.model_fields if name != "axis"),
    *AROUND,
]
READ_WITH = ("kind", "crop", "quantity")  # options that the scene depends on


@dataclass
class ParticlePainter(FilmPainter):
    """Painter of particles for one page.

    `path`: file of the particles.
    """

    path: Path
    of_films = OF_FILMS
    _kept: tuple[Any, ParticlePictures] | None = field(init=False, default=None)
    _found: Memo = field(init=False, default_factory=dict)  # of the particles that are kept

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Picture of these options, see `resample.view.views.Painter`."""
        shape = size[::-1]
        with cancellable(cancel):
            form, scene, camera = self._placed(settings, size)
            behind = form.behind() or (0.0, 0.0, 0.0)
            told: dict[str, Any] = {}
            if quick:
                few = preview_size(size)[::-1]
                small = scene.fewer.picture(shrunken(camera, PER), few).rgba
                levels = screen_levels(small, background=form.behind())
                levels = enlarged(levels, PER, shape, smooth=True)
            else:
                made = scene.picture(camera, shape)
                told = {"range": {"ends": list(made.span), "log": made.is_log}}
                rgba = scene.with_bar(made, behind)
                levels = screen_levels(rgba, background=form.behind())
        view = {} if scene.options.color_bar else placed_by(camera, size)  # a bar moves the picture
        return PagePicture(levels, quick, {**view, **told})

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Return the value at a pixel, see `resample.view.views.Painter`.

        A column has no depth: its position is where its line meets the plane across the view that
        a slice shows, or that goes through the middle of the particles.
        """
        from resample.scene import pixel_at

        _, scene, camera = self._placed(settings, size)
        found = scene.measure(camera, size[::-1])
        value = found.value[pixel_at(size, x, y)]
        if not value > 0:
            return {}
        told = {found.name: f"{value:.5g} {found.units}".strip()}
        place = None if scene.options.color_bar else scene.place_at(camera, size[::-1], x, y)
        if place is not None:
            told["position"] = ", ".join(f"{part:.6g}" for part in place)
        return told

    def save(self, settings: Settings, size: Size, path: Path) -> None:
        """Write the picture as the command does; raises as it does."""
        form, scene, camera = self._placed(settings, size)
        write_map(path, scene.measure(camera, size[::-1]), scene.options, form)

    def filmed(self, settings: Settings) -> tuple[ParticlePictures, CloudStart, FrameFormat]:
        options, start, form = checked(settings)
        return self.scene(options), start, form

    def scene(self, options: DensityOptions) -> ParticlePictures:
        """Return the particles, cached until the options change that they are read with."""
        key = tuple(getattr(options, name) for name in READ_WITH)
        if self._kept is None or self._kept[0] != key:
            self._kept, self._found = (key, pictures_of(Session(), self.path, options)), {}
        if self._kept[1].options != options:
            self._kept = key, replace(self._kept[1], options=options)
        return self._kept[1]

    def _placed(self, settings: Settings, size: Size) -> tuple[FrameFormat, ParticlePictures, Any]:
        """Return the picture's format, the particles and the camera."""
        options, start, form = checked({**settings, "size": f"{size[0]}x{size[1]}"})
        scene = self.scene(options)
        with memoizing(self._found):
            camera = camera_of(scene.framing, size[::-1], start.start())
        return form, scene, camera


def particle_view(path: Path, begin: Sequence[Choices] = ()) -> FileView:
    """Return what pages show of particles."""
    first, given = ParticlePainter(path), {"camera": "30,20,1", **settings_of(begin)}

    def described() -> dict[str, Any]:
        kinds = kinds_in(path)
        settings = given if "gas" in kinds or not kinds else {"type": kinds[0], **given}
        scene = first.scene(checked(settings)[0])
        count = f"{len(scene.particles):,} particles"
        facts = page_facts(path, count, OF_FILMS, settings, begin, scene.framing)
        return {
            **facts,
            "command": COMMAND,
            "film": {**facts["film"], "command": COMMAND},
            "package": "resample_particles",
            "function": "map_of",
            "fills": "outside" if facts["fills"] else False,
            "unit": scene.particles.units.get("length", ""),
        }

    return FileView(first, described, checked, left_out=LEFT_OUT)


def checked(settings: Settings) -> tuple[DensityOptions, CloudStart, FrameFormat]:
    """Return the options, checked."""
    options, start, form = chosen(settings, SHOWN)
    start.start()
    options.check_appearance(Path("picture.png"), form.height_and_width()[0])
    return options, start, form


map_of = picture_function(particle_view)
