"""`resample-texture info`."""

import json
from functools import partial

import cv2
import numpy as np
import pytest
from PIL import Image

from resample_texture import cli
from tests import commands
from tests.metadata.profiles import matrix_profile

ended = partial(commands.ended, cli.app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder of every command."""
    monkeypatch.chdir(tmp_path)


def printed(capsys, name):
    """What is printed as JSON of a file."""
    assert ended("info", name, "--json") == 0
    return json.loads(capsys.readouterr().out)


def test_what_is_assumed_of_colors_without_a_mark_has_a_line(capsys):
    cv2.imwrite("in.png", np.zeros((2, 3, 3), np.uint16))
    assert ended("info", "in.png") == 0
    lines = capsys.readouterr().out.splitlines()
    assert 'assumed           "16 bits are taken for linear light"' in lines
    assert "size              [3, 2]" in lines


def test_a_profile_and_a_turn_are_named(capsys):
    tags = Image.Exif()
    tags[274] = 6
    image = Image.fromarray(np.zeros((2, 3, 3), np.uint8))
    image.save("in.jpg", exif=tags, icc_profile=matrix_profile())
    facts = printed(capsys, "in.jpg")
    assert facts["colors"] == "profile 'wide'"
    assert (facts["orientation"], facts["size"]) == (6, [2, 3])
    assert facts["assumed"] is None


def test_an_animation_says_how_often_it_is_shown(capsys):
    first, second = (Image.fromarray(np.full((2, 3), level, np.uint8)) for level in (0, 99))
    first.save("in.gif", save_all=True, append_images=[second], duration=100, loop=2)
    facts = printed(capsys, "in.gif")
    assert (facts["count"], facts["seconds"], facts["plays"]) == (2, 0.2, 3)
    assert facts["size"] == [3, 2]


def test_several_files_are_told_of_one_by_one(capsys):
    for name in ("a.png", "b.png"):
        cv2.imwrite(name, np.zeros((2, 3, 3), np.uint8))
    for words in (["a.png", "b.png"], ["*.png"], ["."]):
        assert ended("info", *words, "--json") == 0
        told = json.loads(capsys.readouterr().out)
        assert [each["file"] for each in told] == ["a.png", "b.png"]
        assert ended("info", *words) == 0
        tables = capsys.readouterr().out.split("\n\n")
        assert [table.splitlines()[0].split()[1] for table in tables] == ['"a.png"', '"b.png"']
    assert ended("info", "none*.png") == 2
