"""What commands say they need of memory, and what they held."""

import re
import subprocess
import sys

import cv2
import numpy as np
import pytest

from benchmarks.memory import WITHIN, inputs, more, said_and_held, small
from resample import memory, registry
from resample.memory import allow, allowing, require
from tests.commands import ended, refused


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder."""
    monkeypatch.chdir(tmp_path)


def near(words):
    needed, held = said_and_held(words)
    assert held / WITHIN <= needed <= held * WITHIN, (needed, held, words)


@pytest.mark.sweep
@pytest.mark.slow
@pytest.mark.parametrize("n", [1, 3, 5], ids=["texture", "warp3d", "volume"])
def test_a_command_says_what_it_will_hold_within_a_factor(n):
    for size in (500, 1500):
        # A picture of that many pixels a side, and its depth
        rough = np.random.default_rng(1).integers(0, 255, (size // 4, size // 4, 3), np.uint8)
        cv2.imwrite(f"{size}.png", cv2.resize(rough, (size, size)))
        across = np.linspace(1000, 1500, size).astype(np.uint16)
        cv2.imwrite(f"d{size}.png", np.tile(across, (size, 1)))
    near(list(small())[n])


@pytest.mark.sweep
def test_all_sizes_and_modes_say_what_they_will_hold():
    inputs()
    for words in (*small(), *more()):
        near(words)


CASES = {
    "texture warp": ["a.png", "--matrix", "1,0.1,0,0,1,0", "--size", "500", "-o", "o.png"],
    "texture resize": ["a.png", "--size", "500", "-o", "o.png"],
    "texture rectify": ["a.png", "--corners", "1,1 9,1 9,9 1,9", "--size", "500", "-o", "o.png"],
    "texture animate": ["a.png", "-o", "o.gif"],
    "texture mesh": ["a.obj", "-o", "o.png"],
    "warp3d render": ["a.png", "d.npy", "--fov", "60", "--move", "1,0,0", "-o", "o.png"],
    "warp3d stereo": ["a.png", "d.npy", "--depth-kind", "pair", "-o", "o.png"],
    "warp3d animate": ["a.png", "d.npy", "--fov", "60", "-o", "o.gif"],
    "points render": ["a.ply", "-o", "o.png"],
    "volume render": ["checker-box:size=16,block=4", "-o", "o.png"],
    "volume animate": ["checker-box:size=16,block=4", "-o", "o.gif"],
}


@pytest.mark.some(4)
@pytest.mark.parametrize("command", CASES)
def test_what_memory_does_not_allow_is_refused_in_a_line(command, tmp_path, capsys):
    from PIL import Image

    Image.fromarray(np.full((20, 20, 3), 128, np.uint8)).save("a.png")
    np.save("d.npy", np.full((20, 20), 2.0, np.float32))
    for name in ("a.obj", "a.ply"):
        (tmp_path / name).write_text("")
    application, name = command.split()
    app, words = registry.load("apps", application), CASES[command]
    error = refused(app, capsys, name, *words, "--memory", "100MiB")
    assert "of memory, --memory allows 100.00 MiB; take a smaller" in error
    assert not list(tmp_path.glob("o.*"))


@pytest.mark.sweep
def test_what_is_allowed_is_worked_on(capsys, monkeypatch):
    monkeypatch.setenv("RESAMPLE_LOG", "debug")
    app = registry.load("apps", "volume")
    words = ["render", "checker-box:size=16,block=4", "--size", "16", "-o", "o.png"]
    assert ended(app, *words, "--memory", "3GiB") == 0
    said = capsys.readouterr().err
    assert "visible voxels" in said
    assert "peak memory: " in said


def test_what_is_allowed_ends_with_its_block():
    with allowing(None):
        allow(1000)
        with pytest.raises(ValueError, match=r"--memory allows 0\.00 MiB; do less, or allow more"):
            require("all", {"libraries": 2000}, "do less")
    require("all", {"libraries": 2000}, "do less")
    with pytest.raises(ValueError, match="'much' is not an amount"), allowing("much"):
        pass


def test_what_is_free_is_what_is_allowed_by_itself(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: 1 << 20)
    with pytest.raises(ValueError, match=r"all needs about 100\.00 GiB of memory, .* are free"):
        require("all", {"libraries": 100 << 30}, "do less")


def test_platforms_that_do_not_tell_refuse_nothing(monkeypatch):
    monkeypatch.setattr(memory, "available_memory", lambda: None)
    require("all", {"libraries": 100 << 40}, "do less")


@pytest.mark.some(1)
@pytest.mark.parametrize(("kind", "most"), [("DATA", 300 << 20), ("AS", 1100 << 20)])
def test_limits_of_the_process_are_refused_in_a_line(kind, most, tmp_path):
    resource = pytest.importorskip("resource", reason="Windows has no such limits")

    def limited():
        resource.setrlimit(getattr(resource, f"RLIMIT_{kind}"), (most, most))

    words = ["-m", "resample_texture", "warp", "sample:bricks:size=64", "--size", "32x32"]
    words += ["--corners", "4,2 28,4 30,30 2,28", "-o", str(tmp_path / "a.png")]
    command = [sys.executable, *words]
    found = subprocess.run(command, capture_output=True, text=True, preexec_fn=limited, check=False)
    assert found.returncode == 2
    assert re.fullmatch(r"resample: error: .* process \(ulimit\) leave .*\n", found.stderr)
    assert not list(tmp_path.iterdir())
