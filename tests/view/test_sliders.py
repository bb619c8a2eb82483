"""Sliders of a page and numbers beside them; the histogram's numbers."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from resample_volume.command.choices import AppearanceChoices
from resample_volume.viewing import volume_view
from tests.view.browsing import after, chromium, levels, tab_of
from tests.view.conftest import served

pytestmark = pytest.mark.browser

VOLUME = "vessel-tree:size=24"
BEGIN = (AppearanceChoices(camera="30,20,1", fov=0.0, transfer="gray"),)
VALUES = volume_view(VOLUME).first.volume.values  # type: ignore[attr-defined]  # of its painter


@pytest.fixture(scope="module")
def tab() -> Iterator[Any]:
    with (
        chromium() as browser,
        served(volume_view(VOLUME, begin=BEGIN)) as place,
        tab_of(browser, place.address, (900, 900)) as opened,
    ):
        told(opened)
        yield opened


def told(tab: Any) -> None:
    """Wait for the look's points, which come after the picture."""
    tab.wait_for_selector("#opacity:visible")


def begun(tab: Any) -> None:
    """Go back to the beginning, whatever was changed."""
    tab.click("#reset")
    tab.wait_for_function("() => document.querySelector('.canvas[aria-busy=false]')")
    told(tab)


def typed(tab: Any, name: str, value: float | str) -> None:
    def act() -> None:
        tab.fill(name, str(value))
        tab.keyboard.press("Tab")

    after(tab, act)


def test_the_window_is_set_by_sliders_and_numbers(tab: Any) -> None:
    begun(tab)
    typed(tab, "#window-low-number", 40)
    high = float(tab.input_value("#window-high-number"))
    center, width = map(float, tab.input_value("#option-window").split(","))
    assert (center, width) == (20 + high / 2, high - 40)
    after(tab, lambda: tab.locator("#window-high").press("ArrowLeft"))
    assert float(tab.input_value("#window-high-number")) < high
    assert tab.input_value("#window-low-number") == "40"


def test_looks_in_data_units_are_spread_by_the_same_sliders(tab: Any) -> None:
    begun(tab)
    typed(tab, "#option-transfer", "50,#102030,0 100,#ff0000,0.25 150,#ffffff,1")
    assert [tab.input_value(f"#window-{end}-number") for end in ("low", "high")] == ["50", "150"]
    typed(tab, "#window-high-number", 90)
    assert tab.input_value("#option-transfer") == "50,#102030,0 70,#ff0000,0.25 90,#ffffff,1"
    assert tab.input_value("#option-window") == ""


def test_opacity_is_a_factor(tab: Any) -> None:
    begun(tab)
    assert tab.input_value("#opacity-number") == "1"
    before = levels(tab)
    typed(tab, "#opacity-number", 0.25)
    assert tab.input_value("#option-opacity-unit") == "4"  # voxels are 1 scene unit large
    assert levels(tab)[..., :3].mean() < before[..., :3].mean()
    typed(tab, "#opacity-number", 1)
    assert tab.input_value("#option-opacity-unit") == ""
    np.testing.assert_array_equal(levels(tab), before)


def test_a_light_at_the_camera_s_angles_is_the_light_at_the_eye(tab: Any) -> None:
    begun(tab)
    at_eye = levels(tab).astype(int)
    assert tab.input_value("#light-azimuth-number") == "30"
    typed(tab, "#light-azimuth-number", -50)
    assert np.abs(levels(tab) - at_eye).max() > 20
    typed(tab, "#light-azimuth-number", 30)
    a, e = np.radians((30, 20))
    expected = np.sin(a) * np.cos(e), -np.cos(a) * np.cos(e), np.sin(e)
    given = np.array(tab.input_value("#option-light").split(","), float)
    np.testing.assert_allclose(given, expected, atol=1e-5)  # of the text's digits
    assert np.abs(levels(tab) - at_eye).max() <= 1


@pytest.mark.parametrize("key", ["shininess", "fov", "depth-cue"])
def test_options_that_are_numbers_have_sliders(tab: Any, key: str) -> None:
    begun(tab)
    before = levels(tab)
    after(tab, lambda: tab.locator(f"#range-{key}").press("PageUp"))
    number, slid = float(tab.input_value(f"#option-{key}")), tab.input_value(f"#range-{key}")
    assert (levels(tab) != before).any()
    typed(tab, f"#option-{key}", 0.75 * number)
    assert float(tab.input_value(f"#range-{key}")) < float(slid)
    after(tab, lambda: tab.keyboard.press("Control+z"))
    assert tab.input_value(f"#range-{key}") == slid


def test_the_histogram_tells_what_is_under_the_pointer(tab: Any) -> None:
    begun(tab)
    tab.locator("#histogram").scroll_into_view_if_needed()
    box, known = tab.locator("#histogram").bounding_box(), volume_view(VOLUME).about["histogram"]
    tab.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 30)
    value = known["low"] + 0.7 * (known["high"] - known["low"])
    edges = np.linspace(known["low"], known["high"], 257)
    bin_of = int(np.searchsorted(edges, value, side="right")) - 1
    count = int(((edges[bin_of] <= VALUES) & (edges[bin_of + 1] > VALUES)).sum())
    said = tab.inner_text("#under-pointer").split(" · ")
    assert float(said[0].removeprefix("value ")) == pytest.approx(value, abs=0.3)  # px of the page
    assert said[1] == f"{count:,} voxels"
    assert float(said[2].removeprefix("opacity ")) == pytest.approx(0.7, abs=0.003)
    tab.mouse.move(5, 300)
    assert tab.inner_text("#under-pointer") == ""
