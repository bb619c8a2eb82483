"""A volume's page in a browser: handles that cut, rivals beside, labels and picks."""

import shlex
import shutil
from base64 import b64decode
from collections.abc import Callable, Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from resample.command.settings import PictureFormat
from resample.view.views import controls_of
from resample_volume.command.choices import Look
from resample_volume.command.cli import app
from resample_volume.viewing import VolumeView
from tests.commands import ended
from tests.view.conftest import served

sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
pytestmark = pytest.mark.skipif(
    BROWSER is None, reason="no Chromium: apt install chromium, or another that is in the PATH"
)
TIME = 90_000  # ms; kernels may have to be compiled
QUIET = 250  # ms, more than after which a page asks for a whole picture
SHOWN = """() => {
  const image = document.querySelector('.canvas img'), canvas = document.createElement('canvas');
  canvas.width = image.naturalWidth;
  canvas.height = image.naturalHeight;
  canvas.getContext('2d').drawImage(image, 0, 0);
  return canvas.toDataURL('image/png').split(',')[1];
}"""


@pytest.fixture(scope="module")
def tab() -> Iterator[Any]:
    controls = controls_of("resample-volume render", app["render"])
    begin = Look(transfer="vessels"), PictureFormat(background="#203040")  # nothing shows through
    view = VolumeView("vessel-tree:size=24", begin=begin, controls=controls)
    with served(view) as place, sync_api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        tab, faults = browser.new_page(viewport={"width": 700, "height": 420}), []
        tab.on("pageerror", lambda error: faults.append(str(error)))
        tab.set_default_timeout(TIME)
        tab.goto(place.address)
        still(tab)
        yield tab
        browser.close()
        assert faults == []


def still(tab: Any, after: str = "") -> str:
    """Number of the whole picture that the page shows, once it is another than one before."""
    tab.wait_for_function(
        "before => { const image = document.querySelector('.canvas img');"
        " return image.complete && image.dataset.preview === 'false'"
        " && image.dataset.number !== before; }",
        arg=after,
    )
    return str(tab.evaluate("document.querySelector('.canvas img').dataset.number"))


def after(tab: Any, act: Callable[[], object]) -> NDArray[np.uint8]:
    """Levels of the last whole picture that follows an act."""
    number = still(tab)
    act()
    last = still(tab, number)
    while tab.wait_for_timeout(QUIET) or still(tab) != last:  # a drag may have been slow
        last = still(tab)
    data = b64decode(tab.evaluate(SHOWN))
    return np.asarray(Image.open(BytesIO(data)).convert("RGB"))


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
    left = before["x"] - 40, before["y"] - 9
    cut = after(tab, lambda: dragged(tab, "#crop-x-high", -40, -9))
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


def planes(tab: Any) -> list[list[float]]:
    given = tab.input_value("#option-clip").split("; ")
    return [[float(part) for part in one.split("/")] for one in given if one]


def test_planes_are_added_moved_turned_and_taken_away(
    tab: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    whole = after(tab, lambda: tab.click("#reset"))
    cut = after(tab, lambda: tab.click("#clip"))
    assert planes(tab) == [[0, 1, 0]]  # the half nearer to the eye is gone
    assert (cut != whole).any()
    tip = tab.locator("#clip-0-turn").bounding_box()
    cut = after(tab, lambda: dragged(tab, "#clip-0-turn", 25, 12))
    ((x, y, z),) = planes(tab)
    assert x > 0.1
    assert z < -0.1
    assert x**2 + y**2 + z**2 == pytest.approx(1, abs=1e-3)
    there = tab.locator("#clip-0-turn").bounding_box()
    assert 10 < there["x"] - tip["x"] <= 26
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
    assert "VTK is not told of clip" in tab.inner_text("#other .caption")
    tab.click("#clip")
    after(tab, lambda: tab.select_option("#rivals", ""))
    assert tab.locator("#other").count() == 0
