"""Clouds in pages: what is seen is what the exported command writes."""

import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from resample.view import views
from resample_points import viewing
from resample_points.cli import app
from resample_points.viewing import cloud_view, suits
from tests.commands import ended
from tests.view.conftest import Served, check_export, frames_of, served

CLOUD_WISHES: dict[str, dict[str, Any]] = {
    "as it is": {},
    "turned": {"camera": "70/10/1.4/0.1/-0.1", "up": "y", "steady": True},
    "colored": {"color-by": "z", "range": "10%,90%", "background": "white"},
}


@pytest.fixture(scope="module")
def cloud(tmp_path_factory: pytest.TempPathFactory) -> str:
    """File of a cloud."""
    path = tmp_path_factory.mktemp("view") / "cloud.xyz"
    np.savetxt(path, np.random.default_rng(3).random((500, 3)) * [2, 1, 0.1])
    return str(path)


@pytest.fixture(scope="module")
def around(cloud: str) -> Iterator[Served]:
    with served(cloud_view(Path(cloud))) as address:
        yield address


@pytest.mark.some(1)
@pytest.mark.parametrize("wish", CLOUD_WISHES)
def test_the_exported_command_makes_the_page_s_cloud(
    wish: str, around: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    check_export(around, app, CLOUD_WISHES[wish], in_python=wish == "colored")


def test_a_point_of_a_cloud_is_picked(around: Served, cloud: str, tmp_path: Path) -> None:
    with around.page() as page:
        settings = page.about["settings"] | {"camera": "top"}
        page.say("pick", settings, x=24, y=20)
        place = [float(part) for part in page.told("picked")["found"]["position"].split(",")]
        np.testing.assert_allclose(place, [1, 0.5, 0.05], atol=0.1)
        page.say("pick", settings, x=0.5, y=0.5)
        assert page.told("picked")["found"] == {}
        np.savetxt(
            tmp_path / "pose.txt", [[1, 0, 0, -1], [0, 1, 0, -0.5], [0, 0, 1, 2], [0, 0, 0, 1]]
        )
        calibrated = {"pose": str(tmp_path / "pose.txt"), "intrinsics": "30,30,24,20"}
        page.say("pick", settings | calibrated, x=24, y=20)
        assert "a page only changes the look" in page.told("error")["text"]
    painter = cloud_view(Path(cloud)).painter()
    found = painter.pick(settings | calibrated, (48, 40), 24, 20)
    place = [float(part) for part in found["position"].split(",")]
    np.testing.assert_allclose(place, [1, 0.5, 0.05], atol=0.1)


def test_clouds_are_known_by_their_files(cloud: str, tmp_path: Path) -> None:
    arrays = {"cloud": {"position": np.zeros((2, 3))}, "volume": {"data": np.zeros((2, 2, 2))}}
    for name, parts in arrays.items():
        np.savez(tmp_path / f"{name}.npz", **parts)
    (tmp_path / "damaged.npz").write_bytes(b"PK")
    assert suits([cloud])
    assert suits([str(tmp_path / "cloud.npz")])
    for names in ([], [cloud, cloud], ["none.xyz"], [str(tmp_path)]):
        assert not suits(names)
    for name in ("volume.npz", "damaged.npz"):
        assert not suits([str(tmp_path / name)])


def test_a_film_around_a_cloud_shows_the_page_s_pictures(
    around: Served, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(views, "STEP", 0.1)
    cameras = ["350/20/1", "10/30/1.5/0.1/0"]
    with around.page() as page:
        settings = page.about["settings"] | {"color-by": "z", "background": "white"}
        page.say("export", settings, keyframes=cameras)
        texts = page.told("exported")["texts"]
        page.say("film", settings, keyframes=cameras)
        Path("page.mp4").write_bytes(page.answer()[1])
    Path("keyframes.toml").write_text(texts["keyframes"], "utf-8")
    words = shlex.split(texts["film"])
    assert words[:2] == ["resample-points", "animate"]
    assert ended(app, *words[1:]) == 0
    made, wanted = (frames_of(Path(name)) for name in ("page.mp4", "film.mp4"))
    np.testing.assert_array_equal(made, wanted)
    assert ended(app, *words[1:-1], "frames") == 0
    pictures = sorted(Path("frames").glob("*.png"))
    for camera, frame in zip(cameras, (pictures[0], pictures[-1]), strict=True):
        still = viewing.picture(Path(words[2]), settings | {"camera": camera, "size": "48x40"})
        np.testing.assert_array_equal(cv2.imread(str(frame)), np.array(still)[..., 2::-1])
