"""Roles of what applications show in a page, and what all of them have in common."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, TypeVar, runtime_checkable

import numpy as np
from cyclopts import App, Group
from cyclopts.argument import Argument
from numpy.typing import NDArray

from resample.command.settings import Choices
from resample.files.facts.settings import options_of, schema_of
from resample.watching import Cancel

Settings = Mapping[str, Any]  # options by name, as settings files have them
Size = tuple[int, int]  # width and height, px
C = TypeVar("C", bound=Choices)


class Painting(NamedTuple):
    """A picture for a page."""

    levels: NDArray[np.uint8]  # (H, W, 3 or 4) sRGB, straight opacity
    is_preview: bool


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


class Viewable(Protocol):
    """Role of what is looked at in pages: a plugin of the group `resample.views` makes one."""

    @property
    def about(self) -> dict[str, Any]:
        """What a page has to know, as JSON holds it.

        `title`; `command` and its `inputs`; `controls` of `controls_of`; `settings` to begin with;
        and what else its page shows, such as a `histogram`.
        """

    def painter(self) -> Painter:
        """What paints for a page that has been opened."""

    def save(self, settings: Settings, size: Size, suffix: str) -> bytes:
        """File that the command would write."""


def controls_of(name: str, command: App, left_out: Sequence[str] = ()) -> list[dict[str, Any]]:
    """Options of a command as a page offers them.

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


def chosen(settings: Settings, models: Sequence[type[Choices]]) -> list[Any]:
    """Models of options, filled from settings.

    Raises
    ------
    ValueError
        An option is none of theirs, or is not allowed.
    """
    parts: list[dict[str, Any]] = [{} for _ in models]
    for key, value in settings.items():
        field = key.replace("-", "_")
        homes = [n for n, model in enumerate(models) if field in model.model_fields]
        if not homes:
            raise ValueError(f"there is no option {key!r:.60}")
        parts[homes[0]][field] = value
    return [model(**part) for model, part in zip(models, parts, strict=True)]


def settings_of(choices: Sequence[Choices]) -> dict[str, Any]:
    """Options that were given, by name."""
    found = {}
    for model in choices:
        for field in type(model).model_fields:
            value = getattr(model, field)
            if field in model.model_fields_set and value is not None:
                found[field.replace("_", "-")] = list(value) if isinstance(value, tuple) else value
    return found
