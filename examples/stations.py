"""A map of measurements at stations: an application of one's own, on the parts that ours share.

    resample stations map stations.csv --radius 0.3 -o map.png
    resample stations film stations.csv --camera 0,40 -o year.mp4

A file has columns x, y, value and time. `docs/howto/application.md` says how it is mounted.
"""

from functools import partial
from pathlib import Path
from typing import Annotated, ClassVar

import numpy as np
from cyclopts import App
from pydantic import Field

from resample import Scatter
from resample.cameras.viewpoints import Sphere, camera_from
from resample.colors import mapped
from resample.command import flags
from resample.command.films import write_shared
from resample.command.flags import OptionTopic
from resample.command.settings import Choices, FrameFormat, Serving, chosen
from resample.files.animations import Shots, check_film, fingerprint
from resample.files.saving import screen_levels, write_png
from resample.files.writing import check_targets
from resample.progress import cancellable
from resample.view.files import FileView
from resample.view.views import PagePicture, settings_of

COMMAND, BLACK = "resample-stations map", (0.0, 0.0, 0.0)
app = App(name="resample-stations", help="Maps of measurements at stations.")


class Look(Choices):
    """How a map looks."""

    heading: ClassVar[str] = "Look"
    about: ClassVar[OptionTopic] = OptionTopic.APPEARANCE

    radius: Annotated[float, Field(gt=0, description="Radius of a station, in units of x.")] = 1.0
    colors: Annotated[str, Field(description="Color map, such as viridis or turbo.")] = "viridis"
    camera: flags.Viewed = "0,90"
    fov: flags.FieldOfView = 30.0


LOOK, FORM, PAGE = Look.usual(), FrameFormat.usual(), Serving.usual()


class Stations:
    """Stations of a file: positions (N, 2), values (N,) and times (N,). It paints pages, too."""

    def __init__(self, path: Path) -> None:
        table = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True))
        if not table.size or not {"x", "y", "value", "time"} <= set(table.dtype.names or ()):
            raise ValueError(f"{path}: stations are rows of x, y, value and time")
        self.place, self.value = np.stack([table["x"], table["y"]], axis=1), table["value"]
        self.time, self.times = table["time"], np.unique(table["time"])

    def map(self, look: Look, shape: tuple[int, int], time: float | None = None) -> np.ndarray:
        """Map (height, width, 4) of all times or of one; premultiplied, linear light."""
        ends = self.place.min(axis=0), self.place.max(axis=0)
        reach = 0.5 * np.linalg.norm(ends[1] - ends[0]) + look.radius
        ball = Sphere(np.append(np.mean(ends, axis=0), 0.0), float(reach))
        view = camera_from(flags.viewpoint(look.camera, look.fov, "z"), ball, *shape).view()
        # From the plane z = 0 to pixels: what x, y and the origin are to the camera.
        plane = np.column_stack([view.rotation[:, :2], view.translation])
        if not view.perspective:
            plane[2] = 0, 0, 1
        plane[:2] = view.focal[:, None] * plane[:2] + view.principal[:, None] * plane[2]
        some = slice(None) if time is None else self.time == time
        how = {"radius": look.radius, "shape": shape, "plane": plane}
        found = Scatter()(self.place[some], self.value[some], **how)
        least, most = np.nanmin(self.value), np.nanmax(self.value)
        share = np.nan_to_num((found.value - least) / max(most - least, 1e-30))
        cover = np.clip(found.coverage, 0, 1)[..., None]
        color = mapped(look.colors, share.ravel()).reshape(*shape, 3)
        return np.concatenate([color * cover, cover], axis=2).astype(np.float32)

    def paint(self, settings, size, *, quick, cancel) -> PagePicture:
        look, form = chosen(settings, (Look, FrameFormat))
        with cancellable(cancel):
            rgba = self.map(look, size[::-1])
        return PagePicture(screen_levels(rgba, background=form.behind() or BLACK), quick)

    def pick(self, *_):
        return {}

    def save(self, settings, size, path) -> None:
        look, form = chosen(settings, (Look, FrameFormat))
        write_png(path, self.map(look, size[::-1]), bits=form.bits, background=form.behind())


@app.command(name="map")
def draw(
    stations: Path,
    /,
    *,
    output: flags.Output,
    look: Annotated[Look, flags.Flat] = LOOK,
    form: Annotated[FrameFormat, flags.Flat] = FORM,
) -> None:
    """Draw a map of all measurements as .png."""
    check_targets(output)
    rgba = Stations(stations).map(look, form.height_and_width())
    write_png(output, rgba, bits=form.bits, background=form.behind())


@app.command
def film(
    stations: Path,
    /,
    *,
    output: flags.FilmOutput,
    fps: flags.FramesPerSecond = 4.0,
    resume: flags.Resume = False,
    look: Annotated[Look, flags.Flat] = LOOK,
    form: Annotated[FrameFormat, flags.Flat] = FORM,
) -> None:
    """Show the measurements of each time, one frame after the other."""
    check_film(output, fps)
    known, shape = Stations(stations), form.height_and_width()

    def frame(n: int) -> np.ndarray:
        return screen_levels(known.map(look, shape, known.times[n]), background=BLACK)

    job = {**look.model_dump(), "size": shape, "data": fingerprint(known.place, known.value)}
    shots = Shots(len(known.times), frame, job)
    write_shared(output, shots, fps=fps, resume=resume)


@app.command
def view(
    stations: Path,
    /,
    *,
    look: Annotated[Look, flags.Flat] = LOOK,
    page: Annotated[Serving, flags.Flat] = PAGE,
) -> None:
    """Show the map in the browser: tilt it, choose colors, copy the command of the view."""
    from resample.view.server import show

    about = {"title": stations.name, "command": COMMAND, "inputs": [str(stations)]}
    about["settings"] = {"camera": look.camera, **settings_of([look])}
    refuse = partial(chosen, models=(Look, FrameFormat))
    show(lambda: FileView(Stations(stations), lambda: about, refuse), page)
