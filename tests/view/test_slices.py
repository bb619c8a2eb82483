"""Slices beside a volume, cuts at them, and what is measured between two places."""

from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from resample_volume import as_volume
from resample_volume.command.choices import AppearanceChoices
from resample_volume.files.source import write_volume
from resample_volume.viewing import volume_view
from tests.view.browsing import after, chromium, settled, tab_of
from tests.view.conftest import Served, levels, served

pytestmark = pytest.mark.browser

SIZE = (32, 24, 16)  # voxels along x, y, z
SPACING = (1.0, 1.5, 2.0)
RAMP = np.indices(SIZE[::-1])[2] * 8  # along x
BEGIN = (AppearanceChoices(camera="20,10,1", fov=0.0, transfer="gray", window="124,248"),)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path = tmp_path_factory.mktemp("volume") / "ramp.nii"
    volume = as_volume(RAMP.astype(np.uint8))._replace(spacing=np.array(SPACING), space="lps")
    write_volume(path, volume)
    with served(volume_view(str(path), begin=BEGIN)) as address:
        yield address


@pytest.fixture(scope="module")
def tab(place: Served) -> Iterator[Any]:
    with chromium() as browser, tab_of(browser, place.address, (1000, 700)) as opened:
        yield opened


@pytest.fixture
def sliced(tab: Any) -> Any:
    tab.click("#reset")
    settled(tab)
    tab.click("#slices")
    settled(tab)
    return tab


def shown(tab: Any, name: str) -> NDArray[np.uint8]:
    """Gray levels of a slice on the page."""
    settled(tab)
    seen = Image.open(BytesIO(tab.locator(f"#slice-{name}").screenshot())).convert("RGB")
    return np.asarray(seen)


def clicked(tab: Any, name: str, right: float, down: float) -> None:
    """Click on a slice at shares of it."""
    box, image = tab.locator(f"#slice-{name}").bounding_box(), (0, 1) if name == "axial" else (0, 2)
    sides = [SIZE[axis] * SPACING[axis] for axis in image]
    scale = min(box["width"] / sides[0], box["height"] / sides[1])
    x = box["x"] + box["width"] / 2 + (right - 0.5) * scale * sides[0]
    tab.mouse.click(x, box["y"] + box["height"] / 2 + (down - 0.5) * scale * sides[1])


def numbers(tab: Any) -> list[int]:
    names = ("sagittal", "coronal", "axial")  # along x, y and z
    return [int(tab.input_value(f"#slice-{name}-number")) for name in names]


@pytest.mark.sweep
def test_the_server_sends_slices_and_lines(place: Served) -> None:
    with place.page() as page:
        page.say("slice", {}, plane="axial", voxel=(3, 4, 5), window=(0.0, 255.0))
        head, data = page.answer()
        assert (head["kind"], head["plane"], head["value"]) == ("slice", "axial", "24")
        assert levels(data).shape == (40, round(40 * 32 / 36), 3)
        start, end = page.about["box"]["middle"], [0.0, 0.0, 0.0]
        page.say("measure", {}, start=start, end=end)
        told = page.told("measured")
        assert told["distance"] == pytest.approx(np.linalg.norm(start))
        assert told["unit"] == "mm"
        page.say("slice", {}, plane="axial", voxel=(3, 4, 16), window=None)
        assert "give indices from 0" in page.told("error")["text"]
        page.say("slice", {}, plane="oblique", voxel=(3, 4, 5), window=None)
        assert "give axial, coronal or sagittal" in page.told("error")["text"]


def test_slices_are_linked_and_have_the_window(sliced: Any) -> None:
    tab = sliced
    assert numbers(tab) == [16, 12, 8]
    clicked(tab, "axial", 10.5 / 32, 20.5 / 24)
    settled(tab)
    assert numbers(tab) == [10, 20, 8]
    assert tab.inner_text("#slice-axial-caption") == "axial · z 8 · value 80"
    tab.locator("#slice-axial-range").press("ArrowRight")
    tab.locator("#slice-coronal").hover()
    tab.mouse.wheel(0, 100)
    settled(tab)
    assert numbers(tab) == [10, 21, 9]
    flat = shown(tab, "sagittal")
    assert abs(int(flat[40, 40].mean()) - round(255 * 80 / 248)) <= 1
    after(tab, lambda: (tab.fill("#window-high-number", "100"), tab.keyboard.press("Tab")))
    flat = shown(tab, "sagittal")
    assert abs(int(flat[40, 40].mean()) - round(255 * 80 / 100)) <= 1


def test_slices_go_back_and_forth_with_undo_and_redo(sliced: Any) -> None:
    tab = sliced
    clicked(tab, "axial", 10.5 / 32, 20.5 / 24)
    clicked(tab, "coronal", 20.5 / 32, 3.5 / 16)
    moved = numbers(tab)
    assert moved[:2] == [20, 20]
    after(tab, lambda: tab.click("#undo"))
    assert numbers(tab) == [10, 20, 8]
    after(tab, lambda: tab.click("#undo"))
    assert numbers(tab) == [16, 12, 8]
    after(tab, lambda: (tab.click("#redo"), tab.click("#redo")))
    assert numbers(tab) == moved
    after(tab, lambda: tab.click("#reset"))
    after(tab, lambda: tab.click("#undo"))
    tab.click("#slices")
    settled(tab)
    assert numbers(tab) == moved


def test_a_slice_is_shown_in_the_volume_and_cuts_it(sliced: Any) -> None:
    tab = sliced
    after(tab, lambda: tab.check("#slice-coronal-show"))
    assert tab.input_value("#option-plane") == "y=12:window=0..248"
    after(tab, lambda: tab.check("#slice-coronal-cut"))
    assert tab.input_value("#option-clip") == "0,1,0,0.75"  # half a voxel; far from the eye
    after(tab, lambda: tab.locator("#slice-coronal-range").press("ArrowRight"))
    assert tab.input_value("#option-plane").startswith("y=13:")
    assert tab.input_value("#option-clip") == "0,1,0,2.25"
    after(tab, lambda: tab.click("#undo"))
    assert numbers(tab)[1] == 12
    after(tab, lambda: tab.uncheck("#slice-coronal-show"))
    after(tab, lambda: tab.uncheck("#slice-coronal-cut"))
    assert (tab.input_value("#option-plane"), tab.input_value("#option-clip")) == ("", "")


def said(tab: Any) -> str:
    return str(tab.inner_text("#profile-said"))


def test_a_line_between_two_places_has_a_length_and_a_profile(sliced: Any) -> None:
    tab = sliced
    tab.click("#measure")
    assert said(tab) == "click two places"
    settled(tab)
    clicked(tab, "axial", 4.5 / 32, 12.5 / 24)
    clicked(tab, "axial", 24.5 / 32, 4.5 / 24)
    tab.wait_for_selector("#profile:visible")
    length = np.hypot(20 * SPACING[0], 8 * SPACING[1])
    assert said(tab) == f"{length:.6g} mm long · values 32 to 192"
    assert tab.locator(".measured text").text_content() == f"{length:.4g} mm"
    box = tab.locator("#profile").bounding_box()
    tab.mouse.move(box["x"] + 46 + (box["width"] - 54) / 2, box["y"] + 20)
    assert said(tab).startswith("at 11.66")
    assert said(tab).endswith("value 112")
    tab.click("#reset")
    settled(tab)
    assert tab.locator(".measured text").count() == 0
    assert tab.is_hidden("#profile")


def test_clicks_on_the_volume_measure_the_distance_of_what_is_picked(tab: Any) -> None:
    tab.click("#reset")
    settled(tab)
    tab.click("#measure")
    settled(tab)
    box, places = tab.locator(".canvas").bounding_box(), []
    for right, down in ((0.5, 0.5), (0.56, 0.45)):
        before = tab.inner_text("#picked")
        tab.mouse.click(box["x"] + right * box["width"], box["y"] + down * box["height"])
        tab.wait_for_function(
            "before => ![before, ''].includes(document.querySelector('#picked').textContent)",
            arg=before,
        )
        text = tab.inner_text("#picked").split("position ")[1].split(" · ")[0]
        places.append(np.array(text.split(","), float))
    tab.wait_for_selector("#profile:visible")
    assert said(tab).startswith(f"{np.linalg.norm(places[1] - places[0]):.6g} mm long")
    tab.click("#measure")


def test_slices_have_half_of_a_narrow_screen(tab: Any) -> None:
    tab.set_viewport_size({"width": 390, "height": 844})
    tab.click("#reset")
    settled(tab)
    tab.click("#slices")
    settled(tab)
    assert tab.locator(".panes").bounding_box()["height"] >= 422
    boxes = [tab.locator(f"#slice-{one}-range").bounding_box() for one in ("axial", "sagittal")]
    assert min(box["width"] for box in boxes) >= 80
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
