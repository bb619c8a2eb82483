"""A volume's page in a browser: handles that cut, rivals beside, labels and picks."""

import shlex
import shutil
from base64 import b64decode
from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from resample.command.settings import PictureFormat
from resample.progress import Cancel
from resample_volume.cli import app
from resample_volume.command.choices import AppearanceChoices
from resample_volume.viewing import volume_view
from tests.commands import ended
from tests.view.browsing import LEVELS
from tests.view.conftest import served

sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium: apt install chromium"),
]
TIME = 60_000  # ms; kernels may have to be compiled
BEGIN = (
    AppearanceChoices(transfer="vessels", camera="30,20,1"),
    PictureFormat(background="#203040"),
)  # nothing shows through


@pytest.fixture(scope="module")
def tab() -> Iterator[Any]:
    view = volume_view("vessel-tree:size=24", begin=BEGIN)
    with served(view) as place, sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab, faults = browser.new_page(viewport={"width": 900, "height": 480}), []
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.set_default_timeout(TIME)
        tab.goto(place.address)
        still(tab)
        yield tab
        browser.close()
        assert faults == []


def still(tab: Any, after: str = "") -> str:
    """Number of the whole picture that the page shows, once it waits for none and it is new."""
    tab.wait_for_function(
        "before => { const image = document.querySelector('.canvas img');"
        " return image.complete && image.dataset.number !== before"
        " && document.querySelector('.canvas[aria-busy=false]'); }",
        arg=after,
    )
    return str(tab.evaluate("document.querySelector('.canvas img').dataset.number"))


def shown(tab: Any) -> NDArray[np.uint8]:
    """Levels of the picture that the page shows."""
    return np.asarray(Image.open(BytesIO(b64decode(tab.evaluate(LEVELS)))).convert("RGB"))


def after(tab: Any, act: Callable[[], object]) -> NDArray[np.uint8]:
    """Levels of the last whole picture that follows an act."""
    number = still(tab)
    act()
    still(tab, number)
    return shown(tab)


def dragged(tab: Any, handle: str, right: float, down: float) -> None:
    box = tab.locator(handle).bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.mouse.move(x, y)
    tab.mouse.down()
    tab.mouse.move(x + right, y + down, steps=4)
    tab.mouse.up()


def of_the_command(tab: Any) -> NDArray[np.uint8]:
    """Picture of the command that the page exports."""
    tab.click("#export")
    words = shlex.split(tab.inner_text("#exports[open] #export-command"))
    tab.click("#close")
    assert ended(app, *words[1:]) == 0
    return np.asarray(Image.open("picture.png").convert("RGB"))


def test_a_box_is_cut_by_handles_and_keys(
    tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = after(tab, lambda: tab.click("#reset"))
    tab.click("#crop")
    before = tab.locator("#crop-x-high").bounding_box()
    left = before["x"] - 80, before["y"] - 18
    cut = after(tab, lambda: dragged(tab, "#crop-x-high", -80, -18))
    stop = int(tab.input_value("#option-crop").removeprefix(":").removesuffix(",:,:"))
    assert 8 < stop < 20
    there = tab.locator("#crop-x-high").bounding_box()
    np.testing.assert_allclose((there["x"], there["y"]), left, atol=8)  # half a voxel
    assert (cut != whole).any()
    np.testing.assert_array_equal(cut, of_the_command(tab))
    for key in ("ArrowUp", "Shift+ArrowUp", "ArrowDown"):
        cut = after(tab, lambda key=key: tab.locator("#crop-z-low").press(key))
    assert tab.input_value("#option-crop") == f":{stop},:,10:"
    assert tab.locator("#crop-z-low").get_attribute("aria-valuenow") == "10"
    np.testing.assert_array_equal(cut, of_the_command(tab))
    after(tab, lambda: tab.locator("#crop-z-low").press("Shift+ArrowDown"))
    again = after(tab, lambda: [tab.locator("#crop-x-high").press("Shift+ArrowUp")] * 2)
    assert tab.input_value("#option-crop") in ("", f":{stop + 10},:,:")
    assert (again != cut).any()
    tab.click("#crop")
    assert tab.locator("#crop-x-high").is_hidden()


CHOICES: list[dict[str, Any]] = [
    *({"transfer": name} for name in ("gray", "30/blue/0,90/white/0.6")),
    *({"window": "120/80"}, {"opacity-unit": 3.0}, {"gradient": "sobel"}),
    *({"gradient-opacity": "0.1/0.5"}, {"classify": "post"}, {"depth-cue": 0.6}),
    *({"crop": ":,6:,:"}, {"clip": ["1/0/0", "0/0/1/2"]}, {"background": "white"}),
    *({"camera": "60/-10/1.2"}, {"fov": 0.0}, {"up": "x"}, {"fit": "visible"}),
    *({"shading": False}, {"light": "1/0/1"}, {"ambient": 0.6}, {"diffuse": 0.2}),
    *({"specular": 0.8}, {"specular": 0.8, "shininess": 4.0}),
    *({"subpixels": 2}, {"method": "splats", "subpixels": 3}, {"projection": "maximum"}),
    *({"projection": "first-hit", "iso": 100.0}, {"axes": True}, {"box": True}),
    *({"cube": True}, {"scale-bar": True}),
]


def test_each_control_changes_the_picture_as_the_library_does(
    tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    tab.evaluate("document.querySelectorAll('details').forEach((one) => { one.open = true; })")
    view = volume_view("vessel-tree:size=24", begin=BEGIN)
    painter, begin = view.painter(), view.about["settings"]
    for choice in CHOICES:
        plain = after(tab, lambda: tab.click("#reset"))
        seen = after(tab, partial(filled, tab, choice))
        size = seen.shape[1], seen.shape[0]
        expected = painter.paint(begin | choice, size, quick=False, cancel=Cancel()).levels
        np.testing.assert_array_equal(seen, expected, str(choice))
        assert (seen != plain).any(), choice


def test_looks_of_labels_change_the_picture_as_the_library_does(tab: Any, tmp_path: Path) -> None:
    labels = tmp_path / "halves.npy"
    np.save(labels, (np.indices((24, 24, 24))[2] > 11).astype(np.uint8))
    look = AppearanceChoices(transfer="vessels", camera="30,20,1", labels=str(labels))
    choice = {"label": ["1:color=tomato", "0:opacity=0.4"]}
    view = volume_view("vessel-tree:size=24", begin=(look, BEGIN[1]))
    with served(view) as place:
        page = tab.context.browser.new_page(viewport={"width": 900, "height": 480})
        page.set_default_timeout(TIME)
        page.goto(place.address)
        still(page)
        seen = after(page, partial(filled, page, choice))
        page.close()
    size = seen.shape[1], seen.shape[0]
    settings = view.about["settings"] | choice
    expected = view.painter().paint(settings, size, quick=False, cancel=Cancel()).levels
    np.testing.assert_array_equal(seen, expected)


def filled(tab: Any, choice: dict[str, Any]) -> None:
    """Give options values, as their fields take them."""
    for key, value in choice.items():
        field = tab.locator(f"#option-{key}")
        if isinstance(value, bool):
            field.set_checked(value)
        elif field.evaluate("(one) => one.tagName") == "SELECT":
            field.select_option(value)
        else:
            field.fill("; ".join(value) if isinstance(value, list) else str(value))
            field.press("Tab")


def test_orders_filters_and_kernels_are_offered_by_name(tab: Any) -> None:
    for key, name in (("order", "axis-sheets"), ("filter", "box"), ("kernel", "gaussian")):
        listed = tab.locator(f"#option-{key}").get_attribute("list")
        assert tab.locator(f"#{listed} option[value={name}]").count() == 1


def test_enter_picks_what_is_in_the_middle(tab: Any) -> None:
    after(tab, lambda: tab.click("#reset"))
    after(tab, lambda: tab.locator(".canvas").press("Shift+ArrowUp"))
    after(tab, lambda: tab.locator(".canvas").press("Shift+ArrowUp"))
    tab.locator(".canvas").press("Enter")
    tab.wait_for_function("() => document.querySelector('#picked').textContent !== ''")
    box = tab.locator(".canvas").bounding_box()
    said = tab.inner_text("#picked").partition(" · distance")[0]
    assert said.startswith("voxel ")
    assert "value" in said
    assert "position" in said
    middle = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    tab.evaluate("document.querySelector('#picked').textContent = ''")
    tab.mouse.click(*middle)
    tab.wait_for_function("() => document.querySelector('#picked').textContent !== ''")
    assert tab.inner_text("#picked").partition(" · distance")[0] == said


def test_a_page_that_was_cut_off_comes_back_with_its_settings(tab: Any) -> None:
    other, links = tab.context.browser.new_page(), []

    def passed_on(link: Any) -> None:
        links.append(link)
        link.connect_to_server()

    other.route_web_socket("**/socket*", passed_on)
    other.set_default_timeout(TIME)
    other.goto(tab.url)
    after(other, lambda: filled(other, {"transfer": "gray"}))
    before = after(other, lambda: other.locator(".canvas").press("ArrowLeft"))
    number = still(other)
    links[0].close()
    other.wait_for_function("() => document.querySelector('.message').textContent !== ''")
    assert "reconnecting" in other.inner_text(".message")
    still(other, number)
    assert len(links) == 2
    assert other.input_value("#option-transfer") == "gray"
    assert other.input_value("#option-camera") == "36,20,1"
    np.testing.assert_array_equal(shown(other), before)
    other.close()


def planes(tab: Any) -> list[list[float]]:
    given = tab.input_value("#option-clip").split("; ")
    return [[float(part) for part in one.split(",")] for one in given if one]


def test_planes_are_added_moved_turned_and_taken_away(
    tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = after(tab, lambda: tab.click("#reset"))
    cut = after(tab, lambda: tab.click("#clip"))
    assert planes(tab) == [[0, 1, 0]]  # the half nearer to the eye is gone
    assert (cut != whole).any()
    tip = tab.locator("#clip-0-turn").bounding_box()
    cut = after(tab, lambda: dragged(tab, "#clip-0-turn", 50, 24))
    ((x, y, z),) = planes(tab)
    assert x > 0.1
    assert z < -0.1
    assert x**2 + y**2 + z**2 == pytest.approx(1, abs=1e-3)
    there = tab.locator("#clip-0-turn").bounding_box()
    assert 20 < there["x"] - tip["x"] <= 52
    np.testing.assert_array_equal(cut, of_the_command(tab))
    cut = after(tab, lambda: dragged(tab, "#clip-0-move", -20, 0))
    ((*_, offset),) = planes(tab)
    assert offset < -1
    np.testing.assert_array_equal(cut, of_the_command(tab))
    cut = after(tab, lambda: tab.click("#clip-add"))
    assert len(planes(tab)) == 2
    cut = after(tab, lambda: tab.locator("#clip-1-move").press("Shift+ArrowUp"))
    assert planes(tab)[1][:3] == [-1, 0, 0]
    assert planes(tab)[1][3] == pytest.approx(0.1 * 24 * 3**0.5, rel=1e-5)
    np.testing.assert_array_equal(cut, of_the_command(tab))
    after(tab, lambda: tab.locator("#clip-1-turn").press("ArrowLeft"))
    assert planes(tab)[1][0] > -1
    after(tab, lambda: tab.locator("#clip-0-turn").press("Delete"))
    assert len(planes(tab)) == 1
    cut = after(tab, lambda: tab.click("#clip-remove"))
    assert planes(tab) == []
    np.testing.assert_array_equal(cut, whole)
    tab.click("#clip")


def test_vtk_paints_beside_where_it_is_installed(tab: Any) -> None:
    pytest.importorskip("vtkmodules", reason="pip install 'hybrid-resample[peers]'")
    after(tab, lambda: tab.click("#reset"))
    after(tab, lambda: tab.select_option("#rivals", "VTK"))
    assert tab.inner_text("#other .caption").startswith("VTK · ")
    decibels = float(tab.inner_text("#difference .caption").split()[-2])
    assert decibels > 22  # the same thing, by other means
    after(tab, lambda: tab.locator(".canvas").press("ArrowLeft"))
    assert float(tab.inner_text("#difference .caption").split()[-2]) != decibels
    after(tab, lambda: tab.click("#clip"))
    assert "VTK does not get clip" in tab.inner_text("#other .caption")
    tab.click("#clip")
    after(tab, lambda: tab.select_option("#rivals", ""))
    assert tab.locator("#other").count() == 0
