"""Volumes in pages: what is seen is what the exported command writes, bit for bit."""

import gc
import shlex
import subprocess
import sys
import time
import tomllib
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

import resample_volume
from resample.cli import app as resample_app
from resample.console import linear_color
from resample.files.saving import screen_levels
from resample.progress import Cancel
from resample_volume.appearance import transfer_of
from resample_volume.classification.presets import load_transfer
from resample_volume.classification.transfer import MOST, points_of, spelled, spread
from resample_volume.cli import app
from resample_volume.command.choices import Added, AppearanceChoices, ReadOptions
from resample_volume.command.inputs import prepared
from resample_volume.viewing import VolumePainter, picture, suits, volume_view, volumes
from tests.commands import ended
from tests.view.conftest import Served, levels, served

BOX = "checker-box:size=20,block=5"
WISHES: dict[str, dict[str, Any]] = {
    "as it begins": {},
    "along rays": {"classify": "post", "camera": "50/-10/1.3", "transfer": "gray"},
    "maximum": {"projection": "maximum", "camera": "top", "background": "white"},
    "surface": {"projection": "first-hit", "iso": 100.0, "fov": 0.0, "specular": 0.6},
    "panned and cut": {"camera": "10/20/1.5/0.2/-0.1", "clip": ["1/0/0"], "shading": False},
    "sheets": {"order": "axis-sheets", "method": "splats", "transfer": "bone", "window": "128/150"},
    "points": {"transfer": "40/tomato/0,64/#4466aa/0.1,200/white/0.9", "background": "#204060"},
    "drawn into": {"box": True, "axes": True, "cube": True, "scale-bar": True, "fit": "visible"},
    "planes": {"plane": ["z=50%:window=64/128", "1/1/0:colors=magma,opacity=0.5"]},
}


@pytest.fixture(scope="module")
def place() -> Iterator[Served]:
    with served(volume_view(BOX, begin=(AppearanceChoices(transfer="checker"),))) as address:
        yield address


# Of bytes, for whose looks all of a painter is compiled anew.
MORE = pytest.mark.sweep


@pytest.mark.some(1)
@pytest.mark.parametrize(
    "wish",
    [pytest.param(wish, marks=MORE) if wish in ("maximum", "surface") else wish for wish in WISHES],
)
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
    behind = linear_color(known.get("background", "black"))
    assert behind is not None
    np.testing.assert_array_equal(frame.to_uint8(background=behind), levels(written))


def test_vtk_is_a_rival_where_it_is_installed(
    place: Served, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("vtkmodules", reason="pip install 'hybrid-resample[peers]'")
    from resample_comparisons.volume.peers import Peer, VtkRenderer

    volume = VolumePainter(prepared(ReadOptions(), BOX)).volume
    with place.page() as page:
        settings = page.about["settings"] | {"shading": False, "background": "black"}
        for camera in ("30/20/1", "top"):
            page.say("draw", settings | {"camera": camera}, moving=False, rival="VTK")
            (other, data), (gap, _), (frame, _) = (page.answer() for _ in range(3))
            assert [one["kind"] for one in (other, gap, frame)] == ["other", "difference", "frame"]
            painter = VolumePainter(volume)
            look = painter.parsed(settings | {"camera": camera})
            eye, there = painter._placed_view(look, (48, 40))
            looks = transfer_of(volume, look.layers[0][1])
            by_vtk = VtkRenderer(there, looks, height=40, width=48, look=Peer(light=None))
            light = by_vtk.render(eye)
            expected = screen_levels(light, background=(0, 0, 0))
            np.testing.assert_array_equal(levels(data), expected)
        page.say("draw", settings | {"crop": ":9,:,:"}, moving=False, rival="VTK")
        assert "VTK does not get crop" in page.told("other")["text"]
        assert page.answer()[0]["kind"] == "frame"
        page.say("draw", settings, moving=False, rival="another")
        assert "can compare with VTK" in page.told("other")["text"]
        assert page.answer()[0]["kind"] == "frame"
    monkeypatch.setattr(volumes, "find_spec", lambda _: None)
    assert "pip install" in volume_view(BOX).about["rivals"]["VTK"]


@pytest.mark.sweep
def test_exported_python_runs(place: Served, tmp_path: Path) -> None:
    with place.page() as page:
        page.say("export", {"camera": "top", "fit": "volume"})
        text = page.told("exported")["texts"]["python"]
    subprocess.run([sys.executable, "-c", text], cwd=tmp_path, check=True)
    assert levels((tmp_path / "picture.png").read_bytes()).shape == (40, 48, 4)


def test_films_can_be_stopped_and_what_is_no_film_is_one_line(place: Served) -> None:
    with place.page() as page:
        settings = page.about["settings"]
        page.say("film", settings, keyframes=["0/0/1", "90/0/1"], width=400, height=400)
        page.say("film", settings, keyframes=[])
        page.say("export", settings)
        assert page.told("exported")["texts"]["command"]  # no file has come before it
        page.say("film", settings, keyframes=["0/0/1", "nowhere"])
        assert "nowhere" in page.told("error")["text"]


def test_pages_know_the_volume_its_options_and_its_values(place: Served) -> None:
    with place.page() as page:
        about = page.about
        controls = {control["key"]: control for control in about["controls"]}
        assert controls["projection"]["default"] == "composite"
        assert "maximum" in controls["projection"]["schema"]["enum"]
        assert controls["camera"]["heading"] == "Camera"
        assert not {"output", "settings", "size", "reader", "deep"} & controls.keys()
        assert about["settings"] == {
            "fit": "volume", "camera": "30,20,1", "transfer": "checker",
        }  # fmt: skip
        assert sum(about["histogram"]["counts"]) == 20**3
        head, data = page.drawn(about["settings"], moving=True, number=4)
        assert head["preview"]
        assert levels(data).shape[:2] == (40, 48)


def test_looks_become_points_and_these_make_the_same_picture(place: Served) -> None:
    with place.page() as page:
        settings = page.about["settings"]
        _, before = page.drawn(settings)
        page.say("ask", settings, what="points")
        told = page.told("told")["told"]
        assert [one[0] for one in told["points"]] == [64, 128, 128]
        _, after = page.drawn(settings | {"transfer": told["transfer"]})
        apart = np.abs(levels(before).astype(int) - levels(after))
        assert apart.max() <= 1  # colors of points have 256 levels
        page.say("ask", settings, what="everything")
        assert "can ask for points" in page.told("error")["text"]


@pytest.mark.parametrize("name", ["viridis:opacity=0.6,low=0.2", "surfaces", "bone+hot"])
def test_points_come_close_to_looks_of_any_kind(name: str) -> None:
    transfer = load_transfer(name)
    points = points_of(transfer, (-10.0, 300.0))
    assert len(points) <= MOST
    value = np.linspace(-10, 300, 777)
    slopes = np.full(value.size, 1e30, np.float32)
    color, opacity = spread(transfer, (-10.0, 300.0)).classify(value, slopes, (-10.0, 300.0), 1.0)
    made, thick = load_transfer(spelled(points))(value, (-10.0, 300.0))
    # 14 lines instead of three regions' ramps; a step falls between two of 512 places
    assert np.percentile(np.abs(opacity - thick), 98) < 0.04
    assert np.percentile(np.abs(color - made).max(axis=1) * opacity, 98) < 0.04


@pytest.mark.sweep
def test_a_closed_page_frees_its_scene(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[weakref.ref[VolumePainter]] = []

    def remembered(first: VolumePainter) -> VolumePainter:
        painter = VolumePainter(first.volume)
        made.append(weakref.ref(painter))
        return painter

    monkeypatch.setattr(VolumePainter, "__copy__", remembered)
    with served(volume_view(BOX)) as place:
        with place.page() as page:
            page.drawn(page.about["settings"])
            page.say("pick", page.about["settings"], x=24, y=20)
            page.told("picked")
        until = time.monotonic() + 10
        while made[0]() is not None and time.monotonic() < until:
            time.sleep(0.05)
            gc.collect()
        assert [one() for one in made] == [None]


def test_the_resample_command_finds_the_viewer_of_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "notes.md").write_text("no volume")
    (tmp_path / "head.nrrd").write_bytes(b"")
    assert suits([str(tmp_path / "head.nrrd")])
    assert suits(["vessel-tree:size=8"])
    for name in ("notes.md", "missing.nrrd"):
        assert not suits([str(tmp_path / name)])
    assert ended(resample_app, "view", tmp_path / "notes.md") == 2
    assert "no application shows this" in capsys.readouterr().err


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
            ({"transfer": "none.toml"}, "a page only changes the look"),
            ({"labels": "labels.nrrd"}, "a page only changes the look"),
            ({"camera": "1,2,3,4"}, "a page only changes the look"),
            ({"projection": "sideways"}, "composite"),
            ({"speed": 3}, "no option 'speed'"),
            ({"projection": "first-hit"}, "iso"),
            ({"window": "nan,nan"}, "its width must be above 0"),
            ({"fov": 1e9}, "0 to below 180 are allowed"),
            ({"ambient": -3}, "ambient: Input should be"),
        ):
            page.say("draw", settings | wrong, moving=False)
            text = page.told("error")["text"]
            assert said in text
            assert "\n" not in text
        assert page.drawn(settings)[0]["kind"] == "frame"


@pytest.mark.parametrize("kind", ["also", "channels"])
def test_several_volumes_are_one_picture_and_have_a_legend(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    z, y, x = np.mgrid[-1:1:12j, -1:1:12j, -1:1:12j]
    blobs = [200 * np.exp(-6 * ((x - at) ** 2 + y**2 + z**2)) for at in (-0.4, 0.4)]
    np.save("both.npy", np.array(blobs).astype(np.uint8))
    for name, blob in zip("ab", blobs, strict=True):
        np.save(f"{name}.npy", blob.astype(np.uint8))
    if kind == "also":
        opened = "a.npy", None, (), Added(also=("b.npy:transfer=auto:color=red",))
    else:
        opened = "both.npy", None, (), Added(channels="lime,red")
    with served(volume_view(*opened)) as place, place.page() as page:
        settings = page.about["settings"] | {"background": "black", "opacity-unit": 2.0}
        settings |= {"window": "20..180"} if kind == "channels" else {}
        head, data = page.drawn(settings)
        assert [one["colors"] for one in head["legend"]][-1] == ["#ff0000"]
        assert len(head["legend"]) == 2
        assert page.drawn(settings, moving=True)[0]["preview"]
        page.say("pick", settings, x=24, y=20)
        assert float(page.told("picked")["found"]["value"]) > 0
        page.say("export", settings)
        texts = page.told("exported")["texts"]
        page.say("draw", settings | {"projection": "maximum"}, moving=False)
        assert "several volumes need the projection composite" in page.told("error")["text"]
    assert ended(app, *shlex.split(texts["command"])[1:]) == 0
    written = levels(Path("picture.png").read_bytes())
    np.testing.assert_array_equal(levels(data), written)
    assert written[..., 0].max() > 100
    exec(texts["python"], {})
    np.testing.assert_array_equal(levels(Path("picture.png").read_bytes())[..., :3], written)


@pytest.mark.parametrize("more", [{}, {"projection": "maximum"}, {"projection": "additive"}])
def test_a_page_has_the_color_bar_of_the_picture(more: dict[str, str], tmp_path: Path) -> None:
    painter = VolumePainter(prepared(ReadOptions(), BOX))
    size = 160, 120
    plain, barred = (
        painter.paint({**more, "color-bar": bar}, size, quick=False, cancel=Cancel()).levels
        for bar in (False, True)
    )
    painter.save({**more, "color-bar": True}, size, tmp_path / "a.png")
    with Image.open(tmp_path / "a.png") as saved:
        written = np.asarray(saved.convert("RGB"))
    wide = written.shape[1] - size[0]
    assert barred.shape == plain.shape
    np.testing.assert_array_equal(barred[:, :-wide], plain[:, :-wide])
    np.testing.assert_array_equal(barred[:, -wide:, :3], written[:, size[0] :])
