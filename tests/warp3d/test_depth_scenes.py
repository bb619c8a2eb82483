"""A depth image that is opened once: the bits of a call, previews, samples of pixels, inputs."""

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from resample import Cancel, CancelledError
from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import Equirectangular
from resample.measuring.quality import psnr
from resample_warp3d import DepthScene, warp
from tests.record import Record

SHAPE = (60, 80)
CAMERA = Camera.from_fov(55, *SHAPE)
BALL = 2.0  # of its depth


def room(height: int = 60, width: int = 80) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    y, x = np.indices((height, width))
    ball = (x - 0.4 * width) ** 2 + (y - 0.5 * height) ** 2 < (0.25 * height) ** 2
    depth = np.where(ball, BALL + 0.002 * x, 4 + 0.01 * y).astype(np.float32)
    waves = [np.sin(x / 5), np.cos(y / 4 + x / 9), np.sin((x + y) / 6)]
    return (127 + 120 * np.stack(waves, axis=-1)).astype(np.uint8), depth


def moved(x: float = 0.2) -> NDArray[np.float64]:
    pose = np.eye(4)
    pose[:3, 3] = (-x, 0.05, 0.1)
    return pose


SIGHTS = {
    "pinhole": CAMERA.resized(SHAPE, (240, 320)).moved(moved()),
    "parallel": Orthographic(72, 72, 160, 120, moved()),
    "panorama": Equirectangular(moved()),
}


@pytest.mark.some(2)
@pytest.mark.parametrize("method", ["hybrid", "mcmillan-zbuffer", "preview"])
def test_final_pictures_have_the_bits_of_a_call(method: str) -> None:
    scene = DepthScene(*room(), CAMERA)
    for size in (None, (50, 44)):
        seen = scene.render(moved(), size=size, method=method)
        alone = warp(*room(), CAMERA, CAMERA.moved(moved()), method, size=size)
        for part, of_call in zip(seen, alone, strict=True):
            np.testing.assert_array_equal(part, of_call)
        assert not seen.is_preview


def test_a_source_is_prepared_once(monkeypatch: pytest.MonkeyPatch) -> None:
    from resample_warp3d.sheet import sheets

    scene, counts = DepthScene(*room(), CAMERA), [0]
    made = sheets.sheet_of

    def counted(*given: Any, **choices: Any) -> Any:
        counts[0] += 1
        return made(*given, **choices)

    monkeypatch.setattr(sheets, "sheet_of", counted)
    for x in (0.1, 0.2, 0.3):
        scene.render(moved(x))
    assert counts[0] == 1


@pytest.mark.some(2)
@pytest.mark.parametrize("name", SIGHTS)
def test_previews_are_alike_and_say_so(name: str, record: Record) -> None:
    scene = DepthScene(*room(240, 320), CAMERA.resized(SHAPE, (240, 320)))
    size = (640, 320) if name == "panorama" else (317, 241)
    final = scene.render(SIGHTS[name], size=size)
    preview = scene.render(SIGHTS[name], size=size, quality="preview")
    assert preview.is_preview
    for part, of_final in zip(preview, final, strict=True):
        assert part.shape == of_final.shape
        assert part.dtype == of_final.dtype
    assert preview.coverage.mean() == pytest.approx(final.coverage.mean(), abs=0.05)
    record.quality("preview", psnr(preview.image, final.image))
    both = np.isfinite(preview.depth) & np.isfinite(final.depth)
    assert np.median(np.abs(preview.depth[both] - final.depth[both])) < 0.05


def test_samples_of_pixels_are_those_in_front() -> None:
    """Flat things seen by a camera that has moved aside: all is a shift that can be reckoned."""
    y, x = np.indices(SHAPE)
    near = (x >= 30) & (x < 50) & (y >= 20) & (y < 40)
    depth = np.where(near, 2.0, 4.0)
    scene = DepthScene(np.ones((*SHAPE, 3)), depth, CAMERA, noise=0.0, refine="none")
    away = 6 * 2.0 / CAMERA.fx  # 6 px for what is near, 3 px for what is far
    pose = np.eye(4)
    pose[0, 3] = -away
    found = scene.sample_ids(pose)
    for row in range(4, 56):
        for column in range(4, 70):
            is_near = 20 <= row < 40 and 24 <= column < 44
            is_hidden = 20 <= row < 40 and 44 <= column < 47
            if is_hidden:
                assert tuple(found[row, column]) == (-1, -1)
            else:
                assert tuple(found[row, column]) == (row, column + (6 if is_near else 3))
    index = np.stack(np.indices(SHAPE), axis=-1)
    np.testing.assert_array_equal(scene.sample_ids(np.eye(4)), index)


@pytest.mark.sweep
def test_a_warp_is_cancelled_and_the_next_is_the_same() -> None:
    scene, cancel = DepthScene(*room(240, 320), CAMERA.resized(SHAPE, (240, 320))), Cancel()
    before = scene.render(moved()).image
    threading.Timer(0.02, cancel.cancel).start()

    def again() -> None:
        for _ in range(1000):
            scene.render(moved(), cancel=cancel)

    with pytest.raises(CancelledError):
        again()
    np.testing.assert_array_equal(scene.render(moved()).image, before)


def swapped(array: NDArray[Any]) -> NDArray[Any]:
    return array.astype(array.dtype.newbyteorder(">"))


def read_only(array: NDArray[Any]) -> NDArray[Any]:
    array = array.copy()
    array.setflags(write=False)
    return array


def apart(array: NDArray[Any]) -> NDArray[Any]:
    return np.repeat(array, 2, axis=1)[:, ::2]


def mapped(array: NDArray[Any]) -> NDArray[Any]:
    np.save(f"{array.dtype}.npy", array)
    return np.load(f"{array.dtype}.npy", mmap_mode="r")


@pytest.mark.some(1)
@pytest.mark.parametrize("form", [swapped, read_only, apart, mapped, np.asfortranarray, list])
def test_arrays_of_any_layout_are_what_they_hold(
    form: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    color, depth = room()
    color = color.astype(np.uint16) * 257
    wanted = warp(color, depth, CAMERA, CAMERA.moved(moved())).image
    given = np.ndarray.tolist(depth) if form is list else form(depth)
    picture = color if form is list else form(color)
    made = warp(picture, given, CAMERA, CAMERA.moved(moved())).image
    np.testing.assert_array_equal(made, wanted)


def test_pictures_of_files_and_of_pillow_are_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from PIL import Image

    monkeypatch.chdir(tmp_path)
    color, depth = room()
    cv2.imwrite("color.png", color[..., ::-1])
    wanted = DepthScene(color, depth, CAMERA).render(moved()).image
    for given in ("color.png", Image.fromarray(color)):
        np.testing.assert_array_equal(
            DepthScene(given, depth, CAMERA).render(moved()).image, wanted
        )
    halves = depth.astype(np.float16)
    assert DepthScene(color, halves, CAMERA).render(moved()).coverage.mean() > 0.8


@pytest.mark.parametrize(
    ("color", "depth", "error", "message"),
    [
        (None, np.ones(SHAPE), TypeError, "a picture of NoneType; give an array"),
        (np.ones((*SHAPE, 3), complex), np.ones(SHAPE), TypeError, "must be real numbers"),
        (np.ones(SHAPE), {}, TypeError, "a depth map of dict; give an array"),
        (np.ones(SHAPE), np.full(SHAPE, "far"), TypeError, "a depth map of <U3"),
        (
            np.ones(SHAPE),
            [[1, 2], [3]],
            ValueError,
            "lists of different lengths are not a depth map",
        ),
        (np.ones(SHAPE), np.ones((0, 4)), ValueError, "depth of shape"),
        ("none.png", np.ones(SHAPE), OSError, "no such file"),
    ],
)
def test_what_is_no_depth_image_is_said_in_a_line(
    color: Any, depth: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as raised:
        DepthScene(color, depth, CAMERA)
    assert "\n" not in str(raised.value)


def test_targets_and_choices_that_there_are_not_are_refused() -> None:
    scene = DepthScene(*room(), CAMERA)
    for target in (None, "left", np.eye(3), [[1, 2], [3]]):
        with pytest.raises(TypeError, match=r"a target of .*; give a camera, or a pose"):
            scene.render(target)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="quality 'best'; it can be final or preview"):
        scene.render(moved(), quality="best")  # type: ignore[arg-type]
    for quality in ("final", "preview"):
        with pytest.raises(LookupError, match="magic"):
            scene.render(moved(), method="magic", quality=quality)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="give width and height"):
        scene.render(moved(), size="ab")  # type: ignore[arg-type]
