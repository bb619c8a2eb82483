"""What clouds were called in `resample_warp3d` works for one release, and says the new name."""

import importlib
import shlex
import tomllib
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import resample_points
import resample_warp3d
from resample import cli as umbrella
from resample.memory import bytes_of
from resample.view import server
from resample_points import cli
from resample_warp3d import cli as former
from tests import commands
from tests.commands import refused

ended, before = partial(commands.ended, cli.app), partial(commands.ended, former.app)
WORDS = ["scan.xyz", "--size", "16", "--no-cache"]
NAMES = ("Cloud", "CloudStyle", "framed", "prepare_cloud", "read_cloud", "render_cloud")


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, with a cloud."""
    monkeypatch.chdir(tmp_path)
    np.savetxt("scan.xyz", np.random.default_rng(1).random((50, 3)))
    return tmp_path


@pytest.fixture
def pages(monkeypatch):
    """What is served in the browser, and where."""
    found = []
    monkeypatch.setattr(server, "serve", lambda view, **words: found.append((view, words)))
    return found


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("old", "new", "name", "more"),
    [
        ("cloud", "render", "png", ["--color-by", "z"]),
        ("animate-cloud", "animate", "gif", ["--frames", "2"]),
    ],
)
def test_an_old_command_makes_the_same_file_and_says_the_new_name(old, new, name, more, capsys):
    assert ended(new, *WORDS, *more, "-o", f"new.{name}") == 0
    assert capsys.readouterr().err == ""
    assert before(old, *WORDS, *more, "-o", f"old.{name}") == 0
    assert capsys.readouterr().err == (
        f"resample: resample-warp3d {old} is now resample-points {new}; the old name goes with the "
        "next release\n"
    )
    assert Path(f"old.{name}").read_bytes() == Path(f"new.{name}").read_bytes()


@pytest.mark.sweep
def test_an_old_command_has_the_help_and_the_errors_of_the_new_one(capsys):
    assert before("cloud", "--help") == 0
    assert "resample-points render" in capsys.readouterr().out
    assert before("cloud", "scan.xyz", "--size", "0", "-o", "a.png") == 2
    assert "at least 1" in capsys.readouterr().err.splitlines()[-1]
    assert commands.ended(umbrella.app, "warp3d", "cloud", *WORDS, "-o", "a.png") == 0
    assert commands.ended(umbrella.app, "points", "render", *WORDS, "-o", "b.png") == 0
    assert Path("a.png").read_bytes() == Path("b.png").read_bytes()


@pytest.mark.sweep
def test_settings_of_an_old_command_are_taken_by_the_new_one(capsys):
    look = 'command = "resample-warp3d {}"\ncolor-by = "z"\n'
    Path("old.toml").write_text(look.format("cloud"))
    assert (
        ended("render", *WORDS, "--color-by", "z", "--save-settings", "n.toml", "-o", "a.png") == 0
    )
    assert tomllib.loads(Path("n.toml").read_text())["command"] == "resample-points render"
    for command in (partial(ended, "render"), partial(before, "cloud")):
        assert command(*WORDS, "--settings", "old.toml", "-o", "b.png") == 0
        assert Path("b.png").read_bytes() == Path("a.png").read_bytes()
    capsys.readouterr()
    Path("other.toml").write_text(look.format("animate-cloud"))
    words = ["render", *WORDS, "--settings", "other.toml", "-o", "c.png"]
    assert "these are settings of 'resample-warp3d animate-cloud'" in refused(
        cli.app, capsys, *words
    )


@pytest.mark.sweep
def test_the_schema_of_an_old_command_is_that_of_the_new_one(capsys):
    schemas = []
    for words in (["resample-warp3d", "cloud"], ["resample-points", "render"]):
        assert commands.ended(umbrella.app, "schema", *words) == 0
        out, error = capsys.readouterr()
        schemas.append(out)
        assert ("is now resample-points render" in error) == (words[1] == "cloud")
    assert schemas[0] == schemas[1]
    assert "color-by" in schemas[0]


@pytest.mark.sweep
def test_a_cloud_is_viewed_by_the_old_command_too(pages, capsys):
    words = ["view", "scan.xyz", "--camera", "-70/10/1", "--up=-y", "--steady", "--port", 7]
    assert before(*words) == 0
    assert "resample-warp3d view is now resample-points view" in capsys.readouterr().err
    assert ended(*words) == 0
    (old, at), (new, there) = pages
    assert at == there == {"host": "127.0.0.1", "port": 7, "browser": True}
    assert old.about == new.about
    assert old.about["settings"] == {"camera": "-70/10/1", "up": "-y", "steady": True}


def test_memory_of_an_old_view_is_that_of_the_new_one(pages, monkeypatch):
    from resample import memory

    seen = []
    monkeypatch.setattr(server, "require_parts", lambda: seen.append(memory.ALLOWED.get()))
    assert before("view", "scan.xyz", "--memory", "1GiB") == 0
    assert seen == [bytes_of("1GiB")]
    assert len(pages) == 1


@pytest.mark.parametrize("name", NAMES)
def test_an_old_python_name_warns_and_is_the_new_one(name):
    said = f"resample_warp3d.{name} is now resample_points.{name}; the old name goes"
    with pytest.warns(DeprecationWarning, match=said):
        found = getattr(resample_warp3d, name)
    assert found is getattr(resample_points, name)
    assert name not in dir(resample_warp3d)


def test_python_that_an_old_page_wrote_still_works():
    viewing = importlib.import_module("resample_warp3d.viewing")
    with pytest.warns(DeprecationWarning, match="cloud_picture is now resample_points.viewing"):
        made = viewing.cloud_picture("scan.xyz", {"size": "16"})
    assert made.size == (16, 16)


def test_a_cloud_is_shown_in_a_notebook_by_the_old_name():
    pytest.importorskip("anywidget")
    with pytest.warns(DeprecationWarning, match="of a cloud is now resample_points.view"):
        shown = resample_warp3d.view("scan.xyz", camera="top")
    words = shlex.split(shown.to_command())
    assert words[:3] == ["resample-points", "render", "scan.xyz"]
    shown.close()
