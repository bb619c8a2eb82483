"""Interfaces that applications implement to show a page, and shared functions."""

import json
import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from cyclopts import App, Group
from numpy.typing import ArrayLike, NDArray

from resample import registry
from resample.cameras.models import Camera, LensModel, Orthographic
from resample.cameras.viewpoints import Orbit, viewpoint_of
from resample.command.flags import Marks, OptionTopic, about, marks_of
from resample.command.settings import (
    Choices,
    appearance_settings,
    as_toml,
    option_of,
    options_of,
    schema_of,
)
from resample.progress import Cancel, Progress
from resample.types import View

Settings = Mapping[str, Any]  # options by name, as settings files have them
Size = tuple[int, int]  # width and height, px
Point = tuple[float, float, float]  # scene units
C = TypeVar("C", bound=Choices)
KEYFRAMES = "keyframes.toml"
ORBITING = {"file": KEYFRAMES, "steered": ["camera", "fov", "up"]}  # films that orbit
STEP = 2.0  # seconds from one keyframe to the next


class PagePicture(NamedTuple):
    """A picture for a page."""

    levels: NDArray[np.uint8]  # (H, W, 3 or 4) sRGB, straight opacity
    is_preview: bool
    about: Mapping[str, Any] = MappingProxyType({})  # sent with the picture, as JSON values


class Painter(Protocol):
    """Interface of a page's painter; it caches data between pictures."""

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> PagePicture:
        """Paint a picture with these options; `quick` requests a preview."""

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """Describe the object at a position of the picture, px; empty if none."""


@runtime_checkable
class Knowing(Protocol):
    """Interface of painters with information on options; each defines its questions."""

    def tell(self, settings: Settings, what: str) -> dict[str, Any]:
        """Answer a question of a page."""


@runtime_checkable
class Slicing(Protocol):
    """Interface of painters of volumes; `about` lists their `slices`."""

    def slice(
        self,
        size: Size,
        plane: str,
        voxel: tuple[int, int, int],
        window: tuple[float, float] | None,
    ) -> PagePicture:
        """Picture of the slice through a voxel, and the voxel's `value` beside it."""

    def measure(self, start: Point, end: Point) -> dict[str, Any]:
        """Length of a line in the scene, its `unit`, and `values` along it; None: unknown."""


@runtime_checkable
class Comparing(Protocol):
    """Interface of painters that compare with other renderers; `about` lists these as `rivals`."""

    def beside(self, rival: str, settings: Settings, size: Size) -> PagePicture:
        """Picture of another renderer with these options."""


@runtime_checkable
class Filming(Protocol):
    """Interface of painters that make films."""

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """Keyframe file for the film's command, from cameras as the page writes them."""

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write the film that the command would write for these keyframes."""


@runtime_checkable
class Warming(Protocol):
    """Interface of views that compile other kinds of pictures in advance."""

    def warm(self) -> Iterator[None]:
        """Paint a tiny picture of each kind that pages may request, one per step."""


class Viewable(Protocol):
    """Interface of objects that pages can show.

    A plugin of the group `resample.views` has the name of an application with a command `view`. It
    is a function that tells whether the command can show files with such names.
    """

    @property
    def about(self) -> dict[str, Any]:
        """Description of the view for a page, as JSON values.

        `title`; `command`, its `inputs` and `fixed` options; `package` with a `viewing` that has a
        `function` (`picture`) of inputs and options; if there is a `film` through keyframes, its
        `command`, the name of their `file`, the options that they set (`steered`), those it has
        (`options`; default all) and, if needed, the frames from `each` keyframe to the next;
        `controls` from `controls_of`; initial `settings`; their camera may be changed so that the
        object `fills` the picture ("outside": the eye is never in its midst); other renderers
        (`rivals`) by name, with the reason if one is unavailable; `names` that options may have,
        by option; and data of its page, such as a `histogram`.
        """

    def check(self, settings: Settings | None = None) -> None:
        """Read the inputs and reject invalid options; None: the initial ones."""

    def painter(self) -> Painter:
        """Create a painter for a new page."""

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """File that the command would write."""


def controls_of(name: str, left_out: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Options of a command, such as `resample-volume render`, that change the look.

    Result: for each option its `key`, `heading`, `help`, `default` and the `schema` of its values.
    """
    command = _command(name)
    schema, found = schema_of(name, command)["properties"], []
    for key, option in options_of(command).items():
        if key not in schema or key in left_out:
            continue
        described = dict(schema[key])
        if OptionTopic.APPEARANCE.value not in described.pop("about"):
            continue
        given = option.parameter.group
        groups = [given] if isinstance(given, str | Group) else list(given or ())
        found.append(
            {
                "key": key,
                "heading": str(getattr(groups[0], "name", groups[0])) if groups else "",
                "help": described.pop("description", ""),
                "default": described.pop("default", None),
                "schema": described,
            }
        )
    return found


@cache
def marks_in(command: str) -> Marks:
    """Categories of the options of a command, such as `resample-volume render`."""
    found = _command(command).default_command
    return {} if found is None else marks_of(found)


def _command(name: str) -> App:
    """Command of an installed application."""
    application, _, command = name.partition(" ")
    home: App = registry.load("apps", application.removeprefix("resample-"))
    return home[command]


def check_page_options(command: str, options: Settings, begun: Settings) -> None:
    """Reject changes of a page to anything but the look."""
    marks = marks_in(command)
    for key, value in options.items():
        is_known = key in begun and begun[key] == value
        if key in marks and not is_known and about(marks[key], value) is not OptionTopic.APPEARANCE:
            raise ValueError(
                f"{key} {value!r:.60}: a page only changes the look; give inputs and "
                "outputs on the command line, or in Python"
            )


def settings_of(choices: Sequence[Choices]) -> dict[str, Any]:
    """Options that were set, by name."""
    found = {}
    for model in choices:
        for field in type(model).model_fields:
            value = getattr(model, field)
            if field in model.model_fields_set and value is not None:
                plain = list(value) if isinstance(value, tuple) else value
                plain = str(value) if isinstance(value, Path) else plain
                found[option_of(type(model), field)] = plain
    return found


def projection_of(view: View, size: Size, middle: ArrayLike = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """Return, as JSON, the projection of points around `middle` of the scene to pixels."""
    return {
        "rotation": view.rotation.tolist(),
        "translation": (view.translation + view.rotation @ np.asarray(middle)).tolist(),
        "focal": view.focal.tolist(),
        "principal": view.principal.tolist(),
        "perspective": view.perspective,
        "size": size,
    }


def placed_by(camera: Any, size: Size) -> dict[str, Any]:
    """Return a camera's data for a page, to draw lines; nothing for lenses."""
    is_straight = isinstance(camera, Orthographic) or (
        isinstance(camera, Camera)
        and camera.distortion is None
        and camera.model == LensModel.PINHOLE
    )
    return {"view": projection_of(camera.view(), size)} if is_straight else {}


def is_free(choices: Sequence[Choices]) -> bool:
    """Return whether no camera was given, so that a page may frame the object."""
    return not settings_of(choices).keys() & {"camera", "intrinsics", "panorama"}


def exports_of(
    about: dict[str, Any],
    settings: Settings,
    size: Size,
    cameras: Sequence[str] = (),
    keyframes: str = "",
) -> dict[str, str]:
    """Texts that reproduce the picture, and a film through keyframes.

    `size`: width and height, px.
    """
    command, inputs = about["command"], about["inputs"]
    whole = {**about.get("fixed", {}), **settings, "size": f"{size[0]}x{size[1]}"}
    words = [*command.split(), *inputs, *option_words(whole)]
    made_by = about.get("function", "picture")
    named = ", ".join(map(repr, inputs))
    lines = "".join(f"    {key!r}: {value!r},\n" for key, value in whole.items())
    python = (
        f"from {about['package']}.viewing import {made_by}\n\n"
        f"shown = {made_by}({named}, {{\n{lines}}})\n"
    )
    film = {}
    if len(cameras) > 1 and "film" in about:
        told = about["film"]
        known = {*told.get("options", whole)} - {*told["steered"]}
        still = option_words({key: value for key, value in whole.items() if key in known})
        parts = [*told["command"].split(), *inputs, *still, f"--path={told['file']}"]
        if "each" in told:
            parts.append(f"--frames={told['each'] * (len(cameras) - 1) + 1}")
        film = {"keyframes": keyframes, "film": shlex.join([*parts, "-o", "film.mp4"])}
    return {
        "command": shlex.join([*words, "-o", "picture.png"]),
        "settings": as_toml(command, appearance_settings(whole, marks_in(command))),
        "python": python + 'shown.save("picture.png")\n',
        "notebook": python + "shown\n",
        **film,
    }


def keyframes_as_toml(cameras: Sequence[str], settings: Settings) -> str:
    """Write keyframes as TOML, `STEP` apart, each along the shorter rotation from the previous."""
    tables, last = [], 0.0
    for n, text in enumerate(cameras):
        orbit = viewpoint_of(text)
        if not isinstance(orbit, Orbit):
            raise ValueError(
                f"keyframe {text!r:.60} is not azimuth,elevation,zoom; films need such cameras"
            )
        azimuth = orbit.azimuth if n == 0 else last + math.remainder(orbit.azimuth - last, 360.0)
        last = azimuth
        tables.append(
            f"[[camera]]\ntime = {n * STEP:g}\nazimuth = {azimuth!r}\n"
            f"elevation = {orbit.elevation!r}\nzoom = {orbit.zoom!r}\npan = {list(orbit.pan)!r}\n"
            f"fov = {float(settings.get('fov', orbit.fov))!r}\n"
            f"up = {json.dumps(settings.get('up', orbit.up))}\n"
        )
    return "\n".join(tables)


def option_words(settings: Settings) -> list[str]:
    """Arguments of a command line that set all options."""
    words: list[str] = []
    for key, value in settings.items():
        if isinstance(value, bool):
            words.append(f"--{key}" if value else f"--no-{key}")
        else:
            words += [f"--{key}={one}" for one in (value if isinstance(value, list) else [value])]
    return words
