"""Command lines with two lengths of help: `-h` in 15 lines, `--help` with all options."""

import inspect
import sys
from collections.abc import Iterable
from itertools import takewhile
from typing import TYPE_CHECKING, Any

from cyclopts import App, Parameter

from resample.command.flags import FULL, described

if TYPE_CHECKING:
    from cyclopts import ArgumentCollection

BRIEF = "-h"


class CommandLine(App):
    """Commands whose `-h` is brief, and whose `--help` names the default of each option."""

    first: str = ""  # options that brief help shows, the most needed first

    def __init__(self, **choices: Any) -> None:
        usual = {"help_format": "plaintext", "help_flags": (FULL,)}
        super().__init__(**usual | choices)

    def parse_args(self, tokens: str | Iterable[str] | None = None, **rules: Any) -> Any:
        """Parse a command line; one with -h is a request for brief help."""
        given = sys.argv[1:] if tokens is None else tokens
        words = given.split() if isinstance(given, str) else list(given)
        if words and not words[0].startswith("-") and words[0] not in self:
            from resample.command.additions import add_found

            add_found(self, words[0])
        if BRIEF not in takewhile(lambda word: word != "--", words):
            return super().parse_args(words, **rules)
        from resample.command.brief import asked_for, brief

        asked = asked_for(self, words)
        if asked is None:  # says which commands there are
            return super().parse_args([FULL if word == BRIEF else word for word in words], **rules)

        def show() -> None:
            sys.stdout.write("\n".join(brief(asked)) + "\n")

        return show, inspect.signature(show).bind(), {}

    def assemble_argument_collection(self, **rules: Any) -> "ArgumentCollection":
        """Collect the arguments of a command; for the help each states its default."""
        found = super().assemble_argument_collection(**rules)
        for argument in found if rules.get("parse_docstring") else ():
            text, default = described(argument)
            more = Parameter(help=text, show_default=default if default else False)
            argument.parameter = Parameter.combine(argument.parameter, more)
        return found
