"""Help of all commands: brief by -h, and by --help with the default of every option."""

import inspect
import io
import re
import shlex
from functools import cache

import pytest
from cyclopts import App
from docstring_parser import parse_from_object
from rich.console import Console

from resample import registry
from resample.cli import app as core
from resample.command.help_formatter import COLUMNS, LINES, Asked, brief, examples_in
from resample.samples.finding import expanded
from tests.commands import ended, imported

APPS = {"resample": core} | {
    f"resample-{name}": registry.load("apps", name) for name in registry.names("apps")
}
DEFAULT = re.compile(r"\[default: [^\[\]]+\]")


def commands():
    """All commands that are not another's: name of their application, and their own."""
    for name, app in APPS.items():
        for command in app:
            if not command.startswith("-") and not hasattr(app[command].default_command, "now"):
                yield name, command


@pytest.fixture(autouse=True)
def _parsed_once(monkeypatch):
    # Commands share classes of options, whose sources are parsed for each of them.
    monkeypatch.setattr("docstring_parser.parse_from_object", cached)


cached = cache(parse_from_object)


def helped(application, *words, capsys):
    assert ended(APPS[application], *words) == 0
    return capsys.readouterr().out


@pytest.mark.some(6)
@pytest.mark.parametrize(("application", "command"), [*commands(), *((name, "") for name in APPS)])
def test_brief_help_has_15_lines_and_three_examples_that_parse(
    application, command, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    text = helped(application, *command.split(), "-h", capsys=capsys)
    lines = text.splitlines()
    assert len(lines) <= LINES
    assert max(map(len, lines)) <= COLUMNS
    assert f"Usage: {application} {command}".strip() in text
    assert "--help" in lines[-1]
    assert "--settings" not in text
    found = re.findall(r"^  (resample.*)$", text.replace("\\\n", ""), re.MULTILINE)
    assert len(found) == 3
    for program, *words in map(shlex.split, found):
        assert program == application
        assert not command or words[0] == command
        parsed = APPS[application].parse_args(
            expanded(words), exit_on_error=False, print_error=False
        )
        assert parsed[1].arguments or len(words) == 1


def of_built_in_data():
    """Examples that end by themselves, read built-in data alone and are no films."""
    for application, command in commands():
        if command not in ("view", "fetch", "figures", "demo", "animate"):
            text = inspect.getdoc(APPS[application][command].default_command)
            yield from ("\n".join(examples_in(text)).replace("\\\n", "").splitlines())


@pytest.mark.sweep
@pytest.mark.parametrize("line", list(of_built_in_data()))
def test_examples_of_brief_help_run(line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line)
    assert ended(APPS[program], *words) == 0


@pytest.mark.some(2)
@pytest.mark.parametrize(("application", "command"), list(commands()))
def test_every_option_names_its_default_is_required_or_a_switch(application, command):
    app = APPS[application][command]
    wrong = {}
    for argument in app.assemble_argument_collection(parse_docstring=True):
        if not argument.names or argument.names[0] == "*":
            continue
        text = argument.parameter.help or ""
        shown = argument.show_default
        is_switch = argument.hint is bool and len(argument.names) == 1
        if "Default" in text or "[default" in text:
            wrong[argument.names[0]] = text
        elif not (argument.required or is_switch or (isinstance(shown, str) and shown)):
            wrong[argument.names[0]] = f"{shown}"
    assert wrong == {}


@pytest.mark.some(3)
@pytest.mark.parametrize(("application", "command"), list(commands()))
def test_every_option_says_what_it_does_without_sending_to_another_command(application, command):
    app = APPS[application][command]
    helps = {
        argument.names[0]: argument.parameter.help or ""
        for argument in app.assemble_argument_collection(parse_docstring=True)
        if argument.names and argument.names[0] != "*"
    }
    others = "|".join(name for _, name in commands())
    sending = re.compile(rf"\b[Aa]s (in|of) (resample-\w+ )?({others})\b")
    assert {name: text for name, text in helps.items() if not text or sending.search(text)} == {}


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("application", "command", "options"),
    [
        ("resample-volume", "render", {"--memory": "all free memory", "--fov": "30"}),
        ("resample-texture", "warp", {"--bits": "those of the source", "--edge": "transparent"}),
        ("resample-points", "density", {"--axis": "z, unless --camera is given"}),
    ],
)
def test_defaults_have_one_form_on_the_screen(application, command, options):
    screen = Console(file=io.StringIO(), width=500)
    APPS[application].help_print([command], console=screen)
    text = screen.file.getvalue()
    assert "Default: " not in text
    for option, default in options.items():
        (line,) = [line for line in text.splitlines() if re.match(rf"│ \W*{option} ", line)]
        assert DEFAULT.findall(line)[0].startswith(f"[default: {default}")


def test_brief_help_of_a_command_that_is_anothers_is_that_ones(capsys):
    there = helped("resample-points", "render", "-h", capsys=capsys)
    assert helped("resample", "points", "render", "-h", capsys=capsys) == there


def test_brief_help_of_an_unknown_command_names_the_nearest(capsys):
    assert ended(APPS["resample-volume"], "rendr", "-h") == 2
    assert 'Did you mean "render"?' in capsys.readouterr().err


def test_what_follows_two_hyphens_is_no_request_for_help(capsys):
    assert ended(APPS["resample-points"], "info", "--", "-h") == 2
    assert "-h" in capsys.readouterr().err


@pytest.mark.sweep
def test_brief_help_imports_neither_numpy_nor_rich():
    loaded = imported("resample_volume.cli", "render", "-h")
    assert loaded & {"numpy", "rich", "rich.console", "numba"} == set()


def test_applications_of_others_have_brief_help_without_examples_and_texts():
    app = App(name="resample-stations")

    @app.command
    def film(file: str, /, *, output: str, months: int = 12, name: str | None = None) -> None:
        """Film the year of stations."""

    lines = brief(Asked(app, "resample-stations film", app["film"]))
    assert lines[:3] == [
        "Film the year of stations.",
        "",
        "Usage: resample-stations film FILE --output OUTPUT [OPTIONS]",
    ]
    assert "Examples:" not in lines
    assert "  --months  [default: 12]" in lines
