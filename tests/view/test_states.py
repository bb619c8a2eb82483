"""What a page says of its picture, and its tools: keys, window, divider, scales, legend."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

import resample
from resample.progress import Cancel, CancelledError, report
from resample.view.views import PagePicture
from resample_points.viewing import view_of
from resample_volume.command.choices import Added, AppearanceChoices
from resample_volume.files.source import write_volume
from resample_volume.inputs import as_volume
from resample_volume.viewing import volume_view
from tests.view.browsing import after, chromium, drag, levels, middle, settled, tab_of
from tests.view.conftest import served

pytestmark = pytest.mark.browser

SIZE = (900, 520)  # px
STEPS = 30  # of whole pictures
BEGIN = (AppearanceChoices(camera="30,20,1"),)  # where it is not looked for


class Slow:
    """A painter that takes a while, tells so, and refuses one camera."""

    def paint(self, settings: Any, size: Any, *, quick: bool, cancel: Cancel) -> PagePicture:
        if settings["camera"] == "top":
            raise ValueError("no picture from above")
        for step in range(0 if quick else STEPS):
            time.sleep(0.03)
            if cancel.is_cancelled:
                raise CancelledError("stopped")
            report(step, STEPS)
        shade = np.arange(size[0], dtype=np.uint8)[:, np.newaxis]
        return PagePicture(np.broadcast_to(shade, (size[1], size[0], 3)).copy(), quick)


class SlowView:
    """A view of a slow painter."""

    about: ClassVar[dict[str, Any]] = {
        **{"title": "slow", "command": "resample-volume render", "inputs": ["a.nrrd"]},
        **{"package": "resample_volume", "controls": [], "settings": {"camera": "30,20,1"}},
    }

    def painter(self) -> Slow:
        return Slow()


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def volume(browser: Any) -> Iterator[Any]:
    view = volume_view("vessel-tree:size=24", begin=BEGIN)
    with served(view) as place, tab_of(browser, place.address, SIZE) as tab:
        yield tab


def badge(tab: Any) -> str:
    return str(tab.inner_text("#badge"))


def test_a_page_never_calls_an_old_picture_final(browser: Any) -> None:
    with served(SlowView()) as place, tab_of(browser, place.address, SIZE) as tab:
        assert badge(tab).startswith("final")
        assert tab.locator("#placeholder").count() == 0
        tab.reload(wait_until="commit")
        tab.wait_for_selector("#placeholder:has-text('first picture')")
        assert tab.locator(".canvas img").first.is_hidden()
        tab.wait_for_function("() => document.querySelector('#badge').textContent.includes('%')")
        assert tab.get_attribute(".canvas", "aria-busy") == "true"
        assert tab.locator("#progress").is_visible()
        settled(tab)
        assert tab.locator("#progress").is_hidden()
        said = tab.evaluate(
            """() => new Promise((done) => {
              const badge = document.querySelector('#badge'), said = [];
              const canvas = document.querySelector('.canvas');
              new MutationObserver(() => {
                said.push([badge.textContent, canvas.ariaBusy]);
                if (badge.textContent.startsWith('final')) done(said);
              }).observe(badge, { childList: true });
              canvas.focus();
              canvas.dispatchEvent(new KeyboardEvent('keydown', { key: 'ArrowLeft' }));
            })"""
        )
        assert said[-1][1] == "false"
        assert all(busy == "true" for _, busy in said[:-1])
        assert any("preview" in text for text, _ in said)
        assert any("%" in text for text, _ in said)
        tab.select_option("#views", "top")
        settled(tab)
        assert badge(tab) == "previous picture · not rendered"
        assert tab.inner_text(".message") == "no picture from above"


def test_a_question_mark_opens_the_sheet_of_keys(volume: Any) -> None:
    volume.locator(".canvas").focus()
    volume.keyboard.press("?")
    text = volume.inner_text("#help")
    for word in ("rotate", "pan", "zoom", "Window/level", "undo"):
        assert word in text
    volume.keyboard.press("Escape")
    assert volume.locator("#help").is_hidden()
    volume.locator("#option-window").focus()
    volume.keyboard.press("?")  # that is written
    assert volume.locator("#help").is_hidden()
    volume.fill("#option-window", "")
    volume.click("#help-open")
    volume.click("#help-close")


def test_window_and_level_are_dragged_in_the_picture(volume: Any) -> None:
    after(volume, lambda: volume.select_option("#looks", "gray"))
    after(volume, lambda: (volume.fill("#option-window", "100,80"), volume.keyboard.press("Tab")))
    volume.locator(".canvas").focus()
    volume.keyboard.press("w")
    after(volume, lambda: drag(volume, middle(volume), 40, 0))
    center, width = map(float, volume.input_value("#option-window").split(","))
    assert center == pytest.approx(100)
    assert width == pytest.approx(80 * np.exp(40 / 200), rel=0.05)
    assert "window" in volume.inner_text("#readout")
    after(volume, lambda: drag(volume, middle(volume), 0, -40))
    higher, same = map(float, volume.input_value("#option-window").split(","))
    assert higher > center
    assert same == pytest.approx(width)
    assert volume.input_value("#option-camera") == "30,20,1"
    volume.keyboard.press("w")
    volume.keyboard.down("Control")
    after(volume, lambda: drag(volume, middle(volume), -40, 0))
    volume.keyboard.up("Control")
    assert float(volume.input_value("#option-window").split(",")[1]) < width
    after(volume, lambda: volume.click("#reset"))


def test_a_divider_slides_over_two_pictures(volume: Any) -> None:
    after(volume, lambda: volume.select_option("#rivals", "method=points"))
    volume.click("#slides")
    assert volume.locator("#other").count() == 0
    assert volume.locator("#compared").is_visible()
    box, (x, y) = volume.locator(".canvas").bounding_box(), middle(volume, "#divider")
    after(volume, lambda: drag(volume, (x + 80, y), 30, 0))  # both are turned
    drag(volume, (x, y + 60), -0.25 * box["width"], 0)
    moved = middle(volume, "#divider")[0] - box["x"]
    assert moved == pytest.approx(0.25 * box["width"], abs=2)
    volume.keyboard.press("Tab")
    volume.locator("#divider").focus()
    volume.keyboard.press("ArrowRight")
    now = middle(volume, "#divider")[0] - box["x"]
    assert now == pytest.approx(moved + 0.02 * box["width"], abs=2)
    assert volume.inner_text(".side-name.right").endswith(("dB", "equal"))
    assert "method points" in volume.inner_text(".side-name.left")
    after(volume, lambda: volume.select_option("#rivals", ""))
    assert volume.locator("#compared").is_hidden()
    assert volume.locator("#divider").is_hidden()


def test_scales_are_options_of_volumes_and_drawn_over_clouds(volume: Any, browser: Any) -> None:
    before = levels(volume)
    volume.locator(".canvas").focus()
    after(volume, lambda: volume.keyboard.press("s"))
    assert volume.is_checked("#option-axes")
    assert volume.is_checked("#option-scale-bar")
    assert (levels(volume) != before).any()
    after(volume, lambda: volume.click("#scales"))
    np.testing.assert_array_equal(levels(volume), before)
    file = resample.sample_path("sample:knot-points")
    with served(view_of(file)) as place, tab_of(browser, place.address, SIZE) as tab:
        tab.click("#scales")
        assert tab.locator(".scales line").count() == 3
        text = tab.locator(".scales text").last.text_content()
        assert float(text) > 0


def test_several_volumes_have_a_legend(browser: Any, tmp_path: Path) -> None:
    z, y, x = np.indices((16, 16, 16)) - 7.5
    for name, values in (
        ("ball", 120 - 12 * np.hypot(np.hypot(x, y), z)),
        ("tube", 9 * (8 - abs(x))),
    ):
        volume = as_volume(np.clip(values, 0, 255).astype(np.uint8), name)
        write_volume(tmp_path / f"{name}.nrrd", volume)
    added = Added(also=(f"{tmp_path / 'tube.nrrd'}:transfer=auto:color=red",))
    view = volume_view(str(tmp_path / "ball.nrrd"), begin=BEGIN, added=added)
    with served(view) as place, tab_of(browser, place.address, SIZE) as tab:
        assert tab.locator("#legend li").all_inner_texts() == ["ball", "tube"]
        after(tab, lambda: drag(tab, middle(tab), 40, 10))
        tab.mouse.click(*middle(tab))
        tab.wait_for_selector("#picked:has-text('value')")
        assert tab.locator("#rivals option[value=VTK]").is_disabled()


def test_the_range_of_colors_of_a_cloud_is_dragged(browser: Any) -> None:
    file = resample.sample_path("sample:knot-points")
    with served(view_of(file)) as place, tab_of(browser, place.address, SIZE) as tab:
        assert tab.locator("#contrast").is_hidden()
        after(tab, lambda: (tab.fill("#option-color-by", "z"), tab.keyboard.press("Tab")))
        tab.click("#contrast")
        after(tab, lambda: drag(tab, middle(tab), 40, 0))
        low, high = map(float, tab.input_value("#option-range").split(","))
        after(tab, lambda: drag(tab, middle(tab), 0, -40))
        lower, higher = map(float, tab.input_value("#option-range").split(","))
        assert higher - lower == pytest.approx(high - low, rel=1e-3)
        assert lower > low
        assert "window" in tab.inner_text("#readout")
        assert tab.locator("#option-camera").count() == 0 or tab.input_value(
            "#option-camera"
        ).startswith("30,20")


def test_the_window_of_channels_is_dragged_and_they_have_names(
    browser: Any, tmp_path: Path
) -> None:
    import tifffile

    path = tmp_path / "cells.ome.tif"
    stack = np.random.default_rng(7).integers(0, 255, (12, 2, 20, 24), np.uint8)
    channels = {"Name": ["DAPI", "GFP"], "Color": [0x3366FFFF, 0x00FF00FF]}
    about = {"axes": "ZCYX", "Channel": channels}
    tifffile.imwrite(path, stack, metadata=about, ome=True)
    view = volume_view(str(path), begin=BEGIN, added=Added(channels="#3366ff,lime"))
    with served(view) as place, tab_of(browser, place.address, SIZE) as tab:
        names = tab.locator("#legend li").all_inner_texts()
        assert names == ["cells.ome (DAPI)", "cells.ome (GFP)"]
        before = levels(tab)
        tab.click("#contrast")
        after(tab, lambda: drag(tab, middle(tab), 60, 0))
        low, high = map(float, tab.input_value("#option-window").split(".."))
        assert low < high
        assert (levels(tab) != before).any()


def test_methods_of_pictures_and_depth_images_are_compared(browser: Any, tmp_path: Path) -> None:
    from resample_texture.viewing import picture_view
    from resample_warp3d.command.source import SourceCamera
    from resample_warp3d.viewing import depth_view
    from tests import printed

    color, depth = tmp_path / "photo.jpg", tmp_path / "depth.npy"
    printed.picture(str(color))
    np.save(depth, np.tile(np.linspace(3, 5, 96, dtype=np.float32), (64, 1)))
    begin = (SourceCamera(fov=60),)
    for view, method in (
        (picture_view(color), "nearest"),
        (depth_view(str(color), str(depth), begin), "paper"),
    ):
        with served(view) as place, tab_of(browser, place.address, SIZE) as tab:
            after(tab, lambda one=method: tab.select_option("#rivals", f"method={one}"))
            assert f"method {method}" in tab.inner_text("#other .caption")
