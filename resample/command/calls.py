"""Run commands from Python, with their options by name."""

import inspect
from pathlib import Path
from typing import Any, get_type_hints

from resample import registry
from resample.calling import understood
from resample.command.settings import Choices, as_on_a_command_line, chosen


def run(application: str, command: str, *names: str | Path, **options: Any) -> None:
    """Run a command.

    `application`, `command`: their names, such as `volume` and `animate`. `names`: its positional
    arguments. `options`: its options by name, with values as of `resample.command.settings.chosen`;
    None: left out. Raises TypeError: there is no such option; it says what to give instead. Raises
    ValueError, OSError: as of the command.
    """
    function = registry.load("apps", application)[command].default_command
    parameters = inspect.signature(function).parameters
    hints = get_type_hints(function)
    own = [name for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY]
    classes = {name: hints[name] for name in own if isinstance(hints[name], type)}
    groups = [name for name, kind in classes.items() if issubclass(kind, Choices)]
    models = [hints[name] for name in groups]
    single = [name for name in own if name not in groups]
    known = [*single, *(field for model in models for field in model.model_fields)]
    given = {name: value for name, value in options.items() if value is not None}
    given = understood(command, given, known)
    plain = {name: given.pop(name) for name in single if name in given}
    plain = {
        name: value if isinstance(value, Path) else as_on_a_command_line(value)
        for name, value in plain.items()
    }
    function(*names, **plain, **dict(zip(groups, chosen(given, models), strict=True)))
