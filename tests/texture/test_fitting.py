"""Pictures fitted into a size by `resize`."""

from functools import partial

import numpy as np
import pytest
from PIL import Image, ImageOps

from resample_texture import cli
from tests import commands

ended, refused = partial(commands.ended, cli.app), partial(commands.refused, cli.app)
WIDE, HIGH = (30, 60), (60, 30)  # height, width


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The working folder, with a wide and a high picture in it."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(3)
    for name, shape in (("wide", WIDE), ("high", HIGH)):
        Image.fromarray(rng.integers(0, 256, (*shape, 3), np.uint8)).save(f"{name}.png")


def resized(name, *words):
    """What `resize` makes of a picture."""
    assert ended("resize", f"{name}.png", "out.png", *words) == 0
    return np.array(Image.open("out.png"))


@pytest.mark.parametrize(("name", "shape"), [("wide", (10, 20)), ("high", (20, 10))])
def test_one_number_is_the_longer_side_as_with_thumbnails(name, shape):
    with Image.open(f"{name}.png") as image:
        assert ImageOps.contain(image, (20, 20)).size == shape[::-1]
    assert resized(name, "--size", "20").shape[:2] == shape


def test_a_small_picture_is_enlarged_to_the_size():
    assert resized("wide", "--size", "90").shape[:2] == (45, 90)


@pytest.mark.sweep
@pytest.mark.parametrize("words", [["--size", "16x12"], ["--width", "16", "--height", "12"]])
def test_two_numbers_stretch_unless_they_are_to_hold_the_picture(words):
    assert resized("wide", *words).shape == (12, 16, 3)
    assert resized("wide", *words, "--fit", "contain").shape == (8, 16, 3)
    assert resized("high", *words, "--fit", "contain").shape == (12, 6, 3)
    assert resized("wide", "--size", "16", "--fit", "stretch").shape == (16, 16, 3)


@pytest.mark.sweep
def test_a_cover_fills_the_size_and_cuts_off_the_rest_on_both_sides():
    whole = resized("wide", "--size", "20x10")
    np.testing.assert_array_equal(
        resized("wide", "--size", "10x10", "--fit", "cover"), whole[:, 5:15]
    )


@pytest.mark.sweep
def test_padding_is_transparent_around_the_fitted_picture():
    whole = resized("wide", "--size", "20x10")
    padded = resized("wide", "--size", "20", "--fit", "pad")
    assert padded.shape == (20, 20, 4)
    np.testing.assert_array_equal(
        padded[5:15], np.dstack([whole, np.full((10, 20), 255, np.uint8)])
    )
    assert not padded[:5].any()
    assert not padded[15:].any()


@pytest.mark.sweep
def test_padding_takes_a_background_or_an_edge_mode():
    over = resized("wide", "--size", "20", "--fit", "pad", "--background", "#204060")
    np.testing.assert_array_equal(over[:5], np.broadcast_to([0x20, 0x40, 0x60], (5, 20, 3)))
    assert resized("wide", "--size", "20", "--fit", "pad", "--edge", "clamp").shape == (20, 20, 3)


@pytest.mark.parametrize("words", [["--size", "50%"], ["--width", "9"]])
def test_a_fit_needs_a_width_and_a_height(words, capsys):
    complaint = refused(capsys, "resize", "wide.png", "out.png", *words, "--fit", "cover")
    assert "fit needs a width and a height in px" in complaint
