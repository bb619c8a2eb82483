"""The page in a browser: drags, keys, controls, picks and exports do what the library does."""

import shlex
import shutil
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from resample.cameras.keyframes import keyframes_of
from resample_texture.viewing import picture_view
from resample_volume.cli import app
from resample_volume.command.choices import AppearanceChoices
from resample_volume.viewing import volume_view
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.viewing import depth_view
from tests.commands import ended
from tests.view.conftest import Served, frames_of, served

sync_api = pytest.importorskip("playwright.sync_api", reason="pip install playwright")
BROWSER = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("chrome")
pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(BROWSER is None, reason="no Chromium: apt install chromium"),
]
BELOW = 19  # px under the histogram, for numbers
BEGIN = (AppearanceChoices(camera="30,20,1"),)  # where it is not looked for
TIME = 90_000  # ms; kernels may have to be compiled


@pytest.fixture(scope="module")
def place() -> Iterator[Served]:
    with served(volume_view("vessel-tree:size=24", begin=BEGIN)) as address:
        yield address


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with sync_api.sync_playwright() as play:
        opened = play.chromium.launch(executable_path=BROWSER, args=["--no-sandbox"])
        yield opened
        opened.close()


@pytest.fixture
def page(browser: Any, place: Served) -> Iterator[Any]:
    tab = browser.new_page(viewport={"width": 900, "height": 480})
    faults: list[str] = []
    tab.on("pageerror", lambda error: faults.append(str(error)))
    tab.on("console", lambda said: said.type == "error" and faults.append(said.text))
    tab.set_default_timeout(TIME)
    tab.goto(place.address)
    still(tab)
    yield tab
    assert faults == []
    tab.close()


def still(page: Any, after: str = "") -> str:
    """Number of the picture of the options shown, once it is another than one before."""
    page.wait_for_function(
        "before => { const image = document.querySelector('.canvas img');"
        " return image.complete && document.querySelector('#badge').classList.contains('final')"
        " && image.dataset.number !== before; }",
        arg=after,
    )
    return str(page.evaluate("document.querySelector('.canvas img').dataset.number"))


def seen(page: Any) -> NDArray[np.uint8]:
    return np.asarray(Image.open(BytesIO(page.locator(".canvas").screenshot())).convert("RGB"))


def camera(page: Any) -> list[float]:
    return [float(part) for part in page.input_value("#option-camera").split(",")]


def differs(page: Any, act: Any) -> bool:
    """Whether the picture changes by an act; one that was asked for before may come first."""
    number = still(page)
    before = seen(page)
    act()
    while True:
        try:
            number = still(page, number)
        except sync_api.TimeoutError:
            return False
        if (seen(page).astype(int) - before).std() > 1:
            return True


def test_dragging_turns_and_shift_drags_move(page: Any) -> None:
    box = page.locator(".canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def drag() -> None:
        page.mouse.move(x, y)
        page.mouse.down()
        page.mouse.move(x + 40, y + 20, steps=4)
        page.mouse.up()

    assert differs(page, drag)
    assert camera(page) == [10, 30, 1]
    page.keyboard.down("Shift")
    assert differs(page, drag)
    page.keyboard.up("Shift")
    side = min(box["width"], box["height"])
    np.testing.assert_allclose(camera(page), [10, 30, 1, 40 / side, -20 / side], rtol=1e-4)


def test_wheel_keys_and_presets_steer(page: Any) -> None:
    page.locator(".canvas").focus()
    assert differs(page, lambda: page.keyboard.press("ArrowLeft"))
    assert camera(page) == [36, 20, 1]
    assert differs(page, lambda: page.keyboard.press("+"))
    assert camera(page)[2] == pytest.approx(1.15)
    page.locator(".canvas").hover()
    assert differs(page, lambda: page.mouse.wheel(0, 300))
    assert differs(page, lambda: page.select_option("#views", "top"))
    assert camera(page)[:2] == [0, 90]
    assert differs(page, lambda: page.click("#reset"))
    assert page.input_value("#option-camera") == "30,20,1"


def test_controls_change_the_picture(page: Any) -> None:
    def choose(name: str, value: str) -> None:
        page.select_option(f"#option-{name}", value)

    def unfold(heading: str) -> None:
        page.locator("summary", has_text=heading).click()

    assert differs(page, lambda: choose("classify", "post"))
    unfold("Method")
    assert differs(page, lambda: choose("projection", "maximum"))
    unfold("Annotations and objects")
    assert differs(page, lambda: page.check("#option-box"))
    page.fill("#option-transfer", "hot")
    assert differs(page, lambda: page.keyboard.press("Tab"))
    page.click("#export")
    text = page.inner_text("#export-command")
    for word in ("--classify=post", "--projection=maximum", "--box", "--transfer=hot"):
        assert word in text
    page.click("#close")


def test_the_window_is_dragged_over_the_histogram(page: Any) -> None:
    histogram = page.locator("#histogram")

    def drag() -> None:
        histogram.scroll_into_view_if_needed()
        box = histogram.bounding_box()
        page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 20)
        page.mouse.down()
        page.mouse.move(box["x"] + 0.9 * box["width"], box["y"] + 20, steps=4)
        page.mouse.up()

    number = still(page)
    page.fill("#option-transfer", "gray")
    page.keyboard.press("Tab")
    still(page, number)
    page.wait_for_timeout(500)  # for the points of the new look, which have gone from there
    assert differs(page, drag)
    center, width = map(float, page.input_value("#option-window").split(","))
    assert center > width > 0


def curve(page: Any) -> list[list[str]]:
    return [one.split(",") for one in page.input_value("#option-transfer").split(" ")]


def test_points_of_the_look_are_dragged_typed_added_and_taken_away(page: Any) -> None:
    high = volume_view("vessel-tree:size=24").about["histogram"]["high"]
    before = still(page)
    page.select_option("#looks", "gray")
    still(page, before)
    page.wait_for_selector("#histogram[aria-busy=false]")  # the curve comes after the picture
    box = page.locator("#histogram").bounding_box()

    def drag() -> None:  # the last point, which is opaque
        page.mouse.move(box["x"] + box["width"] - 2, box["y"] + 3)
        page.mouse.down()
        page.mouse.move(
            box["x"] + 0.6 * box["width"], box["y"] + 0.5 * (box["height"] - BELOW), steps=4
        )
        page.mouse.up()

    assert differs(page, drag)
    points = curve(page)
    assert [one[1] for one in points] == ["#000000", "#ffffff"]
    assert float(points[1][0]) == pytest.approx(0.6 * high, abs=2)
    assert float(points[1][2]) == pytest.approx(0.25, abs=0.02)  # drawn by its square root
    page.fill("#point-opacity", "0.9")
    assert differs(page, lambda: page.keyboard.press("Tab"))
    assert curve(page)[1][2] == "0.9"
    before = still(page)
    page.locator("#histogram").focus()
    page.keyboard.press("[")
    page.keyboard.press("Enter")
    still(page, before)
    assert len(curve(page)) == 3
    page.locator("#point-color").fill("#ff2010")
    page.wait_for_function(
        "() => document.querySelector('#option-transfer').value.includes('#ff2010')"
    )
    page.locator("#histogram").focus()
    assert differs(page, lambda: page.keyboard.press("ArrowUp"))
    assert float(curve(page)[1][2]) == pytest.approx(0.45 + 0.02)
    page.keyboard.press("Delete")
    assert len(curve(page)) == 2
    before = still(page)
    page.mouse.move(box["x"] + 10, box["y"] + 10)  # beside the points: all of them
    page.mouse.down()
    page.mouse.move(box["x"] + 40, box["y"] + 10, steps=3)
    page.mouse.up()
    still(page, before)
    shift = 30 / box["width"] * high
    assert float(curve(page)[0][0]) == pytest.approx(shift, abs=2)


def test_a_picture_is_kept_beside_the_next_ones(page: Any) -> None:
    def caption(name: str) -> str:
        return str(page.inner_text(f"#{name} .caption"))

    number = still(page)
    page.click("#compare")
    number = still(page, number)
    assert caption("other") == "kept"
    assert caption("difference").endswith("equal")
    page.fill("#option-transfer", "hot")
    page.keyboard.press("Tab")
    number = still(page, number)
    assert caption("other").startswith("kept: transfer default")
    decibels = float(caption("difference").split()[-2])
    assert 5 < decibels < 40
    page.locator(".canvas").focus()
    page.keyboard.press("ArrowLeft")  # turns both
    still(page, number)
    assert float(caption("difference").split()[-2]) != decibels
    page.click("#compare")
    assert page.locator("#other").count() == 0


def test_a_click_picks_and_mistakes_are_said(page: Any) -> None:
    box = page.locator(".canvas").bounding_box()
    page.mouse.click(box["x"] + 5, box["y"] + 5)
    page.wait_for_function("() => document.querySelector('#picked').textContent !== ''")
    assert page.inner_text("#picked") == "nothing here"
    page.fill("#option-camera", "nowhere")
    page.keyboard.press("Tab")
    page.wait_for_function("() => document.querySelector('.message').textContent !== ''")
    assert "a page only changes the look" in page.inner_text(".message")
    number = page.evaluate("document.querySelector('.canvas img').dataset.number")
    page.click("#reset")
    still(page, number)
    assert page.inner_text(".message") == ""


def test_a_narrow_window_has_all_of_it(page: Any) -> None:
    page.set_viewport_size({"width": 400, "height": 800})
    assert page.locator(".canvas").bounding_box()["width"] == 400
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    assert page.locator("#option-transfer").bounding_box()["width"] > 150


def test_corners_of_a_picture_are_dragged(browser: Any, tmp_path: Path) -> None:
    levels = np.full((60, 90, 3), (40, 160, 220), np.uint8)
    levels[20:40, 30:60] = 255
    cv2.imwrite(str(tmp_path / "sign.png"), levels)
    with served(picture_view(tmp_path / "sign.png")) as place:
        page = browser.new_page(viewport={"width": 900, "height": 480})
        page.set_default_timeout(TIME)
        page.goto(place.address)
        still(page)
        before = page.input_value("#option-corners").split()
        handle = page.locator("#corner-1").bounding_box()
        x, y = handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2

        def drag() -> None:
            page.mouse.move(x, y)
            page.mouse.down()
            page.mouse.move(x - 30, y + 20, steps=4)
            page.mouse.up()

        assert differs(page, drag)
        after = page.input_value("#option-corners").split()
        assert [n for n in range(4) if before[n] != after[n]] == [1]
        moved = np.array([list(map(float, one[1].split(","))) for one in (before, after)])
        np.testing.assert_allclose(moved[1] - moved[0], [-30, 20], atol=0.1)
        page.locator("#corner-3").focus()
        assert differs(page, lambda: page.keyboard.press("ArrowUp"))
        page.click("#export")
        assert f"--corners={page.input_value('#option-corners')}" in page.inner_text(
            "#export-command"
        ).replace("'", "")
        page.close()


def test_a_camera_walks_past_a_picture_with_depth(browser: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    color = cv2.GaussianBlur(rng.integers(0, 256, (60, 80, 3), np.uint8), (9, 9), 0)
    depth = np.full((60, 80), 3000, np.uint16)
    depth[15:40, 25:50] = 1500
    cv2.imwrite(str(tmp_path / "color.png"), color)
    cv2.imwrite(str(tmp_path / "depth.png"), depth)
    begin = SourceCamera(fov=60), Depth(depth_scale=1000)
    names = str(tmp_path / "color.png"), str(tmp_path / "depth.png")
    with served(depth_view(*names, begin)) as address:
        tab = browser.new_page(viewport={"width": 900, "height": 480})
        tab.set_default_timeout(TIME)
        tab.goto(address.address)
        still(tab)
        box = tab.locator(".canvas").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

        def drag() -> None:
            tab.mouse.move(x, y)
            tab.mouse.down()
            tab.mouse.move(x + 60, y, steps=4)
            tab.mouse.up()

        def move() -> list[float]:
            return [float(part) for part in tab.input_value("#option-move").split(",")]

        assert differs(tab, drag)
        assert move()[0] < 0 == move()[1]
        assert float(tab.input_value("#option-turn").split(",")[0]) > 0
        tab.locator(".canvas").focus()
        assert differs(tab, lambda: tab.keyboard.press("+"))
        assert move()[2] > 0
        assert differs(tab, lambda: tab.keyboard.press("Shift+ArrowLeft"))
        tab.locator("summary", has_text="Method").click()
        assert differs(tab, lambda: tab.check("#option-fill"))
        tab.mouse.click(x, y)
        tab.wait_for_function(
            "() => document.querySelector('#picked').textContent.includes('depth')"
        )
        assert differs(tab, lambda: tab.select_option("#option-show", "depth"))
        tab.locator(".canvas").focus()
        assert differs(tab, lambda: tab.keyboard.press("Home"))
        assert move() == [0, 0, 0]
        tab.close()


def test_the_magnifier_tells_levels(page: Any) -> None:
    box, before = page.locator(".canvas").bounding_box(), seen(page)
    assert not page.is_visible("#glass")
    height = page.locator(".bar").bounding_box()["height"]
    page.click("#magnify")
    x, y = before.shape[1] // 2, before.shape[0] // 2 + 3
    page.mouse.move(box["x"] + x + 0.5, box["y"] + y + 0.5)
    assert page.is_visible("#glass")
    levels = " ".join(map(str, before[y, x].tolist()))
    assert page.inner_text("#picked") == f"pixel {x}, {y} · levels {levels}"
    assert page.locator(".bar").bounding_box()["height"] == height  # or the picture is made anew
    page.click("#magnify")
    assert not page.is_visible("#glass")


def test_keyframes_become_a_film(
    page: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for camera in ("350/20/1", "10/30/2/0.1/0"):
        number = still(page)
        page.fill("#option-camera", camera)
        page.keyboard.press("Tab")
        still(page, number)
        page.click("#keyframe")
    page.click("#export")
    Path("keyframes.toml").write_text(page.inner_text("#export-keyframes"), "utf-8")
    between = keyframes_of(Path("keyframes.toml"), 30).between(3)
    assert [round(each.azimuth) for each in between] == [350, 360, 370]  # the short way
    assert between[2].pan == (0.1, 0)
    words = shlex.split(page.inner_text("#export-film"))
    assert words[:2] == ["resample-volume", "animate"]
    words[words.index("-o") + 1 :] = ["film", "--frames", "2", "--size", "16"]
    assert ended(app, *(word for word in words[1:] if not word.startswith("--size="))) == 0
    assert len(list(Path("film").glob("*.png"))) == 2
    with page.expect_download() as waited:
        page.click("#film-make")
    waited.value.save_as("page.mp4")
    words[words.index("-o") + 1 :] = ["command.mp4"]
    assert ended(app, *words[1:]) == 0
    page_frames, frames = (frames_of(Path(name)) for name in ("page.mp4", "command.mp4"))
    assert len(frames) == 49
    np.testing.assert_array_equal(page_frames, frames)
    page.click("#export")
    page.click("#keyframes-forget")
    assert page.inner_text("#keyframe") == "Keyframe"


def test_keyframes_of_a_depth_image_are_poses(browser: Any, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "color.png"), np.full((30, 40, 3), 90, np.uint8))
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((30, 40), 2000, np.uint16))
    begin = SourceCamera(fov=60), Depth(depth_scale=1000)
    names = str(tmp_path / "color.png"), str(tmp_path / "depth.png")
    with served(depth_view(*names, begin)) as address:
        tab = browser.new_page()
        tab.set_default_timeout(TIME)
        tab.goto(address.address)
        still(tab)
        tab.click("#keyframe")
        tab.fill("#option-move", "0.25,0,0")
        tab.keyboard.press("Tab")
        tab.click("#keyframe")
        assert tab.inner_text("#keyframe") == "Keyframe (2)"
        tab.click("#export")
        poses = np.array(tab.inner_text("#export-keyframes").split(), float).reshape(2, 4, 4)
        assert "--path=poses.txt --frames=49" in tab.inner_text("#export-film")
        tab.close()
    np.testing.assert_array_equal(poses[0], np.eye(4))
    np.testing.assert_array_equal(poses[1, :3, 3], (-0.25, 0, 0))


def test_a_lens_is_set_by_sliders(browser: Any, tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), cv2.GaussianBlur(rng.integers(0, 256, (60, 80, 3), np.uint8), (9, 9), 0))
    with served(picture_view(path)) as address:
        tab = browser.new_page()
        tab.set_default_timeout(TIME)
        tab.goto(address.address)
        still(tab)
        assert differs(tab, lambda: tab.fill("#lens-k1", "-0.3"))
        assert tab.input_value("#option-lens") == "80,80,40,30,-0.3,0,0,0,0"
        assert tab.input_value("#option-corners") == ""
        tab.locator("#lens-k2").focus()
        assert differs(tab, lambda: tab.keyboard.press("End"))
        assert tab.input_value("#option-lens") == "80,80,40,30,-0.3,0.5,0,0,0"
        tab.fill("#option-lens", "80,80,40,30,0.2,0,0,0")
        assert differs(tab, lambda: tab.keyboard.press("Tab"))
        assert tab.input_value("#lens-k1") == "0.2"
        tab.close()


def test_a_lens_beside_a_field_of_view_is_set_by_sliders(browser: Any, tmp_path: Path) -> None:
    color = np.random.default_rng(6).integers(0, 256, (30, 40, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "color.png"), color)
    cv2.imwrite(str(tmp_path / "depth.png"), np.full((30, 40), 2000, np.uint16))
    begin = SourceCamera(fov=60), Depth(depth_scale=1000)
    names = str(tmp_path / "color.png"), str(tmp_path / "depth.png")
    with served(depth_view(*names, begin)) as address:
        tab = browser.new_page()
        tab.set_default_timeout(TIME)
        tab.goto(address.address)
        still(tab)
        tab.locator("summary", has_text="Source camera").click()
        assert differs(tab, lambda: tab.fill("#lens-k1", "0.2"))
        assert tab.input_value("#option-lens") == "k=0.2,0,0,0,0"
        tab.close()
