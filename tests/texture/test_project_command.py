"""The command `project`."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample_texture import cli, project
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
PANORAMA = ("--from", "equirectangular")
FLAT = (*PANORAMA, "--to", "perspective:fov=70", "--size", "20x15")
ROUND = (*PANORAMA, "--to", "fisheye:fov=220", "--size", "24")


@pytest.fixture(autouse=True)
def panorama(tmp_path, monkeypatch):
    """The levels of pano.png, in the working folder."""
    monkeypatch.chdir(tmp_path)
    levels = np.random.default_rng(2).integers(0, 256, (4, 8, 3), np.uint8)
    made = np.array(Image.fromarray(levels).resize((64, 32), Image.Resampling.BICUBIC))
    Image.fromarray(made).save("pano.png")
    return made


def levels_of(path):
    return np.array(Image.open(path))


@pytest.mark.parametrize(
    ("words", "turn"),
    [((), (0, 0, 0)), (("--turn", "30/10/5"), (30, 10, 5)), (("--turn", "-9,4"), (-9, 4, 0))],
)
def test_the_command_shows_what_the_function_does(words, turn, panorama):
    assert ended("project", "pano.png", "out.png", *FLAT, *words) == 0
    expected = project(panorama, "equirectangular", "perspective:fov=70", (15, 20), turn).image
    assert np.abs(levels_of("out.png").astype(int) - expected).max() <= 1


@pytest.mark.sweep
def test_what_no_direction_shows_is_transparent_or_the_background():
    assert ended("project", "pano.png", "out.png", *ROUND) == 0
    assert ended("project", "pano.png", "out.jpg", *ROUND, "--background", "white") == 0
    assert levels_of("out.png")[0, 0].tolist() == [0, 0, 0, 0]
    assert levels_of("out.png")[12, 12, 3] == 255
    assert levels_of("out.jpg")[0, 0].min() > 250


def test_reports_tell_coverage_and_sizes():
    words = ("--coverage", "c.png", "--stats", "s.json")
    assert ended("project", "pano.png", "out.png", *ROUND, *words) == 0
    assert levels_of("c.png").shape == (24, 24)
    assert json.loads(Path("s.json").read_text())["size"] == [24, 24]


def test_a_folder_of_panoramas_becomes_a_folder():
    Path("all").mkdir()
    for name in ("a", "b"):
        Path(f"all/{name}.png").write_bytes(Path("pano.png").read_bytes())
    assert ended("project", "all", "made/", *FLAT) == 0
    np.testing.assert_array_equal(levels_of("made/a.png"), levels_of("made/b.png"))


@pytest.mark.some(4)
@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ((*FLAT, "--turn", "left"), "turn 'left'; give degrees right,up or right,up,clockwise"),
        ((*FLAT, "--turn", "1/nan"), "turn '1/nan'; give degrees"),
        ((*PANORAMA, "--to", "mercator", "--size", "9"), "unknown projection 'mercator'"),
        ((*PANORAMA, "--to", "equirectangular", "--size", "9"), "twice as wide as high"),
        (
            ("--from", "cubemap", "--to", "fisheye", "--size", "9"),
            "6 x 1 square faces, not 64 x 32",
        ),
        (PANORAMA, "give --to and --size, too"),
        ((), "give --from and --to and --size"),
    ],
)
def test_a_bad_projection_is_one_line(words, complaint, capsys):
    assert complaint in refused(capsys, "project", "pano.png", "out.png", *words)


def test_an_edge_mode_is_none_of_its_options(capsys):
    assert "--edge" in refused(capsys, "project", "pano.png", "out.png", *FLAT, "--edge", "wrap")
