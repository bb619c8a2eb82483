"""Options of a command and keywords of its Python call are the same, with defaults and choices."""

import inspect
import typing
from importlib import import_module
from typing import Any

import pytest

from resample import registry
from resample.command.flags import OptionTopic, marks_of
from resample.command.settings import options_of

CALLS = {
    "points": "render",
    "texture": "warp resize scale rotate project undistort",
    "volume": "render",
}
# Options that calls have in another form: arguments of their own, or of what writes the result.
FORMS = "corners map flow lens rectify size expand from to pose intrinsics panorama index eyes"
WRITTEN = "background bits profile file_quality deep linear encoding"
IN_SCENES = "color_by range color_bar steady level also channels no_cache"
APART = {*FORMS.split(), *WRITTEN.split(), *IN_SCENES.split()}
# Defaults in another form: numbers or None, by the method, the file, or what is visible.
SPELLED = {"camera", "size", "turn", "edge", "matrix"}


def choices(kind: Any) -> set[Any]:
    """Values of a Literal, also of one within another type."""
    if typing.get_origin(kind) is typing.Literal:
        return set(typing.get_args(kind))
    return next((found for part in typing.get_args(kind) if (found := choices(part))), set())


def keywords(call: Any) -> dict[str, tuple[Any, Any]]:
    """Types and defaults of a call's keywords; nothing is the default of those in a TypedDict."""
    hints, found = typing.get_type_hints(call), {}
    for name, part in inspect.signature(call).parameters.items():
        if part.kind is part.VAR_KEYWORD:
            more = typing.get_type_hints(typing.get_args(hints[name])[0])
            found |= {key: (kind, part.empty) for key, kind in more.items()}
        else:
            found[name] = hints[name], part.default
    return found


@pytest.mark.parametrize(
    ("application", "command"), [(app, one) for app in CALLS for one in CALLS[app].split()]
)
def test_look_options_are_keywords_with_the_same_defaults_and_choices(
    application: str, command: str
) -> None:
    app = registry.load("apps", application)[command]
    known = keywords(getattr(import_module(f"resample_{application}"), command))
    marks, missing, other = marks_of(app.default_command.__wrapped__), set(), {}
    for key, option in options_of(app).items():
        name, default = key.replace("-", "_"), option.field_info.default
        if name not in known:
            if marks.get(key) not in (None, *set(OptionTopic) - {OptionTopic.APPEARANCE}):
                missing.add(name)
            continue
        kind, usual = known[name]
        own, here = choices(option.field_info.annotation), choices(kind)
        if own and here and not own <= here:
            other[name] = own, here
        if name not in SPELLED and usual not in (default, inspect.Parameter.empty):
            other[name] = default, usual
    assert not other
    assert missing <= APART
