"""Kinds of pictures that pages may ask for are compiled once the first picture is there."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from resample.view import server
from resample.view.views import Warming
from resample_texture.viewing import picture_view
from resample_volume.viewing import volume_view
from resample_warp3d.command.source import SourceCamera
from resample_warp3d.viewing import depth_view
from tests.view.conftest import served


def views(folder: Path) -> list[Warming]:
    color, depth = str(folder / "color.png"), str(folder / "depth.npy")
    cv2.imwrite(color, np.random.default_rng(1).integers(0, 256, (20, 24, 3), np.uint8))
    np.save(depth, np.full((20, 24), 2.0, np.float32))
    np.save(folder / "volume.npy", np.indices((8, 8, 8), np.float32)[0])
    begin = (SourceCamera(fov=60),)
    return [
        volume_view(str(folder / "volume.npy")),
        picture_view(Path(color)),
        depth_view(color, depth, begin),
    ]


@pytest.mark.some(1)
@pytest.mark.slow
@pytest.mark.parametrize(
    "number",
    [0, 1, pytest.param(2, marks=pytest.mark.sweep)],
    ids=["volume", "picture", "depth"],  # the last has a rival compiled
)
def test_all_kinds_can_be_painted(number: int, tmp_path: Path) -> None:
    view = views(tmp_path)[number]
    assert isinstance(view, Warming)
    assert len(list(view.warm())) >= 3


def test_a_whole_picture_is_told_and_a_preview_is_not(tmp_path: Path) -> None:
    told = threading.Event()
    with served(views(tmp_path)[1], told.set) as place, place.page() as page:  # type: ignore[arg-type]
        settings = page.about["settings"] | {"corners": "1,1 20,2 20,18 2,16"}
        page.drawn(settings, moving=True)
        assert not told.is_set()
        page.drawn(settings)
        assert told.wait(60)


def test_what_cannot_be_compiled_is_nobody_s_trouble() -> None:
    class Broken:
        def warm(self):  # type: ignore[no-untyped-def]
            yield
            raise ValueError("odd")

    first = threading.Event()
    first.set()
    server._warmed(Broken(), first)
