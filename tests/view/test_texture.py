"""Pictures in pages: what is seen is what the exported command writes, bit for bit."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from resample_meshes.viewing import model_view
from resample_texture.cli import app
from resample_texture.viewing import picture_view, suits
from resample_texture.viewing.pictures import fitted
from tests.commands import ended, refused
from tests.view.conftest import Served, levels, served

CORNERS = "4,3 44,6 40,36 7,33"
WISHES: dict[str, dict[str, Any]] = {
    "dragged": {},
    "another method": {"method": "bilinear", "edge": "clamp"},
    "filtered": {"filter": "gaussian", "interpolation": "spline", "linear": False},
    "four to four": {"corners": "2,2 20,3 19,15 1,14 -> 0,0 48,0 48,40 0,40", "edge": "mirror"},
    "by a matrix": {"matrix": "2,0,1,0,2,-3", "background": "white"},
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    path = tmp_path_factory.mktemp("view") / "a photo.png"
    levels = np.random.default_rng(3).integers(0, 256, (18, 24, 3), np.uint8)
    cv2.imwrite(str(path), cv2.GaussianBlur(levels, (5, 5), 0))
    with served(picture_view(path)) as address:
        yield address


@pytest.mark.parametrize("extent", [(24, 18), (300, 181), (95, 400), (1, 1)])
@pytest.mark.parametrize("size", [(48, 40), (101, 64), (31, 120)])
def test_a_picture_begins_in_the_middle_and_as_large_as_fits(
    extent: tuple[int, int], size: tuple[int, int]
) -> None:
    """At whole px, and not enlarged."""
    corners = np.array([corner.split(",") for corner in fitted(extent, size).split()], float)
    scale = min(1.0, size[0] / extent[0], size[1] / extent[1])
    left, top = corners[0]
    assert (left % 1, top % 1) == (0, 0)
    square = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    wanted = np.array([left, top]) + square * scale * np.array(extent)
    np.testing.assert_allclose(corners, wanted, rtol=1e-5)
    assert (np.abs(corners.mean(axis=0) - np.array(size) / 2) <= 0.501).all()


@pytest.mark.sweep
@pytest.mark.parametrize("wish", WISHES)
def test_the_exported_command_makes_the_page_s_picture(
    wish: str, place: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    settings = {"corners": CORNERS} | WISHES[wish]
    if "matrix" in settings:
        del settings["corners"]
    with place.page() as page:
        head, data = page.drawn(settings)
        assert not head["preview"]
        page.say("export", settings)
        texts = page.told("exported")["texts"]
        page.say("save", settings, suffix=".png")
        saved = page.answer()[1]
        preview = levels(page.drawn(settings, moving=True)[1])
    words = shlex.split(texts["command"])
    assert words[0] == "resample-texture"
    assert ended(app, *words[1:]) == 0
    written = levels(Path("picture.png").read_bytes())
    np.testing.assert_array_equal(levels(data), written)
    np.testing.assert_array_equal(levels(saved), written)
    assert preview.shape[:2] == written.shape[:2] == (40, 48)
    if wish == "dragged":
        exec(texts["python"], {})
        np.testing.assert_array_equal(levels(Path("picture.png").read_bytes()), written)


def test_pages_know_the_picture_and_pick_its_texels(place: Served) -> None:
    with place.page() as page:
        about = page.about
        assert about["gestures"] == "corners"
        assert about["extent"] == [24, 18]
        keys = {control["key"] for control in about["controls"]}
        assert {"corners", "method", "filter", "edge"} <= keys
        assert not {"output", "size", "coverage", "settings"} & keys
        settings = {"corners": "0,0 48,0 48,36 0,36"}  # twice as large
        page.say("pick", settings, x=21.5, y=9.5)
        found = page.told("picked")["found"]
        assert (found["column"], found["row"]) == (10, 4)
        assert len(found["value"].split(",")) == 3
        assert found["position"] == "10.75, 4.75"
        assert (about["measures"], about["unit"]) == (True, "px")
        page.say("pick", settings, x=21.5, y=39)
        assert page.told("picked")["found"] == {}


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"corners": "1,2 3,4"}, "is not four points"),
        ({"corners": CORNERS, "matrix": "1,0,0,0,1,0"}, "give one of"),
        ({"corners": CORNERS, "method": "magic"}, "magic"),
        ({"corners": CORNERS, "edge": "sharp"}, "transparent"),
    ],
)
def test_mistakes_are_said_in_a_line(wrong: dict[str, Any], said: str, place: Served) -> None:
    with place.page() as page:
        for moving in (False, True):
            page.say("draw", wrong, moving=moving)
            told = page.told("error")["text"]
            assert said in told
            assert "\n" not in told
        assert page.drawn({"corners": CORNERS})[0]["kind"] == "frame"


def test_pictures_are_known_by_their_files(tmp_path: Path) -> None:
    levels = np.zeros((4, 5, 3), np.uint8)
    for name in ("one.png", "one.jpg", "one.tif"):
        cv2.imwrite(str(tmp_path / name), levels)
        assert suits([str(tmp_path / name)])
    cv2.imwritemulti(str(tmp_path / "stack.tif"), [levels, levels])
    (tmp_path / "volume.nrrd").write_bytes(b"NRRD0004")
    for name in ("stack.tif", "volume.nrrd", "none.png", "."):
        assert not suits([str(tmp_path / name)])


MESHES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "turned": {"camera": "70/40/1.3", "shading": True, "background": "white"},
    "otherwise": {"interpolation": "nearest", "filter": "gaussian:sigma=0.5", "up": "z"},
}


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A square with a texture."""
    folder = tmp_path_factory.mktemp("mesh")
    levels = np.random.default_rng(4).integers(0, 256, (16, 16, 3), np.uint8)
    cv2.imwrite(str(folder / "a.png"), levels)
    (folder / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    faces = "usemtl a\nf 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
    (folder / "a.obj").write_text(f"mtllib a.mtl\n{corners}{faces}")
    return folder / "a.obj"


@pytest.fixture(scope="module")
def turning(model: Path) -> Iterator[Served]:
    with served(model_view(model)) as address:
        yield address


@pytest.mark.parametrize("wish", MESHES)
def test_the_exported_command_shows_the_page_s_mesh(
    wish: str, turning: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with turning.page() as page:
        settings = page.about["settings"] | MESHES[wish]
        head, data = page.drawn(settings)
        page.say("export", settings)
        texts = page.told("exported")["texts"]
        page.say("save", settings, suffix=".png")
        saved = page.answer()[1]
        preview, small = page.drawn(settings, moving=True)
        page.say("pick", settings, x=24, y=20)
        found = page.told("picked")["found"]
        x, y, z = map(float, found["position"].split(","))
        assert abs(z) < 2e-4  # on the square; depth is a mean over the pixel
        assert 0 < min(x, y) < max(x, y) < 1
    assert preview["preview"] > head["preview"]
    assert levels(small).shape[:2] == (20, 24)
    words = shlex.split(texts["command"])
    assert words[:2] == ["resample-texture", "mesh"]
    assert ended(app, *words[1:]) == 0
    written = levels(Path("picture.png").read_bytes())
    np.testing.assert_array_equal(levels(data), written)
    np.testing.assert_array_equal(levels(saved), written)
    if wish == "turned":
        exec(texts["python"], {})
        np.testing.assert_array_equal(levels(Path("picture.png").read_bytes()), written)


def test_views_of_meshes_take_no_options_of_pictures(
    model: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    assert suits([str(model)])
    said = refused(app, capsys, "view", model, "--method", "bilinear", "--no-browser")
    assert "method: of pictures; leave that out with a mesh" in said
