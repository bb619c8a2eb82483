"""Bars of opaque colors: sizes, which way up, scales."""

import numpy as np
import pytest

from resample.colors import check_colormap, mapped
from resample.measuring.color_bars import LONGEST, BarLayout, check_bar, plain_bar, ticks_of

RAMP = np.stack([np.linspace(0, 1, 100), np.full(100, 0.5), np.zeros(100)], axis=1)


@pytest.mark.some(1)
@pytest.mark.parametrize("height", [64, 150, 401])
@pytest.mark.parametrize("title", ["", "intensity", "a very long name of a column"])
def test_a_bar_is_as_high_as_asked_for_and_opaque(height, title):
    bar = plain_bar(RAMP, (0.0, 255.0), height, title=title)
    assert bar.shape[::2] == (height, 4)
    assert bar.shape[1] < 0.8 * height + 80
    assert (bar[..., 3] == 1).all()


def test_the_greatest_value_is_at_the_top():
    bar = plain_bar(RAMP, (0.0, 1.0), 200)
    column = bar[:, 16, :3]
    inside = np.abs(column[:, 1] - 0.5) < 0.01
    red = column[inside, 0]
    assert inside.sum() > 150
    assert (np.diff(red) <= 0).all()
    assert red[0] > 0.97
    assert red[-1] < 0.03


def test_text_is_dark_on_light():
    light = plain_bar(RAMP, (0.0, 1.0), 100, background=(1.0, 1.0, 1.0))
    dark = plain_bar(RAMP, (0.0, 1.0), 100)
    assert light[0].min() == pytest.approx(1)
    assert dark[0, :, :3].max() == 0
    assert light[..., :3].min() < 0.05
    assert dark[..., :3].max() > 0.7


def test_equal_values_have_a_scale_too():
    assert plain_bar(RAMP, (7.0, 7.0), 100).shape[0] == 100
    assert 4.0 in ticks_of((0.0, 10.0), 5)


def test_too_low_a_bar_is_refused(tmp_path):
    with pytest.raises(ValueError, match="at least 64 px high"):
        plain_bar(RAMP, (0.0, 1.0), 63)
    with pytest.raises(ValueError, match="at least 64 px high"):
        check_bar(tmp_path / "a.png", 63)
    with pytest.raises(ValueError, match=r"a color bar has no depth; write a \.png"):
        check_bar(tmp_path / "a.exr", 100)


def test_colormaps_are_matplotlibs():
    np.testing.assert_allclose(mapped("gray", np.array([0.0, 1.0])), [[0, 0, 0], [1, 1, 1]])
    with pytest.raises(ValueError, match="unknown colormap 'grau'"):
        check_colormap("grau")


@pytest.mark.parametrize(
    ("form", "title", "top", "middle", "curve"),
    [
        ("colors", "T", 22, 27, (27, 27)), ("colors", "", 10, 27, (27, 27)),
        ("curve", "T", 22, 27, (31, 90)), ("plane", "T", 22, 135, (135, 135)),
    ],
)  # fmt: skip
def test_a_bar_is_laid_out_by_the_size_of_its_type(form, title, top, middle, curve):
    """9 px in a picture of 300: margins are 0.8 of it, 1.7 are for a title, 1.5 below."""
    page = BarLayout.of((0.0, 2.0), 300, title, form)
    assert (page.type, page.margin, page.top, page.bottom) == (9, 7, top, 300 - 7 - 14)
    assert page.bar == (7, middle)
    assert page.curve == curve
    assert (page.row(0.0), page.row(2.0)) == (page.bottom, page.top)
    assert page.values(1).size == page.bottom - page.top
    np.testing.assert_allclose(page.values(1)[[0, -1]], [2.0, 0.0], atol=2.0 / 250)


@pytest.mark.parametrize(("height", "size"), [(10, 8), (250, 8), (265, 9), (1000, 21), (5000, 36)])
def test_type_grows_with_a_picture_within_limits(height, size):
    assert BarLayout.of((0.0, 1.0), height, "T", "colors").type == size


@pytest.mark.parametrize("count", [LONGEST - 1, LONGEST, LONGEST + 1])
def test_a_title_that_is_too_long_ends_in_dots(count):
    title = BarLayout.of((0.0, 1.0), 300, "x" * count, "colors").title
    assert title == ("x" * count if count <= LONGEST else "x" * (LONGEST - 1) + "…")
