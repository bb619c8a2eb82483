"""Command lines with two lengths of help: `-h` in 15 lines, `--help` with all options."""

import inspect
import re
import sys
from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from itertools import takewhile
from textwrap import shorten, wrap
from typing import TYPE_CHECKING, Any, NamedTuple, get_origin

from cyclopts import App, Parameter
from cyclopts.command_spec import CommandSpec
from cyclopts.utils import to_tuple_converter

from resample import registry
from resample.command.flags import FULL, LIMITS, SETTINGS, described

if TYPE_CHECKING:
    from cyclopts import ArgumentCollection
    from cyclopts.argument import Argument

BRIEF = "-h"
LINES, COLUMNS = 15, 80  # at most
MOST_OPTIONS = 6
LONGEST = 24  # characters of a default in narrow columns
MORE = "show all options, by task, with their defaults"


class CommandLine(App):
    """Commands with a brief `-h` and a `--help` that names each default."""

    first: str = ""  # options that brief help shows, the most needed first

    def __init__(self, **choices: Any) -> None:
        usual = {"help_format": "plaintext", "help_flags": (FULL,)}
        super().__init__(**usual | choices)

    def parse_args(self, tokens: str | Iterable[str] | None = None, **rules: Any) -> Any:
        """Parse a command line; one with -h is a request for brief help."""
        given = sys.argv[1:] if tokens is None else tokens
        words = given.split() if isinstance(given, str) else list(given)
        if words and not words[0].startswith("-") and words[0] not in self:
            entry = f"{self.name[0].removeprefix('resample-')}.{words[0]}"
            if entry in registry.names("commands"):  # of any package
                add_command(self, entry, "")
        if BRIEF not in takewhile(lambda word: word != "--", words):
            return super().parse_args(words, **rules)
        asked = asked_for(self, words)
        if asked is None:  # says which commands there are
            return super().parse_args([FULL if word == BRIEF else word for word in words], **rules)

        def show() -> None:
            sys.stdout.write("\n".join(brief(asked)) + "\n")

        return show, inspect.signature(show).bind(), {}

    def assemble_argument_collection(self, **rules: Any) -> "ArgumentCollection":
        """Collect the arguments of a command; with help, each states its default."""
        found = super().assemble_argument_collection(**rules)
        for argument in found if rules.get("parse_docstring") else ():
            text, default = described(argument)
            more = Parameter(help=text, show_default=default if default else False)
            argument.parameter = Parameter.combine(argument.parameter, more)
        return found


class Asked(NamedTuple):
    """A request for a command's help."""

    root: App
    name: str  # with its application, as in resample-volume render
    command: App


def asked_for(root: App, words: Sequence[str]) -> Asked | None:
    """Command that a command line names, in its package; None if unknown."""
    found = Asked(root, root.name[0], root)
    for word in words:
        if word.startswith("-"):
            continue
        if word not in list(found.command):
            return found if found.command.default_command else None
        command = found.command[word]
        now = getattr(command.default_command, "now", None)
        if now is None:
            found = Asked(found.root, f"{found.name} {word}", command)
            continue
        home = registry.load("apps", now)
        found = Asked(home, home.name[0], home)
    return found


def brief(asked: Asked) -> list[str]:
    """Return the lines of brief help."""
    if asked.command.default_command is None:
        names = ", ".join(name for name in asked.command if not name.startswith("-"))
        lines = wrap(f"Commands: {names}", COLUMNS, subsequent_indent=" " * 10)
        lines.append("COMMAND -h explains a command; --help says what each of them does.")
        return [*_opening(asked, str(asked.command.help), "COMMAND"), *lines]
    text = inspect.getdoc(asked.command.default_command) or ""
    found = asked.command.assemble_argument_collection()
    arguments = {one.names[0]: one for one in found if one.names and one.names[0] != "*"}
    given, named, has_options = [], [], False
    for argument in arguments.values():
        name = argument.names[0]
        has_options |= name.startswith("--") and not argument.required
        if name.startswith("--"):
            named += [f"{name} {name.rpartition('-')[2].upper()}"] if argument.required else []
        else:
            several = "..." if get_origin(argument.hint) is list else ""
            given.append(f"{name}{several}" if argument.required else f"[{name}{several}]")
    usage = [*given, *named, *(["[OPTIONS]"] if has_options else [])]
    lines = _opening(asked, text, " ".join(usage))
    count = min(MOST_OPTIONS, LINES - len(lines) - 1)
    shown = list(_most_needed(arguments, asked.root))[:count]
    return [*lines, *_table(shown, text)]


def examples_in(text: str) -> list[str]:
    """Return the lines of the examples in a text."""
    block = text.partition("For example:\n\n")[2].partition("\n\n")[0]
    return [line[4:] for line in block.splitlines()]


def _opening(asked: Asked, text: str, usage: str) -> list[str]:
    """Return a command's description, usage and examples."""
    summary = " ".join(text.partition("\n\n")[0].split())
    lines = [*wrap(summary, COLUMNS), ""]
    lines += wrap(f"Usage: {asked.name} {usage}", COLUMNS, subsequent_indent=" " * 7)
    found = [f"  {line}" for line in examples_in(text)]
    return [*lines, "", *(["Examples:", *found, ""] if found else [])]


def _most_needed(arguments: dict[str, "Argument"], root: App) -> Iterator["Argument"]:
    """Yield options: required ones, the most needed ones, then all others."""
    options = {name: one for name, one in arguments.items() if name.startswith("--")}
    required = [name for name, one in options.items() if one.required]
    first = [f"--{name}" for name in ("output", *getattr(root, "first", "").split())]
    for name in dict.fromkeys([*required, *first, *options]):
        if name not in options:
            continue
        groups = to_tuple_converter(options[name].parameter.group)
        if not any(getattr(group, "name", group) in (SETTINGS, LIMITS) for group in groups):
            yield options[name]


def _table(arguments: Sequence["Argument"], summary: str) -> list[str]:
    """Return a line per option: its names, meaning and default; `summary`: of the command."""
    from docstring_parser import parse

    options = []
    for argument in arguments:
        if argument.parameter.help is None:
            documented = {part.arg_name: part.description for part in parse(summary).params}
            more = Parameter(help=documented.get(argument.field_info.name) or "")
            argument.parameter = Parameter.combine(argument.parameter, more)
        names = ", ".join(sorted(argument.names[:2], key=len))
        options.append((names, *described(argument)))
    width = max(len(names) for names, _, _ in [*options, (FULL, "", "")]) + 4
    lines = []
    for names, text, default in options:
        # As much of a help text as there is room for, with a short default.
        sentence, room = re.split(r"[.;](?:\s|$)", text)[0], COLUMNS - width
        ending = "" if default in ("", "none") else f" [default: {default}]"
        if len(sentence + ending) > room and len(ending) > LONGEST:
            ending = ""
        said = f"{shorten(sentence, room - len(ending), placeholder=' ...')}{ending}".strip()
        lines.append(f"{f'  {names}'.ljust(width)}{said}".rstrip())
    return [*lines, f"  {FULL}".ljust(width) + MORE]


class AddedCommand(CommandSpec):
    """A command of another package, listed in the help without a search for packages."""

    def resolve(self, parent_app: App) -> App:
        """Find the command's function, and add the options that all commands have.

        Raises LookupError: the package is not installed, or cannot be imported.
        """
        if self._resolved is None:
            from resample.command.settings import keeping_settings

            function = registry.load("commands", self.import_path)
            owner = copy(parent_app)
            owner._commands = {}
            command = keeping_settings(f"{parent_app.name[0]} {self.name}", function)
            owner.command(command, name=self.name)
            self._resolved = owner[str(self.name)]
        return self._resolved


def add_command(app: App, entry: str, purpose: str) -> None:
    """Add a command by its entry point, such as `volume.compare`.

    `app`: what it is added to, after `with_settings`. `purpose`: what help says of it in a list.
    """
    name = entry.rpartition(".")[2]
    app._commands[name] = AddedCommand(entry, name, help=purpose)
