"""Write a page of documentation for every command, from the definitions of the commands.

`docs/conf.py` does this before each build; `python tools/command_pages.py FOLDER` does it alone.
"""

import re
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import cache
from importlib import import_module
from pathlib import Path
from textwrap import dedent
from unittest.mock import patch

import docstring_parser
from cyclopts import App
from cyclopts.docs import generate_markdown_docs

PROGRAMS = ("resample", "resample-texture", "resample-warp3d", "resample-points", "resample-volume")
ELSEWHERE = ("texture", "warp3d", "points", "volume")  # of `resample`: programs with own pages
INTRODUCTION = """# Commands

Each page lists the arguments and options of one command, as `--help` prints them.
`resample NAME ...` does the same as `resample-NAME ...`.
Options of several commands have the same name and meaning in all of them.
`-h` is brief: what a command does, three examples, the options needed first.

Tuples have commas (`30,20,1.5`), sizes an x (`640x480`). Pictures without a size of their own have
640x480 px; volumes 400x400, as a square holds them from all sides. z is up; y for meshes, as in
glTF and OBJ.
"""


def pages(programs: Sequence[str] = PROGRAMS) -> Mapping[str, str]:
    """Markdown of all pages by name: the list of programs, and a page per program and command."""
    found = {"index": INTRODUCTION + tree(f"{program}/index" for program in programs)}
    with parsed_once():
        for program in programs:
            app = app_of(program)
            named = {name: app[name] for name in names_of(program, app)}
            found[f"{program}/index"] = overview(app, named)
            for name, command in named.items():
                found[f"{program}/{name}"] = page(command, program, name)
    return found


def parsed_once() -> AbstractContextManager[object]:
    """Parse each docstring once, as commands share the models of their options."""
    return patch("docstring_parser.parse_from_object", cache(docstring_parser.parse_from_object))


def app_of(program: str) -> App:
    """Definition of a program's command line."""
    app = import_module(f"{program.replace('-', '_')}.cli").app
    assert isinstance(app, App)
    return app


def names_of(program: str, app: App) -> list[str]:
    """Names of a program's commands, without hidden ones and options."""
    away = ELSEWHERE if program == "resample" else ()
    return [name for name in app if name[0] != "-" and name not in away and app[name].show]


def overview(app: App, named: Mapping[str, App]) -> str:
    """Page of a program: what its commands are for."""
    text = with_examples(generate_markdown_docs(app, recursive=False, generate_toc=False))
    about = text.partition("\n**Commands**")[0].partition("\n## ")[0]
    rows = [f"| [{name}]({name}.md) | {purpose(one)} |" for name, one in named.items()]
    return "\n".join([about.rstrip(), "", "| command | |", "|---|---|", *rows, tree(named)])


def purpose(command: App) -> str:
    """First paragraph of a command's help."""
    return " ".join(command.help.strip().partition("\n\n")[0].split())


def page(command: App, *chain: str) -> str:
    """Page of a command with its arguments and options."""
    text = with_examples(generate_markdown_docs(command, command_chain=list(chain)))
    return re.sub(r"^\*\*(.+)\*\*:$", r"## \1", text, flags=re.MULTILINE)


def with_examples(text: str) -> str:
    """The text of a page with its examples as blocks of commands."""
    return re.sub(r"^For example:\n\n((?: {4}.+\n)+)", _block, text, flags=re.MULTILINE)


def _block(found: re.Match[str]) -> str:
    lines = re.sub(r"^(?=resample)", "$ ", dedent(found[1]), flags=re.MULTILINE)
    return f"```console\n{lines}```\n"


def tree(names: Iterable[str]) -> str:
    """Hidden table of contents."""
    return "\n".join(["", "```{toctree}", ":hidden:", "", *names, "```", ""])


def write(folder: Path, programs: Sequence[str] = PROGRAMS) -> None:
    """Write all pages; those that have not changed keep their time, so they are not built again."""
    wanted = {folder / f"{name}.md": text for name, text in pages(programs).items()}
    for path in set(folder.rglob("*.md")) - set(wanted):
        path.unlink()
    for path, text in wanted.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
