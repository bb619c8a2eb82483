"""One option, one meaning, on all command lines."""

import re
from collections import defaultdict
from functools import cache

import docstring_parser
import pytest
from docstring_parser import parse_from_object

from resample import registry
from tests.commands import refused

BOTH = {"--box"}  # a part of a picture, as Pillow's, and a frame around a volume
END = re.compile(r"[.:;](\s|$)")  # what follows is how it is given, or what it is if left out
GONE = [
    ("texture", "warp", "a.png", "-o", "b.png", "--reconstruction", "spline"),
    ("volume", "render", "checker-box", "-o", "b.png", "--primitive", "points"),
    ("warp3d", "render", "a.png", "b.png", "-o", "c.png", "--distortion", "0,0,0,0"),
]


def texts():
    """Help of every option: name -> meaning -> commands that say so."""
    found = defaultdict(lambda: defaultdict(list))
    for application in registry.names("apps"):
        app = registry.load("apps", application)
        for command in (name for name in app if not name.startswith("-")):
            for argument in app[command].assemble_argument_collection(parse_docstring=True):
                text = " ".join((argument.parameter.help or "").split())
                for name in (name for name in argument.names if name.startswith("--")):
                    found[name][END.split(text)[0]].append(f"{application} {command}")
    return found


@pytest.mark.sweep
def test_an_option_means_the_same_in_all_commands(monkeypatch):
    # Commands share classes of options, whose sources are parsed for each of them.
    monkeypatch.setattr(docstring_parser, "parse_from_object", cache(parse_from_object))
    options = texts()
    commands = {
        where for meanings in options.values() for all_ in meanings.values() for where in all_
    }
    assert {"texture warp", "volume render", "warp3d render"} <= commands
    assert len(options) > 50
    assert {
        name: dict(said) for name, said in options.items() if len(said) > 1 and name not in BOTH
    } == {}


@pytest.mark.some(1)
@pytest.mark.parametrize("words", GONE, ids=" ".join)
def test_an_old_spelling_is_an_unknown_option(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    application, *others = words
    (tmp_path / "a.png").touch()
    said = refused(registry.load("apps", application), capsys, *others)
    assert f"Unknown option: {others[-2]}" in said


def defaults(option):
    """Defaults of an option of rendering commands, with the help that each has."""
    for application in registry.names("apps"):
        app = registry.load("apps", application)
        for command in ("render", "animate", "mesh", "density", "compare"):
            for argument in app[command].assemble_argument_collection() if command in app else ():
                if argument.names[:1] == (option,):
                    yield f"{application} {command}", argument


@pytest.mark.sweep
def test_pictures_have_one_size_or_the_help_says_why():
    other = {}
    for name, argument in defaults("--size"):
        size, text = argument.field_info.default, argument.parameter.help or ""
        if size not in (None, "640x480"):
            other[name] = size
            assert "fits a square from all sides" in text or "Small, as methods differ" in text
    assert other == {"volume render": "400", "volume animate": "400", "volume compare": "96"}


@pytest.mark.sweep
def test_z_is_up_or_the_help_says_why():
    found = {name: argument.field_info.default for name, argument in defaults("--up")}
    assert {name: axis for name, axis in found.items() if axis != "z"} == {"texture mesh": "y"}
    assert len(found) > 5
    for _, argument in defaults("--up"):
        assert "z, but y for meshes (as in glTF and OBJ)" in (argument.parameter.help or "")
