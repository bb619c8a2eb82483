"""How a page begins and is laid out: sizes, themes, steps back, and zooming about the pointer."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from resample_points.viewing import view_of
from resample_texture.viewing import picture_view
from resample_volume.command.choices import AppearanceChoices
from resample_volume.viewing import volume_view
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.viewing import depth_view
from tests import snapshots
from tests.view.browsing import after, chromium, drag, levels, middle, settled, tab_of
from tests.view.conftest import Served, served

pytestmark = pytest.mark.browser

NARROW, LEAST, WIDE = (390, 844), (1100, 700), (1400, 800)  # px
VOLUME = "vessel-tree:size=24"


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture(scope="module")
def place() -> Iterator[Served]:
    with served(volume_view(VOLUME)) as address:
        yield address


@pytest.fixture(scope="module")
def parallel(browser: Any) -> Iterator[Any]:
    """A tab in which lines of sight are parallel."""
    begin = (AppearanceChoices(camera="30,20,1", fov=0.0),)
    with (
        served(volume_view(VOLUME, begin=begin)) as address,
        tab_of(browser, address.address, (900, 500), has_touch=True) as tab,
    ):
        yield tab


def camera(tab: Any) -> list[float]:
    return [float(part) for part in tab.input_value("#option-camera").split(",")]


def brightness(tab: Any, name: str) -> float:
    color = tab.evaluate(f"getComputedStyle(document.querySelector('{name}')).backgroundColor")
    return float(np.mean([float(part) for part in color.strip("rgba()").split(",")[:3]]))


def test_the_toolbar_is_one_row_from_1100_px_on(browser: Any, place: Served) -> None:
    with tab_of(browser, place.address, LEAST) as tab:
        tab.click("#clip")  # which has buttons of its own
        bar = tab.locator(".bar")
        boxes = [one.bounding_box() for one in bar.locator(":is(button, select):visible").all()]
        assert len(boxes) > 10
        assert np.ptp([box["y"] + box["height"] / 2 for box in boxes]) < 2
        assert max(box["x"] + box["width"] for box in boxes) <= LEAST[0]
        assert bar.evaluate("(bar) => bar.scrollWidth <= bar.clientWidth")


def test_a_narrow_screen_gives_the_picture_half_of_its_height(browser: Any, place: Served) -> None:
    with tab_of(browser, place.address, NARROW) as tab:
        box = tab.locator(".canvas").bounding_box()
        assert box["width"] == NARROW[0]
        assert box["height"] >= NARROW[1] / 2
        assert tab.evaluate("document.documentElement.scrollWidth") <= NARROW[0]
        assert tab.evaluate("document.documentElement.scrollHeight") <= NARROW[1]
        tab.locator("#option-transfer").scroll_into_view_if_needed()
        assert tab.locator("#option-transfer").bounding_box()["width"] > 150
        assert tab.locator(".canvas").bounding_box() == box  # is seen while options are changed


def test_the_page_is_dark_or_light_as_the_system_until_its_switch_is_used(
    browser: Any, place: Served
) -> None:
    with tab_of(browser, place.address, LEAST, color_scheme="light") as tab:
        assert brightness(tab, ".side") > 200
        tab.emulate_media(color_scheme="dark")
        tab.wait_for_selector("main[data-theme=dark]")
        assert brightness(tab, ".side") < 60
        tab.click("#theme")
        assert brightness(tab, ".side") > 200
        tab.reload()
        tab.wait_for_selector("#option-camera")
        assert brightness(tab, ".side") > 200


def sides(shown: NDArray[np.uint8]) -> tuple[float, ...]:
    """Shares of a picture's width and height left of, right of, above and below an object."""
    apart = (shown[..., :3] > 20).any(axis=-1)
    x, y = np.flatnonzero(apart.any(axis=0)), np.flatnonzero(apart.any(axis=1))
    height, width = apart.shape
    return x[0] / width, 1 - (x[-1] + 1) / width, y[0] / height, 1 - (y[-1] + 1) / height


@pytest.mark.parametrize("size", [NARROW, WIDE])
def test_the_object_fills_the_view_at_the_start(
    browser: Any, place: Served, size: tuple[int, int]
) -> None:
    with tab_of(browser, place.address, size) as tab:
        left, right, top, bottom = sides(levels(tab))
        assert min(left, right, top, bottom) > 0
        assert min(left + right, top + bottom) < 0.16
        assert abs(left - right) < 0.04
        assert abs(top - bottom) < 0.04
        begun = tab.input_value("#option-camera")
        after(tab, lambda: tab.select_option("#views", "front"))
        assert camera(tab)[:2] == [0, 0]
        left, right, top, bottom = sides(levels(tab))
        assert min(left + right, top + bottom) < 0.16
        after(tab, lambda: tab.click("#reset"))
        assert tab.input_value("#option-camera") == begun


def test_a_picture_is_measured_in_its_own_px(photo: tuple[Any, NDArray[np.uint8]]) -> None:
    tab, _ = photo
    after(tab, lambda: tab.click("#fit"))
    tab.click("#measure")
    settled(tab)
    box, corner = tab.locator(".canvas").bounding_box(), tab.input_value("#option-corners")
    (x, _), (right, _), *_ = [[float(part) for part in one.split(",")] for one in corner.split()]
    scale = (right - x) / 320 * box["width"] / levels(tab).shape[1]  # px per texel
    at = middle(tab)
    for step in (-30, 30):
        before = tab.inner_text("#picked")
        tab.mouse.click(at[0] + step, at[1] - step)
        tab.wait_for_function(
            "before => ![before, ''].includes(document.querySelector('#picked').textContent)",
            arg=before,
        )
    length = 60 * 2**0.5 / scale
    told = tab.inner_text("#profile-said").split()
    assert told[1:] == ["px", "long"]
    assert float(told[0]) == pytest.approx(length, rel=0.02)
    line = tab.locator(".measured line")
    ends = [float(line.get_attribute(name)) for name in ("x1", "y1", "x2", "y2")]
    middle_of_canvas = [box["width"] / 2, box["height"] / 2]
    wanted = [middle_of_canvas[n % 2] + step for n, step in enumerate((-30, 30, 30, -30))]
    np.testing.assert_allclose(ends, wanted, atol=1)


def test_particles_fill_the_view_at_the_start_and_are_measured(
    browser: Any, tmp_path: Path
) -> None:
    snapshots.swift(tmp_path / "a.hdf5")
    with (
        served(view_of(tmp_path / "a.hdf5")) as address,
        tab_of(browser, address.address, LEAST) as tab,
    ):
        left, right, top, bottom = sides(levels(tab))
        assert min(left, right, top, bottom) > 0
        assert min(left + right, top + bottom) < 0.16
        tab.click("#measure")
        settled(tab)
        (x, y), places = middle(tab), []
        for step in (-20, 20):
            before = tab.inner_text("#picked")
            tab.mouse.click(x + step, y)
            tab.wait_for_function(
                "before => ![before, ''].includes(document.querySelector('#picked').textContent)",
                arg=before,
            )
            text = tab.inner_text("#picked").split("position ")[1]
            places.append(np.array(text.split(","), float))
        length = float(np.linalg.norm(places[1] - places[0]))
        assert tab.inner_text("#profile-said") == f"{length:.4g} Mpc long"
        assert tab.locator(".measured text").text_content() == f"{length:.4g} Mpc"


def test_a_camera_of_the_command_line_is_kept(parallel: Any) -> None:
    assert parallel.input_value("#option-camera") == "30,20,1"


@pytest.fixture
def photo(browser: Any, tmp_path: Path) -> Iterator[tuple[Any, NDArray[np.uint8]]]:
    shown = np.random.default_rng(3).integers(0, 256, (211, 320, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "photo.png"), shown[..., ::-1])
    with (
        served(picture_view(tmp_path / "photo.png")) as address,
        tab_of(browser, address.address, LEAST) as tab,
    ):
        yield tab, shown


def corners(tab: Any) -> NDArray[np.float64]:
    text = tab.input_value("#option-corners")
    return np.array([one.split(",") for one in text.split()], float)


def test_a_photo_opens_at_1_to_1_and_is_fitted_by_a_key(
    photo: tuple[Any, NDArray[np.uint8]],
) -> None:
    tab, given = photo
    size = tab.locator(".canvas").bounding_box()
    (left, top), *_ = begun = corners(tab).astype(int)
    np.testing.assert_array_equal(levels(tab)[top : top + 211, left : left + 320, :3], given)
    assert abs(2 * left + 320 - size["width"]) <= 1
    after(tab, lambda: tab.locator(".canvas").press("0"))
    assert np.ptp(corners(tab)[:, 0]) == pytest.approx(size["width"])
    after(tab, lambda: tab.locator(".canvas").press("1"))
    np.testing.assert_array_equal(corners(tab), begun)
    after(tab, lambda: tab.mouse.dblclick(*middle(tab)))
    assert np.ptp(corners(tab)[:, 0]) == pytest.approx(size["width"])
    after(tab, lambda: tab.click("#exact"))
    np.testing.assert_array_equal(corners(tab), begun)


def test_a_photo_larger_than_the_window_is_fitted_and_stays_in_its_middle(
    photo: tuple[Any, NDArray[np.uint8]],
) -> None:
    tab, _ = photo
    after(tab, lambda: tab.set_viewport_size({"width": 620, "height": 300}))
    begun = corners(tab)
    size = tab.locator(".canvas").bounding_box()
    assert np.ptp(begun[:, 1]) == pytest.approx(size["height"], rel=0.01)  # narrow and low
    after(tab, lambda: tab.locator(".canvas").press("1"))
    assert np.ptp(corners(tab)[:, 0]) == 320


def test_reset_resets_handles_too(photo: tuple[Any, NDArray[np.uint8]], parallel: Any) -> None:
    tab, _ = photo
    before = [tab.locator(f"#corner-{n}").bounding_box() for n in range(4)]
    after(tab, lambda: drag(tab, middle(tab, "#corner-1"), 40, -20))
    after(tab, lambda: tab.set_viewport_size({"width": 1150, "height": 700}))
    after(tab, lambda: tab.set_viewport_size({"width": 1100, "height": 700}))
    after(tab, lambda: tab.click("#reset"))
    assert [tab.locator(f"#corner-{n}").bounding_box() for n in range(4)] == before
    parallel.click("#crop")
    after(parallel, lambda: parallel.click("#clip"))
    assert parallel.locator(".handle.cut:visible").count() == 8
    after(parallel, lambda: parallel.click("#reset"))
    assert parallel.locator(".handle.cut:visible").count() == 0
    assert parallel.get_attribute("#crop", "aria-pressed") == "false"
    assert parallel.input_value("#option-clip") == ""


def test_steps_go_back_and_forth_over_cameras_and_options(parallel: Any) -> None:
    tab = parallel
    after(tab, lambda: tab.click("#reset"))
    begun = levels(tab)
    after(tab, lambda: drag(tab, middle(tab), 40, 20))
    turned = camera(tab)
    assert turned[:2] == [10, 30]
    after(tab, lambda: tab.select_option("#option-classify", "pre"))
    changed = levels(tab)
    after(tab, lambda: tab.keyboard.press("Control+z"))
    assert tab.input_value("#option-classify") == "auto"
    assert camera(tab) == turned
    after(tab, lambda: tab.keyboard.press("Control+z"))  # a drag is one step
    assert camera(tab) == [30, 20, 1]
    np.testing.assert_array_equal(levels(tab), begun)
    after(tab, lambda: tab.keyboard.press("Control+Shift+Z"))
    after(tab, lambda: tab.keyboard.press("Control+y"))
    np.testing.assert_array_equal(levels(tab), changed)
    assert tab.is_disabled("#redo")
    after(tab, lambda: tab.click("#undo"))
    after(tab, lambda: tab.locator(".canvas").press("ArrowLeft"))
    assert tab.is_disabled("#redo")  # another way was taken
    tab.locator("#option-transfer").fill("bo")
    tab.keyboard.press("Control+z")  # of the text that is being written
    assert camera(tab)[0] == 16


def picked(tab: Any, x: float, y: float) -> str:
    tab.evaluate("document.querySelector('#picked').textContent = ''")
    tab.mouse.click(x, y)
    tab.wait_for_function("() => document.querySelector('#picked').textContent !== ''")
    return str(tab.inner_text("#picked")).partition(" · distance")[0]


def bright(tab: Any) -> tuple[float, float]:
    """A bright place of the picture away from its middle, px of the page."""
    shown, box = (
        levels(tab)[..., :3].astype(int).sum(axis=-1),
        tab.locator(".canvas").bounding_box(),
    )
    kept = cv2.erode((shown > 200).astype(np.uint8), np.ones((7, 7)))
    rows, columns = np.nonzero(kept)
    far = np.hypot(rows - shown.shape[0] / 2, columns - shown.shape[1] / 2).argmax()
    return box["x"] + columns[far] + 0.5, box["y"] + rows[far] + 0.5


def test_the_wheel_zooms_about_the_pointer(parallel: Any) -> None:
    tab = parallel
    after(tab, lambda: tab.click("#reset"))
    x, y = bright(tab)
    before = picked(tab, x, y)
    assert before.startswith("voxel")
    tab.mouse.move(x, y)
    after(tab, lambda: tab.mouse.wheel(0, -400))
    assert camera(tab)[2] == pytest.approx(np.exp(400 / 600), rel=1e-4)
    assert picked(tab, x, y) == before


def test_two_fingers_zoom_about_what_is_between_them(parallel: Any) -> None:
    tab = parallel
    after(tab, lambda: tab.click("#reset"))
    x, y = bright(tab)
    before = picked(tab, x, y)
    link = tab.context.new_cdp_session(tab)

    def touch(kind: str, apart: float) -> None:
        points = [{"x": x - apart, "y": y, "id": 0}, {"x": x + apart, "y": y, "id": 1}]
        if kind == "touchEnd":
            points = []
        link.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def pinch() -> None:
        touch("touchStart", 30)
        for apart in (35, 40, 50, 60):
            touch("touchMove", apart)
        touch("touchEnd", 60)

    after(tab, pinch)
    azimuth, elevation, zoom, *_ = camera(tab)
    assert (azimuth, elevation) == (30, 20)
    assert zoom == pytest.approx(2, rel=1e-3)
    assert picked(tab, x, y) == before


def test_the_wheel_goes_toward_what_is_under_the_pointer(browser: Any, tmp_path: Path) -> None:
    color = np.random.default_rng(5).integers(0, 256, (60, 80, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "color.png"), color)
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((60, 80), 2000, np.uint16))
    names = str(tmp_path / "color.png"), str(tmp_path / "depth.png")
    begin = SourceCamera(fov=60), Depth(depth_scale=1000)
    with (
        served(depth_view(*names, begin)) as address,
        tab_of(browser, address.address, (900, 500)) as tab,
    ):
        box = tab.locator(".canvas").bounding_box()
        x, y = box["x"] + 0.7 * box["width"], box["y"] + 0.3 * box["height"]
        before = place_in(picked(tab, x, y))
        tab.mouse.move(x, y)
        after(tab, lambda: tab.mouse.wheel(0, -300))
        now = place_in(picked(tab, x, y))
        assert float(tab.input_value("#option-move").split(",")[2]) > 0.1
        np.testing.assert_allclose(now, before, atol=0.004)  # a pixel is 0.005 wide there


def place_in(said: str) -> list[float]:
    place = said.partition("position ")[2].partition(" · ")[0]
    return [float(part) for part in place.split(",")]
