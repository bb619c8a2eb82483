"""Pictures with palettes: their numbers are copied, never mixed."""

import json
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from resample_texture import cli
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
COLORS = np.random.default_rng(8).integers(0, 256, (7, 3), np.uint8)
TURNED = ("rotate", "in.png", "out.png", "--degrees", "30")


@pytest.fixture(autouse=True)
def index(tmp_path, monkeypatch):
    """The numbers of in.png, in.tif and in.gif, in the working folder."""
    monkeypatch.chdir(tmp_path)
    number = np.random.default_rng(4).integers(0, 7, (12, 18), np.uint8)
    for suffix in ("png", "tif", "gif"):
        drawn(number).save(f"in.{suffix}")
    return number


def drawn(number):
    """A picture with the palette `COLORS`."""
    image = Image.frombytes("P", number.shape[::-1], number.tobytes())
    image.putpalette(COLORS.tobytes())
    return image


def read(name):
    """Numbers, palette and opacity of a file."""
    with Image.open(name) as image:
        assert image.mode == "P"
        colors = np.array(image.getpalette("RGB"), np.uint8).reshape(-1, 3)
        return np.array(image), colors, image.info.get("transparency")


@pytest.mark.some(1)
@pytest.mark.parametrize("method", ["nearest", "majority"])
@pytest.mark.parametrize("source", ["in.png", "in.tif", "in.gif"])
@pytest.mark.parametrize("target", ["out.png", "out.tif"])
def test_a_palette_and_its_numbers_are_kept(source, target, method, index):
    assert ended("resize", source, target, "--size", "200%", "--method", method) == 0
    found, colors, _ = read(target)
    np.testing.assert_array_equal(found, np.kron(index, np.ones((2, 2), np.uint8)))
    np.testing.assert_array_equal(colors[:7], COLORS)


def test_the_majority_is_of_numbers():
    number = np.uint8([[3, 3, 5, 5], [3, 5, 6, 5]])
    drawn(number).save("in.png")
    assert ended("resize", "in.png", "out.png", "--size", "50%", "--method", "majority") == 0
    assert read("out.png")[0].tolist() == [[3, 5]]


def test_what_is_not_covered_is_a_new_transparent_color():
    assert ended(*TURNED, "--method", "nearest", "--stats", "s.json") == 0
    found, colors, clear = read("out.png")
    assert found[0, 0] == 7
    np.testing.assert_array_equal(colors[:7], COLORS)
    with Image.open("out.png") as image:
        assert np.array(image.convert("RGBA"))[0, 0, 3] == 0
    assert clear is not None
    assert json.loads(Path("s.json").read_text())["encoding"] == "palette"


def test_a_transparent_color_is_that_of_what_is_not_covered(index):
    drawn(index).save("in.png", transparency=2)
    assert ended(*TURNED, "--method", "majority") == 0
    found, colors, clear = read("out.png")
    assert found[0, 0] == 2
    assert len(colors) == len(COLORS)
    assert clear == 2 or clear[2] == 0


def test_a_full_palette_says_that_what_is_not_covered_has_a_color(capsys):
    number = np.arange(256, dtype=np.uint8).reshape(16, 16)
    image = Image.frombytes("P", (16, 16), number.tobytes())
    image.putpalette(bytes(range(256)) * 3)
    image.save("in.png")
    assert ended(*TURNED, "--method", "nearest") == 0
    assert read("out.png")[0][0, 0] == 0
    assert "out.png has no free palette entry" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("--background", "white"), ("--bits", "16")])
def test_what_a_palette_cannot_hold_becomes_colors(words):
    assert ended(*TURNED, "--method", "nearest", *words) == 0
    with Image.open("out.png") as image:
        assert image.mode != "P"


def test_a_palette_on_its_side_is_written_upright(index):
    block = Image.Exif()
    block[274] = 6
    drawn(index).save("in.png", exif=block)
    assert ended("resize", "in.png", "out.png", "--size", "100%", "--method", "nearest") == 0
    np.testing.assert_array_equal(read("out.png")[0], np.rot90(index, -1))
    with Image.open("out.png") as image:
        assert image.getexif().get(274, 1) == 1


def test_other_methods_make_colors_and_say_so_once(capsys):
    Path("all").mkdir()
    for name in ("a", "b"):
        Path(f"all/{name}.png").write_bytes(Path("in.png").read_bytes())
    assert ended("resize", "all", "made/", "--size", "6x4") == 0
    assert capsys.readouterr().err.count("palette") == 1
    with Image.open("made/b.png") as image:
        assert image.mode == "RGB"
