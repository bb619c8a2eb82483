import json
import os
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

from resample import registry
from resample.cli import app
from resample.files.images import read_image
from resample.files.saving import write_png
from tests import commands
from tests.processes import python

ended = partial(commands.ended, app)

# The package that reads command lines, and what it stands on.
COMMAND_LINE = {"attr", "attrs", "cyclopts", "docstring_parser", "markdown_it", "mdurl"}
COMMAND_LINE |= {"pygments", "rich", "rich_rst", "docutils", "typing_extensions"}


@pytest.fixture
def pictures(tmp_path, rng):
    """A reference and two pictures: its equal and a noisy one."""
    rgba = np.ones((24, 32, 4), np.float32)
    rgba[..., :3] = rng.random((24, 32, 3), np.float32)
    for name, noise in (("reference", 0.0), ("same", 0.0), ("noisy", 0.2)):
        changed = rgba.copy()
        changed[..., :3] += noise * rng.standard_normal((24, 32, 3), np.float32)
        write_png(tmp_path / f"{name}.png", changed)
    return tmp_path


def test_plugins_lists_every_plugin_of_every_group(capsys):
    assert ended("plugins") == 0
    listed = capsys.readouterr().out
    for group in registry.GROUPS:
        assert f"{group}\n" in listed
        assert all(f"  {name}  (" in listed for name in registry.names(group))


def test_plugins_shows_distribution_description_and_parameters(capsys):
    ended("plugins", "filters")
    listed = capsys.readouterr().out
    assert "  tent  (hybrid-resample)\n      Weight that decreases linearly to 0;" in listed
    assert "      sigma=0.5, radius=None, lowered=False\n" in listed
    assert "orders\n" not in listed


def test_plugins_of_an_unknown_group_are_refused(capsys):
    assert ended("plugins", "filter") == 2
    assert "plugins come as apps, clouds, commands, filters" in capsys.readouterr().err


def test_a_broken_plugin_is_shown_with_its_reason(monkeypatch, capsys):
    load = registry.load

    def load_but_tent(group, name):
        if name == "tent":
            raise LookupError("filter 'tent' of outside cannot be imported: ImportError: no hann")
        return load(group, name)

    monkeypatch.setattr(registry, "load", load_but_tent)
    assert ended("plugins", "filters") == 0
    listed = capsys.readouterr().out
    assert "broken: filter 'tent' of outside cannot be imported: ImportError: no hann" in listed
    assert "sigma=0.5" in listed


def test_compare_prints_a_row_per_picture(pictures, capsys):
    files = [pictures / "same.png", pictures / "noisy.png"]
    assert ended("compare", *files, "--reference", pictures / "reference.png") == 0
    header, same, noisy = capsys.readouterr().out.splitlines()
    assert header.split() == ["picture", "psnr", "ssim", "flip", "rms", "largest"]
    assert same.split() == [str(files[0]), "inf", "1", "0", "0", "0"]
    assert 10 < float(noisy.split()[1]) < 30


def test_compare_prints_valid_json(pictures, capsys):
    files = [pictures / "same.png", pictures / "noisy.png"]
    ended("compare", *files, "-R", pictures / "reference.png", "--json")
    same, noisy = json.loads(capsys.readouterr().out)
    assert same == {
        "picture": str(files[0]), "psnr": None, "ssim": 1.0, "flip": 0.0, "rms": 0.0, "largest": 0.0
    }  # fmt: skip
    assert noisy["ssim"] < 1


def test_compare_writes_a_sheet(pictures):
    sheet = pictures / "sheet.png"
    reference = pictures / "reference.png"
    assert ended("compare", pictures / "noisy.png", "-R", reference, "-o", sheet) == 0
    assert read_image(sheet).shape[1] > 2 * 192


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["-R", "reference.png"], "needs at least one picture"),
        (["same.png"], "needs --reference"),
        (["none.png", "-R", "reference.png"], "none.png: there is no such file"),
        (["same.png", "-R", "reference.png", "-o", "sheet.jpg"], "written as .png"),
        (["same.png", "-R", "reference.png", "-o", "no/sheet.png"], "cannot be written"),
    ],
)
def test_compare_refuses_in_one_line(pictures, monkeypatch, capsys, arguments, complaint):
    monkeypatch.chdir(pictures)
    assert ended("compare", *arguments) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1


def test_applications_are_commands(capsys):
    assert ended("--help") == 0
    assert "volume " in capsys.readouterr().out


def test_an_application_gets_the_words_that_follow_its_name(monkeypatch):
    given = []
    monkeypatch.setattr(registry, "load", lambda *_: lambda words, **_: given.extend(words))
    assert ended("volume", "render", "a.nrrd", "--size", "32", "--help") == 0
    assert given == ["render", "a.nrrd", "--size", "32", "--help"]


def test_an_application_that_cannot_be_imported_is_one_line(monkeypatch, capsys):
    def refuse(group, name):
        raise LookupError(f"app {name!r} of outside cannot be imported ({group})")

    monkeypatch.setattr(registry, "load", refuse)
    assert ended("volume", "render") == 2
    assert capsys.readouterr().err == (
        "resample: error: app 'volume' of outside cannot be imported (apps)\n"
    )


@pytest.mark.sweep
def test_heavy_libraries_are_not_imported_before_they_are_needed():
    heavy = commands.HEAVY | {"pydantic"}
    lines = [["--help"], ["plugins", "filters"]]
    assert commands.imported_by_all("resample.cli", lines) & heavy == set()


@pytest.mark.sweep
def test_help_imports_what_a_command_line_is_made_of_and_nothing_else():
    # How many seconds that takes is measured by `make bench GROUPS=startup`.
    imported = python(
        "import sys; before = set(sys.modules); import resample.cli\n"
        "resample.cli.app(['--help'], result_action='return_value')\n"
        "print('imported', *{name.partition('.')[0] for name in set(sys.modules) - before})"
    )
    names = set(imported.rpartition("imported")[2].split()) - sys.stdlib_module_names
    assert {name for name in names if not name.startswith("_")} - COMMAND_LINE == {"resample"}


def test_the_version_is_that_of_the_distribution(capsys):
    from importlib.metadata import version

    assert ended("--version") == 0
    assert capsys.readouterr().out.strip() == version("hybrid-resample")


@pytest.mark.sweep
def test_the_module_runs_without_home_and_terminal():
    command = [sys.executable, "-c", "from resample.cli import main; main()", "plugins", "filters"]
    environment = {key: value for key, value in os.environ.items() if key not in ("HOME", "TERM")}
    ended = subprocess.run(
        command, env=environment, stdin=subprocess.DEVNULL, capture_output=True, check=False
    )
    assert ended.returncode == 0
    assert ended.stderr == b""
