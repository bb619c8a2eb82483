"""Roles of what applications show in a page, and what all of them have in common."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from cyclopts import App, Group
from cyclopts.argument import Argument
from numpy.typing import NDArray

from resample import registry
from resample.command.about import About, Marks, about, marks_of, name_of
from resample.command.settings import Choices
from resample.command.settings_files import options_of, schema_of
from resample.watching import Cancel, Progress

Settings = Mapping[str, Any]  # options by name, as settings files have them
Size = tuple[int, int]  # width and height, px
C = TypeVar("C", bound=Choices)


class Painting(NamedTuple):
    """A picture for a page."""

    levels: NDArray[np.uint8]  # (H, W, 3 or 4) sRGB, straight opacity
    is_preview: bool
    about: Mapping[str, Any] = MappingProxyType({})  # said with the picture, as JSON holds it


class Painter(Protocol):
    """Role of what paints for one page: it keeps what the last pictures needed."""

    def paint(self, settings: Settings, size: Size, *, quick: bool, cancel: Cancel) -> Painting:
        """Picture of these options; `quick` asks for a preview."""

    def pick(self, settings: Settings, size: Size, x: float, y: float) -> dict[str, Any]:
        """What is seen at a place of the picture, px; nothing: an empty dictionary."""


@runtime_checkable
class Knowing(Protocol):
    """Role of painters that can be asked about options; what there is to ask is their own."""

    def tell(self, settings: Settings, what: str) -> dict[str, Any]:
        """What a page asks for."""


@runtime_checkable
class Comparing(Protocol):
    """Role of painters that have other renderers paint the same; `about` names these `rivals`."""

    def beside(self, rival: str, settings: Settings, size: Size) -> Painting:
        """Picture that a rival makes of these options."""


@runtime_checkable
class Filming(Protocol):
    """Role of painters that make films."""

    def keyframes(self, cameras: Sequence[str], settings: Settings) -> str:
        """File of keyframes, as the film's command takes it, of cameras as the page spells them."""

    def film(
        self, settings: Settings, size: Size, keyframes: str, path: Path, progress: Progress
    ) -> None:
        """Write what the command would write, of a file of keyframes with this content."""


@runtime_checkable
class Warming(Protocol):
    """Role of what is looked at whose other kinds of pictures can be compiled beforehand."""

    def warm(self) -> Iterator[None]:
        """Paint tiny pictures of all kinds that pages can ask for, one at each step."""


class Viewable(Protocol):
    """Role of what is looked at in pages.

    A plugin of the group `resample.views` is named as an application that has a command `view`: a
    function that tells whether that shows files of such names.
    """

    @property
    def about(self) -> dict[str, Any]:
        """What a page has to know, as JSON holds it.

        `title`; `command`, its `inputs` and options of it that are `fixed`; `package` whose
        `viewing` has a `function` (`picture`) that takes inputs and options; if there is a `film`
        through keyframes, its `command`, the name of the `file` that holds them, the options
        `steered` by them, those that it has (`options`; all) and frames from `each` keyframe to
        the next, where it has to be told; `controls` of
        `controls_of`; `settings` to begin with; `rivals` that paint the same, by name, with why
        one does not, if so; `names` that options may have, by option; and what else its page
        shows, such as a `histogram`.
        """

    def check(self, settings: Settings | None = None) -> None:
        """Read what is looked at, and refuse options that are not allowed; None: the first ones."""

    def painter(self) -> Painter:
        """What paints for a page that has been opened."""

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """File that the command would write."""


def controls_of(name: str, command: App, left_out: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Options of a command as a page offers them: those that say how a picture looks.

    Parameters
    ----------
    name
        Of the application and the command.
    command
        It.
    left_out
        Options that a page has no control for.

    Returns
    -------
    For each `key`, `heading`, `help`, `default` and the `schema` of its values.
    """
    schema, found = schema_of(name, command)["properties"], []
    for key, option in options_of(command).items():
        if key not in schema or key in left_out:
            continue
        described = dict(schema[key])
        if About.LOOK.value not in described.pop("about"):
            continue
        found.append(
            {
                "key": key,
                "heading": _heading(option),
                "help": described.pop("description", ""),
                "default": described.pop("default", None),
                "schema": described,
            }
        )
    return found


def _heading(option: Argument) -> str:
    """Name of the group that the help shows an option under."""
    given = option.parameter.group
    groups = [given] if isinstance(given, str | Group) else list(given or ())
    return str(getattr(groups[0], "name", groups[0])) if groups else ""


@cache
def marks_in(command: str) -> Marks:
    """What options of a command, such as `resample-volume render`, are about."""
    application, _, name = command.partition(" ")
    home: App = registry.load("apps", application.removeprefix("resample-"))
    found = home[name].default_command
    return {} if found is None else marks_of(found)


def check_said(command: str, said: Settings, begun: Settings) -> None:
    """Refuse what a page must not say: anything but how a picture looks.

    Parameters
    ----------
    command
        Whose options these are.
    said
        What the page says. Names that the command does not know are for `chosen` to refuse.
    begun
        What was chosen on the command line or in Python; a page may say that again.

    Raises
    ------
    ValueError
        It says something else.
    """
    marks = marks_in(command)
    for key, value in said.items():
        is_known = key in begun and begun[key] == value
        if key in marks and not is_known and about(marks[key], value) is not About.LOOK:
            raise ValueError(
                f"{key} {value!r:.60}: a page says how a picture looks; give what is read or "
                "written on the command line, or in Python"
            )


def chosen(settings: Settings, models: Sequence[type[Choices]]) -> list[Any]:
    """Models of options, filled from settings.

    Raises
    ------
    ValueError
        An option is none of theirs, or is not allowed.
    """
    parts: list[dict[str, Any]] = [{} for _ in models]
    fields = {
        option_of(model, field): (n, field)
        for n, model in reversed(list(enumerate(models)))
        for field in model.model_fields
    }
    for key, value in settings.items():
        if key not in fields:
            raise ValueError(f"there is no option {key!r:.60}")
        home, field = fields[key]
        parts[home][field] = value
    return [model(**part) for model, part in zip(models, parts, strict=True)]


def settings_of(choices: Sequence[Choices]) -> dict[str, Any]:
    """Options that were given, by name."""
    found = {}
    for model in choices:
        for field in type(model).model_fields:
            value = getattr(model, field)
            if field in model.model_fields_set and value is not None:
                found[option_of(type(model), field)] = _plain(value)
    return found


def _plain(value: Any) -> Any:
    """Value as JSON holds it."""
    if isinstance(value, tuple):
        return list(value)
    return str(value) if isinstance(value, Path) else value


def option_of(model: type[Choices], field: str) -> str:
    """Name of the option that fills a field of a model."""
    return name_of(field, model.model_fields[field].metadata)
