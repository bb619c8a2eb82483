"""Explain usage errors and their remedies in one line."""

import re
import sys
from collections.abc import Collection, Sequence
from contextlib import suppress
from difflib import get_close_matches
from errno import ENOENT
from itertools import takewhile
from pathlib import Path
from shutil import which

from cyclopts import (
    App,
    CycloptsError,
    MissingArgumentError,
    UnknownCommandError,
    UnknownOptionError,
    UnusedCliTokensError,
)

from resample import registry
from resample.calling import ours_of
from resample.command.flags import described
from resample.messages import one_line, visible

NEAR = 0.7  # likeness of two names, from which one is taken for the other
MOST = 3  # names of files that a complaint lists
GONE = ": there is no such file"


def explained(error: BaseException, words: Sequence[str] = ()) -> str:
    """Describe a command's error in one line, with the remedy if known.

    `words`: of the command line. A missing file is told before all else.
    """
    is_mistaken = isinstance(error, ValueError | CycloptsError)
    is_mistaken = is_mistaken and not isinstance(error, UnknownCommandError)
    inputs = list(takewhile(lambda word: not word.startswith("-"), words))[1:]
    missing = _missing_input(inputs, has_output=bool({"-o", "--output"} & {*words}))
    if is_mistaken and missing:
        error = FileNotFoundError(ENOENT, GONE.removeprefix(": "), missing)
    if isinstance(error, FileNotFoundError):
        return one_line(error) + _remedy(error)
    numbers = [word for word in inputs if re.fullmatch(r"\d[\dx.,%]*", word)]
    if isinstance(error, ValueError) and numbers and not Path(numbers[0]).exists():
        return f"{one_line(error)}; {numbers[0]} is taken for a file: options have names, as --size"
    if isinstance(error, IsADirectoryError):
        # Name a file of the folder.
        first = ""
        with suppress(OSError, TypeError):
            there = sorted(path for path in Path(error.filename).iterdir() if path.is_file())
            first = f", such as {visible(str(there[0]))}" if there else " (it holds none)"
        return one_line(error) + first
    if isinstance(error, UnknownCommandError) and error.unused_tokens and error.app:
        return visible(_of_unknown_command(error, error.unused_tokens[0], error.app))
    if isinstance(error, UnknownOptionError):
        given = (error.token.keyword or error.token.value).partition("=")[0]
        names = [name for argument in error.argument_collection for name in argument.names]
        known = [name[2:] for name in names if name.startswith("--")]
        option = meant(given.lstrip("-"), known)
        remedy = f"Did you mean --{option}?" if option else f"{_command(error)} --help lists all."
        program = getattr(sys.modules.get(getattr(error.target, "__module__", "")), "app", None)
        if isinstance(program, App) and given.lstrip("-") in program:
            called = _command(error).rpartition(" ")[0]
            remedy += f" There is a command {called} {given.lstrip('-')}, too."
        return visible(f"Unknown option: {given}. {remedy}")
    if isinstance(error, MissingArgumentError) and error.argument is not None:
        # Describe a missing value, or a missing option or input.
        argument = error.argument
        assert argument is not None
        # The first clause of an argument's help says enough.
        text = re.split(r"[;.](?:\s|$)", described(argument)[0].removeprefix("Written to: "))[0]
        if error.keyword is not None:
            return visible(f"{error.keyword} needs a value{': ' * bool(text)}{text}")
        name = argument.names[0]
        left = list(error.unused_tokens or ())
        wrong = [word for word in left if word.startswith("-")]
        if wrong and meant(wrong[0].partition("=")[0].lstrip("-"), [name.lstrip("-")]):
            return visible(f"Unknown option: {wrong[0]}. Did you mean {name}?")
        if name == "--output" and len(left) == 1 and not wrong:
            return visible(f"{_command(error)} needs --output; did you mean -o {left[0]}?")
        shown = "--output (-o)" if name == "--output" else name
        example = f"{_command(error)} -h shows examples"
        return visible(f"{_command(error)} needs {shown}{': ' * bool(text)}{text}; {example}")
    if isinstance(error, UnusedCliTokensError) and error.unused_tokens:
        return f"{visible(', '.join(map(repr, error.unused_tokens)))}: {_of_too_many(error)}"
    return one_line(error)


def _of_unknown_command(error: UnknownCommandError, given: str, app: App) -> str:
    """Describe a command that there is not, by what is like it."""
    # Cyclopts would import all commands for its message; some may not be installed.
    known = [name for name in app._commands if name[0] != "-"]
    if Path(given).exists():
        first = "view" if "view" in known else known[0]
        example = f"{_command(error)} {first} {given}"
        return f"{given} is a file; give a command before it, such as {example}"
    apps = [name for name in registry.names("apps") if name in known]
    if homes := [name for name in apps if given in registry.load("apps", name)]:
        programs = " and ".join(f"resample-{name}" for name in homes)
        return f'"{given}" is a command of {programs}'
    near = get_close_matches(given, known, n=1, cutoff=NEAR)
    remedy = f'Did you mean "{near[0]}"?' if near else f"Commands are {', '.join(known)}."
    return f'Unknown command "{given}". {remedy}'


def _missing_input(inputs: Sequence[str], *, has_output: bool) -> str:
    """Return the first input that names a file that is not there, or nothing.

    Without an option for the output, the last input may be the output.
    """
    for name in inputs if has_output else inputs[:1]:
        is_path = not set(name) & set(":*?[=,") and Path(name).suffix[1:].isalnum()
        if is_path and not Path(name).exists():
            return name
    return ""


def with_own_pip(text: str) -> str:
    """Name the running Python's pip in a text, if the PATH's belongs to another Python."""
    python, found = Path(sys.executable), which("pip")
    if not python.name or (found and Path(found).parent == python.parent):
        return text
    folder = Path.cwd()
    shown = python.relative_to(folder) if python.is_relative_to(folder) else python
    return text.replace("pip install", f"{shown} -m pip install")


def meant(given: str, known: Collection[str]) -> str | None:
    """Name of the option that a user means by another name; None if none is similar.

    Examples
    --------
    >>> meant("bg", ["box", "background"]), meant("point_size", ["size", "point-size"])
    ('background', 'point-size')
    """
    own = {name.replace("-", "_"): name for name in known}
    near = get_close_matches(given.lower().replace("_", "-"), known, n=1, cutoff=NEAR)
    return own.get(ours_of(given, own, alike=True)) or (near[0] if near else None)


def _remedy(error: FileNotFoundError) -> str:
    """Return the remedy for a missing file, to be appended to the message."""
    text = str(error)
    name = error.filename or (text.partition(GONE)[0] if GONE in text else "")
    if not isinstance(name, str) or not name:
        return ""
    path, folder = Path(name), Path(name).parent
    with suppress(OSError):
        there = sorted(entry.name for entry in folder.iterdir())
        alike = get_close_matches(path.name, there, n=MOST, cutoff=NEAR)
        if near := [str(folder / one) for one in alike]:
            return f"; did you mean {visible(' or '.join(near))}?"
    return "" if folder.is_dir() else f"; there is no folder {visible(str(folder))} either"


def _of_too_many(error: UnusedCliTokensError) -> str:
    app = error.app
    assert app is not None
    found = app.assemble_argument_collection()
    inputs = [one.names[0] for one in found if one.names and one.names[0].isupper()]
    takes = " and ".join(inputs) or "no inputs"
    if all(re.fullmatch(r"-?[\d.]+", word) for word in error.unused_tokens or ()):
        return f"{_command(error)} takes {takes}; numbers of an option are joined by commas: 30,20"
    return f"{_command(error)} takes {takes}; options begin with --, and blanks need quotes"


def _command(error: CycloptsError) -> str:
    """Name of the called command, as users write it."""
    if called := getattr(error.target, "called", ""):
        return str(called)
    package = getattr(error.target, "__module__", "resample").partition(".")[0]
    return " ".join([package.replace("_", "-"), *(error.command_chain or ())])
