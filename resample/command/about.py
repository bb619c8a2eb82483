"""What options are about: settings from anywhere may say how a picture looks, and nothing else.

Each option says it, by a mark in its annotation or by its model. What says nothing is not taken
from a file.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from cyclopts import Parameter
from pydantic import BaseModel


class About(Enum):
    """What an option is about. What is not `LOOK` is the user's to say."""

    LOOK = "look"  # how a picture looks
    SOURCE = "source"  # what is read besides
    TARGET = "target"  # what is written, and who is talked with
    RESOURCE = "resource"  # how much of the machine is used
    TRUST = "trust"  # what files may do


class Inline(NamedTuple):
    """About the look where the option's value has a form; else it names a file."""

    form: re.Pattern[str]


Mark = About | Inline
Marks = Mapping[str, Mark | None]  # of options, by name

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBERS = rf"(?:k=)?[\s\[(]*{_NUMBER}(?:[\s,;\[\]()]+{_NUMBER})*[\s\])]*"
_ANGLES = rf"front|back|left|right|top|bottom|corner|{_NUMBER}(?:/{_NUMBER}){{1,4}}"
NUMBERS = Inline(re.compile(_NUMBERS, re.ASCII))
CAMERA = Inline(re.compile(_ANGLES, re.ASCII))
TRANSFER = Inline(re.compile(r"(?!.*\.(?:json|toml))[^\x00]*", re.IGNORECASE))


def words(*known: str, or_numbers: bool = False) -> Inline:
    """Mark of an option that is one of some words, or names a file."""
    forms = [*map(re.escape, known), *([_NUMBERS] if or_numbers else [])]
    return Inline(re.compile("|".join(forms), re.ASCII))


def about(mark: Mark | None, value: object) -> About | None:
    """What a value of an option is about; None: the option does not say it."""
    if not isinstance(mark, Inline):
        return mark
    names_a_file = isinstance(value, str) and mark.form.fullmatch(value) is None
    return About.SOURCE if names_a_file else About.LOOK


def marks_of(command: Callable[..., Any]) -> Marks:
    """Marks of all options of a command, by name without hyphens."""
    hints = get_type_hints(command, include_extras=True)
    found: dict[str, Mark | None] = {}
    for part in inspect.signature(command).parameters.values():
        if part.kind is not inspect.Parameter.KEYWORD_ONLY:
            continue
        kind = hints[part.name]
        model = model_in(kind)
        if model is None:
            metadata = get_args(kind)[1:] if get_origin(kind) is Annotated else ()
            found[name_of(part.name, metadata)] = _mark_in(metadata)
        else:
            found |= _marks_of_fields(model)
    return found


def model_in(kind: Any) -> type[BaseModel] | None:
    """Model whose fields are options of their own; None for another kind of argument."""
    inner = get_origin(kind) is Annotated and get_args(kind)[0]
    return inner if isinstance(inner, type) and issubclass(inner, BaseModel) else None


def name_of(field: str, metadata: Any) -> str:
    """Name of an option without hyphens at its beginning.

    Parameters
    ----------
    field
        Of the model, or parameter of the command, that it fills.
    metadata
        What is annotated there.
    """
    for part in metadata:
        if isinstance(part, Parameter) and part.name:
            return str(next(iter(part.name))).removeprefix("--")
    return field.replace("_", "-")


def _marks_of_fields(model: type[BaseModel]) -> Iterator[tuple[str, Mark | None]]:
    usual = getattr(model, "about", None)
    for field, info in model.model_fields.items():
        own = _mark_in(info.metadata)
        yield name_of(field, info.metadata), usual if own is None else own


def _mark_in(metadata: Any) -> Mark | None:
    return next((part for part in metadata if isinstance(part, About | Inline)), None)
