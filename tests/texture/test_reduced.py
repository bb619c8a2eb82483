"""A JPEG is decoded at a reduced scale where the target shows far fewer pixels."""

import json
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image

from resample.files.pictures import picture_at
from resample_texture.cli import app
from tests import commands

ended, refused = partial(commands.ended, app), partial(commands.refused, app)


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder, with a JPEG of waves and edges, and what it holds as PNG."""
    monkeypatch.chdir(tmp_path)
    y, x = np.mgrid[:450, :600] / 30
    waves = 128 + 90 * np.sin(x * x / 12) * np.cos(y)
    picture = np.stack([waves, 255 * (np.hypot(x - 9, y - 7) < 5) // 2, 255 - waves], axis=2)
    Image.fromarray(picture.astype(np.uint8)).save("a.jpg", quality=92)
    Image.open("a.jpg").save("whole.png")


def psnr(first, second):
    return cv2.PSNR(*(np.asarray(Image.open(name).convert("RGB")) for name in (first, second)))


@pytest.mark.parametrize("size", ["120", "50", "40x45"])
def test_a_thumbnail_is_as_good_as_that_of_all_pixels(size, record):
    assert ended("resize", "a.jpg", "small.png", "--size", size, "--stats", "told.json") == 0
    assert ended("resize", "whole.png", "full.png", "--size", size) == 0
    assert Path("small.png").read_bytes() != Path("full.png").read_bytes()
    assert json.loads(Path("told.json").read_text())["source"] == [600, 450]
    assert psnr("small.png", "full.png") > 45
    record.quality(size, psnr("small.png", "full.png"))


@pytest.mark.parametrize(
    "words",
    [
        ("resize", "--size", "150"),
        ("resize", "--size", "50", "--method", "bilinear"),
        ("resize", "--size", "500x45"),
        ("rotate", "--degrees", "7"),
    ],
)
def test_all_pixels_are_read_where_more_of_them_count(words):
    command, *rest = words
    for source, target in (("a.jpg", "small.png"), ("whole.png", "full.png")):
        assert ended(command, source, target, *rest) == 0
    assert psnr("small.png", "full.png") > 80


@pytest.mark.parametrize("orientation", [3, 6, 8])
def test_a_thumbnail_is_upright(orientation):
    exif = Image.Exif()
    exif[274] = orientation
    Image.open("a.jpg").save("turned.jpg", exif=exif, quality=95)
    assert ended("resize", "turned.jpg", "small.png", "--size", "50") == 0
    assert ended("resize", "whole.png", "full.png", "--size", "50") == 0
    back = {3: Image.ROTATE_180, 6: Image.ROTATE_90, 8: Image.ROTATE_270}[orientation]
    Image.open("small.png").transpose(back).save("back.png")
    assert psnr("back.png", "full.png") > 40


def test_a_scale_is_chosen_by_what_is_needed():
    reader = picture_at(Path("a.jpg"))
    assert reader.reduced(226, 300) is None
    assert reader.reduced(225, 300)[0].data.shape == (225, 300, 3)
    assert reader.reduced(1, 1)[0].data.shape == (57, 75, 3)
    assert picture_at(Path("whole.png")).reduced(1, 1) is None


def test_a_damaged_file_is_an_error_of_one_line(capsys):
    whole = Path("a.jpg").read_bytes()
    Path("a.jpg").write_bytes(whole[: len(whole) // 2])
    assert "a.jpg" in refused(capsys, "resize", "a.jpg", "small.png", "--size", "50")
    assert not Path("small.png").exists()
