import subprocess
import sys

import numpy as np
import pytest
from pydantic import ValidationError

from resample.colors import from_srgb
from resample.command.settings import PictureFormat, Resampling
from resample.console import SPLAT_COLOR, linear_color
from resample.painting.choices import Footprint, Opacity, Primitive, Projection
from resample.profiles.filters import Gaussian
from resample.resampler import Resampler


def test_the_defaults_are_the_resamplers_own():
    assert Resampling().resampler() == Resampler()


def test_every_choice_arrives():
    chosen = Resampling(
        method="splats",
        footprint="projected",
        filter="gaussian:sigma=0.6",
        kernel="gaussian:sigma=0.7,radius=2.5",
        order="every-sample:thickness=2",
        threshold=0.5,
        subpixels=3,
        opacity="linear",
        color_by="primitive",
    ).resampler()
    assert chosen.primitive is Primitive.SPLATS
    assert chosen.footprint is Footprint.PROJECTED
    assert chosen.pixel_filter == Gaussian(sigma=0.6)
    assert (chosen.reconstruction.sigma, chosen.reconstruction.radius) == (0.7, 2.5)
    assert chosen.order.thickness == 2
    assert (chosen.threshold, chosen.subpixels) == (0.5, 3)
    assert chosen.opacity is Opacity.LINEAR
    assert chosen.splat_color == SPLAT_COLOR


def test_the_names_are_those_of_the_resampler():
    families = {
        ("method", "primitive"): Primitive,
        ("footprint", "footprint"): Footprint,
        ("opacity", "opacity"): Opacity,
        ("projection", "projection"): Projection,
    }
    for (option, field), family in families.items():
        for member in family:
            iso = 1.0 if member is Projection.FIRST_HIT else None
            given = {option: member.value, "iso": iso}
            built = Resampling.model_validate(given).resampler()
            assert getattr(built, field) is member


@pytest.mark.parametrize(
    "choice",
    [
        {"method": "dots"},
        {"threshold": -1},
        {"threshold": float("nan")},
        {"subpixels": 0},
        {"subpixels": 33},
        {"colour": "red"},
    ],
)
def test_what_is_not_allowed_is_refused(choice):
    with pytest.raises(ValidationError, match=next(iter(choice))):
        Resampling(**choice)


def test_an_unknown_plugin_lists_the_known():
    with pytest.raises(LookupError, match="known filters: area, box"):
        Resampling(filter="sinc").resampler()


@pytest.mark.parametrize(
    ("text", "size"),
    [("400", (400, 400)), ("640x480", (480, 640)), ("640X480", (480, 640)), (" 8 ", (8, 8))],
)
def test_a_size_is_width_by_height(text, size):
    assert PictureFormat(size=text).height_and_width() == size


@pytest.mark.parametrize("text", ["", "x", "4x", "x4", "4x4x4", "1e2", "-4", "4.0", "1_0", "٤"])
def test_a_size_is_whole_numbers(text):
    with pytest.raises(ValueError, match="give 400 or 640x480"):
        PictureFormat(size=text).height_and_width()


@pytest.mark.parametrize("text", ["0", "0x4", "4x0", "1000000", "16385x16384"])
def test_a_size_is_one_that_a_picture_can_have(text):
    with pytest.raises(ValueError, match="both sides must be at least 1 and there can be at most"):
        PictureFormat(size=text).height_and_width()


def test_bits_may_come_as_a_word_of_the_command_line():
    assert PictureFormat(bits="16").bits == PictureFormat(bits=16).bits == 16
    for wrong in (12, "12", "deep", "²"):
        with pytest.raises(ValidationError, match="bits"):
            PictureFormat(bits=wrong)


def test_colors_are_linear():
    assert linear_color("none") is linear_color("None") is None
    assert linear_color("white") == linear_color("#ffffff") == (1, 1, 1)
    assert linear_color("black") == (0, 0, 0)
    gray = float(from_srgb(np.array(0x80 / 255)))
    assert linear_color("#808080") == pytest.approx((gray, gray, gray))
    assert linear_color("tomato")[0] == 1


@pytest.mark.parametrize("name", ["nonsense", "", "#12345"])
def test_a_color_that_is_none_is_refused(name):
    with pytest.raises(ValueError, match="give none, #rrggbb or a color's name"):
        linear_color(name)


@pytest.mark.sweep
def test_settings_import_no_numerics():
    code = "import sys, resample.command.settings; print(*sys.modules)"
    imported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    ).stdout.split()
    assert {"numpy", "numba", "matplotlib"} & set(imported) == set()
