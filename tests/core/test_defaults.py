"""Defaults of public functions and of options: they change on purpose alone.

`defaults.txt` has a line for each. Where a change is meant, edit its line there too; a user's
pictures change with it, so `CHANGELOG.md` says so.
"""

import inspect
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.ndimage

from resample import registry
from resample_dropins import ndimage, opencv, scikit
from tests.core.test_signatures import parameters, public

RECORD = Path(__file__).with_name("defaults.txt")
LIKE = {"ndimage": ndimage, "opencv": opencv, "scikit": scikit}
NO_VALUE = "<"  # how the texts of objects begin that tell nothing of their value


def text_of(value: Any) -> str:
    text = repr(value.tolist()) if isinstance(value, np.ndarray) else repr(value)
    return "" if NO_VALUE in text else text


def in_python() -> Iterator[str]:
    """Lines for the arguments of public functions, and of those like other libraries'."""
    for name, found in [*public(), *inherited(), *like()]:
        for argument, parameter in parameters(found).items():
            if parameter.default is not parameter.empty and text_of(parameter.default):
                yield f"{name}: {argument}={text_of(parameter.default)}"


def inherited() -> Iterator[tuple[str, Callable[..., Any]]]:
    """Methods that public classes have from others of this project."""
    for name, found in public():
        for base in found.__mro__[1:] if inspect.isclass(found) else ():
            for method, function in vars(base).items() if "resample" in base.__module__ else ():
                if inspect.isfunction(function) and not method.startswith("_"):
                    yield f"{name}.{method}", function


def like() -> Iterator[tuple[str, Callable[..., Any]]]:
    for library, module in LIKE.items():
        for name, found in vars(module).items():
            if inspect.isfunction(found) and found.__module__ == module.__name__ and name[0] != "_":
                yield f"like.{library}.{name}", found


def on_command_lines() -> Iterator[str]:
    """Lines for the arguments of all commands; groups of options tell all of theirs."""
    for application in registry.names("apps"):
        app = registry.load("apps", application)
        for command in (name for name in app if not name.startswith("-")):
            for argument, parameter in parameters(app[command].default_command).items():
                if parameter.default is not parameter.empty and text_of(parameter.default):
                    yield f"{application} {command}: {argument}={text_of(parameter.default)}"


def test_defaults_are_those_of_the_record():
    now = sorted({*in_python(), *on_command_lines()})
    known = RECORD.read_text(encoding="utf-8").splitlines()
    changed = [f"- {line}" for line in known if line not in set(now)]
    changed += [f"+ {line}" for line in now if line not in set(known)]
    assert not changed, "\n".join(changed)


@pytest.mark.parametrize("name", [n for n in scipy.ndimage.__all__ if hasattr(ndimage, n)])
def test_what_is_like_scipy_s_has_scipy_s_defaults(name):
    theirs = inspect.signature(getattr(scipy.ndimage, name)).parameters
    for argument, parameter in inspect.signature(getattr(ndimage, name)).parameters.items():
        if argument in theirs:
            assert parameter.default == theirs[argument].default, argument
