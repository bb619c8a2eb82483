"""What the command lines of all applications have in common."""

import os
from functools import cache
from pathlib import Path

import cv2
import docstring_parser
import numpy as np
import pytest

from resample import registry
from tests.commands import HEAVY, ended, imported_by_all, interrupted, refused, strict_json

BOX = "checker-box:size=16,block=4"
HALF = ["--matrix", "0.5,0,0,0,0.5,0"]
HELP = {
    "points": [["--help"], ["--version"], ["render", "--help"]],
    "texture": [["--help"], ["--version"], ["warp", "--help"]],
    "volume": [
        *(["--help"], ["--version"]),
        *([name, "--help"] for name in ("render", "compare", "animate", "figures")),
    ],
    "warp3d": [["--help"], ["--version"], ["render", "--help"]],
}
PAINT = {  # a command of each that paints a picture
    "points": ["render", "cloud.xyz", "--size", "32"],
    "texture": ["warp", "photo.png", *HALF],
    "volume": ["render", BOX, "--size", "32"],
    "warp3d": ["render", "photo.png", "depth.npy", "--fov", "60", "--move", "1,0,0"],
}
EQUAL = {  # a picture compared with its equal
    "texture": ["white.png", "--scene", "1,0,0,0,1,0", "--methods", "bilinear"],
    "volume": [BOX, "--methods", "splats", "--rays", "1", "--size", "24"],
}
STAYS = {  # Python that makes a painter stay where it is
    "texture": """
from resample.command import session

@contextlib.contextmanager
def watched(what):
    work()
    yield None

session.progress_bar = watched
""",
    "volume": """
from resample_volume import rendering

@contextlib.contextmanager
def watched(what):
    yield work

rendering.progress_bar = watched
""",
}


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command, empty."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


parsed_once = cache(docstring_parser.parse_from_object)


def app_of(application):
    return registry.load("apps", application)


@pytest.mark.sweep
@pytest.mark.parametrize("application", HELP)
def test_help_imports_nothing_heavy(application):
    """None of its kinds, one after the other in one process."""
    assert imported_by_all(f"resample_{application}.cli", HELP[application]) & HEAVY == set()


@pytest.mark.sweep
@pytest.mark.parametrize("application", HELP)
def test_help_has_headings_and_completion_is_installed(application, folder, capsys, monkeypatch):
    # All commands' sources are parsed, of which many share classes of options.
    monkeypatch.setattr(docstring_parser, "parse_from_object", parsed_once)
    app = app_of(application)
    assert not ended(app, PAINT[application][0], "--help")
    told = capsys.readouterr().out
    for heading in ("Look" if application == "points" else "Method", "Picture", "Settings"):
        assert f"─ {heading} ─" in told
    monkeypatch.setenv("HOME", str(folder))
    monkeypatch.setenv("SHELL", "/bin/bash")
    assert not ended(app, "--install-completion")
    (script,) = folder.glob(f".local/share/bash-completion/completions/resample-{application}")
    assert f"complete -F _resample_{application}" in script.read_text()


@pytest.mark.parametrize(
    ("application", "mistyped", "command", "first"),
    [
        ("points", "rendr", "render", "FILE"),
        ("texture", "wrap", "warp", "FILES"),
        ("volume", "rendr", "render", "VOLUME"),
        ("warp3d", "rendr", "render", "COLOR"),
    ],
)
def test_a_mistyped_command_or_option_is_put_right(application, mistyped, command, first, capsys):
    app = app_of(application)
    assert f'Did you mean "{command}"' in refused(app, capsys, mistyped, "photo.png")
    assert f"needs {first}" in refused(app, capsys, command)


@pytest.mark.some(3)
@pytest.mark.parametrize("command", ["demo", "figures"])
@pytest.mark.parametrize("application", ["texture", "volume", "warp3d"])
def test_a_file_is_refused_as_a_folder(application, command, capsys, monkeypatch):
    monkeypatch.setattr(
        "resample_comparisons.texture.scenes.FINER", 1
    )  # what is made first is small
    Path(command).write_text("a file")
    assert command in refused(app_of(application), capsys, command)
    assert command in refused(app_of(application), capsys, command, "-o", command)


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write all")
@pytest.mark.parametrize("application", registry.names("apps"))
def test_a_folder_that_must_not_be_written_to_is_one_line(application, folder, capsys):
    (folder / "locked").mkdir(mode=0o555)
    words = [*PAINT[application], "-o", "locked/out.png"]
    assert "cannot be written" in refused(app_of(application), capsys, *words)


@pytest.mark.parametrize("application", EQUAL)
def test_compare_of_equal_pictures_is_valid_json(application, capsys):
    cv2.imwrite("white.png", np.full((32, 32), 255, np.uint8))
    assert ended(app_of(application), "compare", *EQUAL[application], "--json") == 0
    assert strict_json(capsys.readouterr().out)[0]["psnr"] is None


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("application", STAYS)
def test_ctrl_c_in_mid_work_leaves_one_line_and_no_file(application, folder):
    cv2.imwrite("photo.png", np.full((16, 24), 99, np.uint8))
    words = [*PAINT[application], "-o", "out.png", "--stats", "s.json"]
    status, lines = interrupted(STAYS[application], application, *words)
    assert lines == ["resample: interrupted"]
    assert status == 130
    assert [path.name for path in folder.iterdir()] == ["photo.png"]
