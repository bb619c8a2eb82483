"""Depth images in pages: what is seen is what the exported command writes."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from resample.progress import Cancel
from resample_warp3d.cli import app
from resample_warp3d.command.choices import Depth
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.viewing import depth_view, depths, suits
from resample_warp3d.viewing.depths import DepthPainter
from tests.commands import ended, refused
from tests.view.conftest import Served, check_export, frames_of, served

WISHES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "moved": {"move": "0.3,0,0.1"},
    "turned, wider": {"turn": "5,2,1", "target-fov": 80},
    "filled": {"move": "-0.4,0,0", "fill": True, "background": "white"},
    "holes": {"move": "0.4,0,0", "show": "holes"},
    "depth": {"show": "depth", "method": "mcmillan"},
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str, str]:
    """A picture, its depth (a square before a wall), and a cloud."""
    folder = tmp_path_factory.mktemp("view")
    rng = np.random.default_rng(3)
    color = cv2.GaussianBlur(rng.integers(0, 256, (30, 36, 3), np.uint8), (5, 5), 0)
    depth = np.full((30, 36), 3000, np.uint16)
    depth[8:20, 10:24] = 1500
    cv2.imwrite(str(folder / "a color.png"), color)
    cv2.imwrite(str(folder / "depth.png"), depth)
    points = rng.random((500, 3)) * [2, 1, 0.1]
    np.savetxt(folder / "cloud.xyz", points)
    return tuple(str(folder / name) for name in ("a color.png", "depth.png", "cloud.xyz"))


@pytest.fixture(scope="module")
def place(files: tuple[str, str, str]) -> Iterator[Served]:
    begin = SourceCamera(fov=60), Depth(depth_scale=1000)
    with served(depth_view(*files[:2], begin)) as address:
        yield address


@pytest.mark.sweep
@pytest.mark.parametrize("wish", WISHES)
def test_the_exported_command_makes_the_page_s_picture(
    wish: str, place: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    check_export(place, app, WISHES[wish], in_python=wish == "moved")


def test_pages_know_depth_images_and_what_pixels_show(place: Served) -> None:
    with place.page() as page:
        about = page.about
        assert (about["gestures"], about["extent"]) == ("walk", [36, 30])
        np.testing.assert_allclose(about["distance"], [1.5, 3], rtol=0.01)
        keys = {control["key"] for control in about["controls"]}
        assert {"move", "turn", "show", "method", "fov", "depth-scale"} <= keys
        assert not {"output", "size", "holes", "settings", "view"} & keys
        page.say("pick", about["settings"], x=24, y=18.5)
        assert float(page.told("picked")["found"]["depth"]) == pytest.approx(1.5, rel=0.01)
        page.say("pick", about["settings"] | {"move": "3,0,0"}, x=46, y=20)
        assert page.told("picked")["found"] == {"hole": "outside of the source"}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"move": "1,2"}, "move"),
        ({"method": "magic"}, "magic"),
        ({"show": "holes", "unmixed": True}, "leave out"),
        ({"depth-kind": "disparity"}, "--baseline"),
        ({"magic": 1}, "no option"),
    ],
)
def test_mistakes_are_said_in_a_line(wrong: dict[str, Any], said: str, place: Served) -> None:
    with place.page() as page:
        page.say("draw", page.about["settings"] | wrong, moving=False)
        told = page.told("error")["text"]
        assert said in told
        assert "\n" not in told
        assert page.drawn(page.about["settings"])[0]["kind"] == "frame"


def test_options_of_clouds_are_refused(
    files: tuple[str, str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    color, depth, cloud = files
    assert "needs DEPTH" in refused(app, capsys, "view", cloud, "--fov", 60)
    assert "Unknown option" in refused(app, capsys, "view", color, depth, "--camera", "top")
    assert "give --intrinsics" in refused(app, capsys, "view", color, depth)


def test_what_is_shown_is_known_by_its_files(files: tuple[str, str, str]) -> None:
    color, depth, cloud = files
    assert suits([color, depth])
    for names in ([color], [cloud], [color, "none.png"], [depth, cloud], [color, depth, depth]):
        assert not suits(names)


@pytest.mark.sweep
def test_films_and_names_have_no_other_parts(
    files: tuple[str, str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    color, depth, _ = files
    words = ["--fov", 60, "--depth-scale", 1000, "--move", "0.1,0,0", "--show", "depth"]
    said = refused(app, capsys, "render", color, depth, *words, "--unmixed", "-o", "a.png")
    assert "--show depth is in false colors" in said
    assert ended(app, "render", color, depth, *words, "-o", "a.jpg") == 0  # nothing transparent


KEYFRAMES = ["0,0,0;0,0,0", "0.3,0,0.1;4,1,0"]


def test_a_film_through_cameras_of_the_page_is_that_of_the_command(
    place: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(depths, "EACH", 3)
    monkeypatch.setitem(depths.FILM, "each", 3)
    with place.page() as page:
        settings = page.about["settings"] | {"target-fov": 70, "background": "white"}
        page.say("export", settings, keyframes=KEYFRAMES)
        texts = page.told("exported")["texts"]
        page.say("film", settings, keyframes=KEYFRAMES)
        Path("page.mp4").write_bytes(page.answer()[1])
        page.say("film", settings | {"show": "depth"}, keyframes=KEYFRAMES)
        assert page.told("error")["text"] == "films have no show; leave that out"
    Path("poses.txt").write_text(texts["keyframes"], "utf-8")
    words = shlex.split(texts["film"])
    assert words[:2] == ["resample-warp3d", "animate"]
    assert ended(app, *words[1:]) == 0
    made, wanted = (frames_of(Path(name)) for name in ("page.mp4", "film.mp4"))
    assert len(made) == 4
    np.testing.assert_array_equal(made, wanted)


def test_films_are_made_of_one_view(files: tuple[str, str, str]) -> None:
    further = [f"{files[0]},{files[1]},move.txt"]
    painter = depth_view(*files[:2], further=further).painter()
    with pytest.raises(ValueError, match="films are made from one view"):
        painter.film({}, (36, 30), "", Path("film.mp4"), print)


@pytest.mark.parametrize("move", ["0,0,0", "0.2,-0.1,0.5"])
def test_places_of_pixels_are_those_of_the_scene(place: Served, move: str) -> None:
    size, point = (36, 30), np.array([1.2, 0.9, 3.0])  # on the wall; a pixel is 0.1 wide there
    with place.page() as page:
        settings = page.about["settings"] | {"move": move}
        across, down, ahead = point - np.array(move.split(","), float)
        focal = 15 / np.tan(np.radians(30))  # 60 degrees along the shorter side
        at = {"x": 18 + focal * across / ahead, "y": 15 + focal * down / ahead}
        page.say("pick", settings, width=size[0], height=size[1], **at)
        found = page.told("picked")["found"]["position"]
    np.testing.assert_allclose([float(part) for part in found.split(",")], point, atol=0.06)


@pytest.mark.parametrize("size", [(36, 30), (72, 60)])
def test_what_is_picked_after_a_change_of_size_is_picked_from_the_new_size(files, size):
    settings = {"fov": 60, "depth-scale": 1000, "move": "0.1,0,0"}
    used, fresh = (DepthPainter(*files[:2]) for _ in range(2))
    used.paint(settings, (36, 30), quick=False, cancel=Cancel())
    x, y = size[0] * 0.45, size[1] * 0.45
    found = used.pick(settings, size, x, y)
    assert found == fresh.pick(settings, size, x, y)
    assert float(found["depth"]) == pytest.approx(1.5, rel=0.01)
