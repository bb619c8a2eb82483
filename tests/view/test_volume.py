"""Volumes in pages: what is seen is what the exported command writes, bit for bit."""

import shlex
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import resample_volume
from resample.view.views import controls_of
from resample_volume.command.choices import Look
from resample_volume.command.cli import app
from resample_volume.viewing import VolumeView, picture
from tests.commands import ended
from tests.view.conftest import Served, served

BOX = "checker-box:size=20,block=5"
CONTROLS = controls_of("resample-volume render", app["render"])
WISHES: dict[str, dict[str, Any]] = {
    "as it begins": {},
    "along rays": {"classify": "post", "camera": "50/-10/1.3", "transfer": "gray"},
    "maximum": {"projection": "maximum", "camera": "top", "background": "white"},
    "surface": {"projection": "first-hit", "iso": 100.0, "fov": 0.0, "specular": 0.6},
    "panned and cut": {"camera": "10/20/1.5/0.2/-0.1", "clip": ["1/0/0"], "shading": False},
    "sheets": {"order": "axis-sheets", "method": "splats", "transfer": "bone", "window": "128/150"},
    "drawn into": {"box": True, "axes": True, "cube": True, "scale-bar": True, "fit": "visible"},
}


@pytest.fixture(scope="module")
def place() -> Iterator[Served]:
    with served(VolumeView(BOX, begin=(Look(transfer="checker"),), controls=CONTROLS)) as address:
        yield address


def levels(data: bytes) -> NDArray[np.uint8]:
    return np.asarray(Image.open(BytesIO(data)))


@pytest.mark.parametrize("wish", WISHES)
def test_the_exported_command_makes_the_page_s_picture(
    wish: str, place: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with place.page() as page:
        settings = page.about["settings"] | WISHES[wish]
        head, data = page.drawn(settings)
        assert not head["preview"]
        page.say("export", settings)
        texts = page.told("exported")["texts"]
        page.say("save", settings, suffix=".png")
        saved = page.answer()[1]
    words = shlex.split(texts["command"])
    assert words[0] == "resample-volume"
    assert ended(app, *words[1:]) == 0
    written = Path("picture.png").read_bytes()
    np.testing.assert_array_equal(levels(data), levels(written))
    np.testing.assert_array_equal(levels(saved), levels(written))
    Path("view.toml").write_text(texts["settings"])
    again = ["render", BOX, "--settings", "view.toml", "-o", "again.png"]
    assert ended(app, *again) == 0
    np.testing.assert_array_equal(levels(Path("again.png").read_bytes()), levels(written))
    known = tomllib.loads(texts["settings"])
    assert known.pop("command") == "resample-volume render"
    frame = picture(BOX, known)
    behind = (1.0, 1.0, 1.0) if known.get("background") == "white" else (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(frame.to_uint8(background=behind), levels(written))


def test_exported_python_runs(place: Served, tmp_path: Path) -> None:
    with place.page() as page:
        page.say("export", {"camera": "top", "fit": "volume"})
        text = page.told("exported")["texts"]["python"]
    subprocess.run([sys.executable, "-c", text], cwd=tmp_path, check=True)
    assert levels((tmp_path / "picture.png").read_bytes()).shape == (40, 48, 4)


def test_pages_know_the_volume_its_options_and_its_values(place: Served) -> None:
    with place.page() as page:
        about = page.about
        controls = {control["key"]: control for control in about["controls"]}
        assert controls["projection"]["default"] == "composite"
        assert "maximum" in controls["projection"]["schema"]["enum"]
        assert controls["camera"]["heading"] == "Camera"
        assert not {"output", "settings", "size", "reader", "deep"} & controls.keys()
        assert about["settings"] == {
            "fit": "volume", "camera": "30/20/1", "transfer": "checker",
        }  # fmt: skip
        assert sum(about["histogram"]["counts"]) == 20**3
        head, data = page.drawn(about["settings"], moving=True, number=4)
        assert head["preview"]
        assert levels(data).shape[:2] == (40, 48)


def test_what_is_picked_is_told_and_errors_are_lines(place: Served) -> None:
    with place.page() as page:
        settings = page.about["settings"]
        page.say("pick", settings, x=24, y=20)
        found = page.told("picked")["found"]
        x, y, z = map(int, found["voxel"].split(", "))
        volume = resample_volume.as_volume(BOX)
        assert float(found["value"]) == volume.values[z, y, x]
        page.say("pick", settings, x=1, y=1)
        assert page.told("picked")["found"] == {}
        for wrong, said in (
            ({"transfer": "none.toml"}, "No such file"),
            ({"camera": "1/2/3/4"}, "give azimuth/elevation/zoom"),
            ({"projection": "sideways"}, "composite"),
            ({"speed": 3}, "no option 'speed'"),
            ({"projection": "first-hit"}, "iso"),
        ):
            page.say("draw", settings | wrong, moving=False)
            assert said in page.told("error")["text"]
        assert page.drawn(settings)[0]["kind"] == "frame"
