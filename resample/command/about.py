"""Categories of options; settings from untrusted files may only change the look of a picture.

An option states its category by a mark in its annotation or by its model. An option without one is
not taken from a file.
"""

import inspect
import re
from collections.abc import Callable, Iterator, Mapping
from enum import Enum
from typing import Annotated, Any, NamedTuple, get_args, get_origin, get_type_hints

from cyclopts import Parameter
from pydantic import BaseModel


class OptionTopic(Enum):
    """Category of an option. All but `APPEARANCE` must be set by the user."""

    APPEARANCE = "look"  # appearance of the picture
    SOURCE = "source"  # other files that are read
    TARGET = "target"  # files that are written, addresses that are served or called
    RESOURCE = "resource"  # memory, threads and processes
    TRUST = "trust"  # what files are allowed to do


class Inline(NamedTuple):
    """`APPEARANCE` if the value matches a pattern, otherwise the name of a file."""

    form: re.Pattern[str]


Mark = OptionTopic | Inline
Marks = Mapping[str, Mark | None]  # marks of options, by name

_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_NUMBERS = rf"(?:k=)?[\s\[(]*{_NUMBER}(?:[\s,;\[\]()]+{_NUMBER})*[\s\])]*"
_ANGLES = rf"front|back|left|right|top|bottom|corner|{_NUMBER}(?:/{_NUMBER}){{1,4}}"
NUMBERS = Inline(re.compile(_NUMBERS, re.ASCII))
CAMERA = Inline(re.compile(_ANGLES, re.ASCII))
TRANSFER = Inline(re.compile(r"(?!.*\.(?:json|toml))[^\x00]*", re.IGNORECASE))


def words(*known: str, or_numbers: bool = False) -> Inline:
    """Mark of an option that is either one of these words or the name of a file."""
    forms = [*map(re.escape, known), *([_NUMBERS] if or_numbers else [])]
    return Inline(re.compile("|".join(forms), re.ASCII))


def about(mark: Mark | None, value: object) -> OptionTopic | None:
    """Category of an option's value; None if the option states none."""
    if not isinstance(mark, Inline):
        return mark
    names_a_file = isinstance(value, str) and mark.form.fullmatch(value) is None
    return OptionTopic.SOURCE if names_a_file else OptionTopic.APPEARANCE


def marks_of(command: Callable[..., Any]) -> Marks:
    """Marks of all options of a command, by name without leading hyphens."""
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
    """Model whose fields are options; None if the argument is not such a model."""
    inner = get_origin(kind) is Annotated and get_args(kind)[0]
    return inner if isinstance(inner, type) and issubclass(inner, BaseModel) else None


def name_of(field: str, metadata: Any) -> str:
    """Name of an option without leading hyphens."""
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
    return next((part for part in metadata if isinstance(part, OptionTopic | Inline)), None)
