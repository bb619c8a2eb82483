"""Pictures and films in which nothing is seen are said to be empty, by every application."""

import shlex
from importlib import import_module

import numpy as np
import pytest
from PIL import Image

from resample import registry
from tests.commands import ended

AWAY = "--matrix 1,0,5000,0,1,5000,0,0,1"
EMPTY = (
    f"resample-texture warp sample:bricks {AWAY} -o a.png",
    f"resample-texture warp sample:bricks {AWAY} -o a.jpg",
    f"resample-texture warp sample:bricks {AWAY} --background white -o a.png",
    "resample-warp3d render sample:room --move 0,0,5000 -o a.png",
    "resample-warp3d render sample:room --move 0,0,5000 --fill -o a.tif",
    "resample-volume render checker-box:size=16,block=4 --size 32 --camera 30,20,1,9,9 -o a.png",
    "resample-volume animate checker-box:size=16,block=4 --size 32 --camera 30,20,1,9,9 --frames 2"
    " -o a.gif",
    "resample-points render sample:knot-points --size 32 --camera 30,20,1,90,90 -o a.png",
    "resample-points render sample:knot-gaussians --size 32 --camera 30,20,1,90,90 -o a.exr",
)


@pytest.mark.some(4)
@pytest.mark.parametrize("line", EMPTY)
def test_what_shows_nothing_is_said_to_be_empty(line, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    program, *words = shlex.split(line)
    assert ended(import_module(f"{program.replace('-', '_')}.cli").app, *words) == 0
    told = capsys.readouterr().err
    assert told.count("the picture is empty: nothing visible lies in it") == 1


@pytest.mark.parametrize("words", ["warp sample:bricks --corners 0,0,9,0,9,9,0,9 --size 16"])
def test_what_shows_something_is_not(words, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    app = import_module("resample_texture.cli").app
    for name in ("a.png", "a.jpg"):
        assert ended(app, *words.split(), "-o", name) == 0
        assert "empty" not in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "is_same"),
    [
        ("texture warp a.png --matrix 1,0,0,0,1,0,0,0,1 -o b.png", True),
        ("texture warp a.png --matrix 1,0,1,0,1,0,0,0,1 -o b.png", False),
        ("texture rotate a.png b.png --degrees 0", True),
        ("warp3d render sample:room --fov 60 --move 0,0,0 -o b.png", True),
        ("warp3d render sample:room --fov 60 --move 0.1,0,0 -o b.png", False),
    ],
)
def test_a_result_that_is_its_input_is_said(words, is_same, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (20, 30, 3), np.uint8)).save("a.png")
    application, *rest = words.split()
    assert ended(registry.load("apps", application), *rest) == 0
    assert ("is the picture that was given" in capsys.readouterr().err) == is_same
