"""A picture that is opened once: the bits of a call, previews, texels under pixels, inputs."""

import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from resample import Cancel, CancelledError
from resample.files.conversion import as_picture
from resample.measuring.quality import psnr
from resample_texture import BackwardMap, ForwardMap, Homography, PictureScene, warp
from resample_texture.geometry.mappings import pixel_centers
from tests.record import Record

TILTED = np.array([[0.9, 0.3, 4], [-0.1, 0.8, 9], [0.0005, 0.002, 1]])
SHAPE = (60, 80)


def photo(height: int = 90, width: int = 120) -> NDArray[np.uint8]:
    y, x = np.indices((height, width)) / 20
    color = [np.sin(2 * x + y), np.cos(x - 2 * y), np.sin(3 * x) * np.cos(2 * y)]
    return (127 + 120 * np.stack(color, axis=-1)).astype(np.uint8)


def bent(shape: tuple[int, int]) -> BackwardMap:
    x, y = pixel_centers(shape)
    return BackwardMap(1.4 * x + 4 * np.sin(y / 9), 1.3 * y + 3 * np.cos(x / 11))


@pytest.mark.parametrize("method", ["hybrid", "bilinear", "nearest"])
def test_final_pictures_have_the_bits_of_a_call(method: str) -> None:
    scene = PictureScene(photo())
    for matrix in (TILTED, np.diag([0.3, 0.4, 1]), bent(SHAPE)):
        seen = scene.render(matrix, size=SHAPE[::-1], method=method, edge="mirror")
        alone = warp(photo(), matrix, SHAPE, method, edge="mirror")
        np.testing.assert_array_equal(seen.image, alone.image)
        np.testing.assert_array_equal(seen.coverage, alone.coverage)
        assert not seen.is_preview


@pytest.mark.parametrize("scale", [0.13, 0.5, 1.0, 3.0])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32, np.int32])
def test_previews_are_alike_and_say_so(scale: float, dtype: Any, record: Record) -> None:
    picture = photo().astype(dtype)
    scene, matrix = PictureScene(picture), np.diag([scale, scale, 1]) @ TILTED
    final = scene.render(matrix, size=(81, 55))
    preview = scene.render(matrix, size=(81, 55), quality="preview")
    assert preview.is_preview
    assert preview.image.shape == final.image.shape
    assert preview.image.dtype == final.image.dtype
    assert preview.coverage.mean() == pytest.approx(final.coverage.mean(), abs=0.01)
    light = [warped.image.astype(np.float64) / 255 for warped in (preview, final)]
    record.quality("preview", psnr(*light))


@pytest.mark.parametrize("kind", ["backward", "forward"])
def test_previews_of_maps_are_alike(kind: str, record: Record) -> None:
    scene = PictureScene(photo())
    x, y = np.broadcast_arrays(*pixel_centers((90, 120)))
    forward = ForwardMap(0.6 * x + 2 * np.sin(y / 9), 0.7 * y)
    geometry = bent(SHAPE) if kind == "backward" else forward
    final, preview = (
        scene.render(geometry, size=SHAPE[::-1], quality=quality)
        for quality in ("final", "preview")
    )
    record.quality("preview", psnr(preview.image / 255.0, final.image / 255.0))


def test_texels_of_pixels_are_those_of_a_loop() -> None:
    scene = PictureScene(photo(20, 30))
    found = scene.sample_ids(TILTED, size=(40, 25))
    inverse = np.linalg.inv(TILTED)
    for row in range(25):
        for column in range(40):
            u, v, w = inverse @ (column + 0.5, row + 0.5, 1)
            x, y = u / w, v / w
            truth = (int(y // 1), int(x // 1)) if 0 <= x < 30 and 0 <= y < 20 else (-1, -1)
            assert tuple(found[row, column]) == truth
    assert 0.2 < (found[..., 0] >= 0).mean() < 0.9
    with pytest.raises(ValueError, match="forward maps"):
        scene.sample_ids(ForwardMap(*np.broadcast_arrays(*pixel_centers((20, 30)))))


@pytest.mark.sweep
def test_a_warp_is_cancelled_and_the_next_is_the_same() -> None:
    scene, cancel = PictureScene(photo(400, 500)), Cancel()
    before = scene.render(TILTED, size=(600, 500)).image
    threading.Timer(0.02, cancel.cancel).start()

    def again() -> None:
        for _ in range(1000):
            scene.render(TILTED, size=(600, 500), cancel=cancel)

    with pytest.raises(CancelledError):
        again()
    np.testing.assert_array_equal(scene.render(TILTED, size=(600, 500)).image, before)


def swapped(image: NDArray[Any]) -> NDArray[Any]:
    return image.astype(image.dtype.newbyteorder(">" if image.dtype.isnative else "<"))


def mapped(image: NDArray[Any]) -> NDArray[Any]:
    np.save("mapped.npy", image)
    return np.load("mapped.npy", mmap_mode="r")


def read_only(image: NDArray[Any]) -> NDArray[Any]:
    image = image.copy()
    image.setflags(write=False)
    return image


def apart(image: NDArray[Any]) -> NDArray[Any]:
    return np.repeat(image, 2, axis=1)[:, ::2]


def as_pillow(image: NDArray[Any]) -> Any:
    from PIL import Image

    return Image.fromarray(image)


def as_itk(image: NDArray[Any]) -> Any:
    import SimpleITK

    return SimpleITK.GetImageFromArray(image, isVector=True)


def as_labeled(image: NDArray[Any]) -> Any:
    xarray = pytest.importorskip("xarray")
    return xarray.DataArray(image.transpose(2, 0, 1), dims=("band", "y", "x"))


def as_file(image: NDArray[Any]) -> Path:
    cv2.imwrite("photo.png", image[..., ::-1])
    return Path("photo.png")


FORMS = [np.asarray, swapped, mapped, read_only, apart, np.asfortranarray, np.ndarray.tolist]
OTHERS = [as_pillow, as_itk, as_labeled, as_file]


@pytest.mark.parametrize("form", FORMS + OTHERS, ids=lambda form: form.__name__)
def test_pictures_are_taken_as_users_have_them(
    form: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    picture = photo(12, 16) if form in OTHERS else photo(12, 16).astype(np.int16)
    wanted = warp(picture, TILTED, (14, 15)).image
    made = warp(form(picture), TILTED, (14, 15)).image
    np.testing.assert_array_equal(made, wanted)
    scene = PictureScene(form(picture))
    np.testing.assert_array_equal(scene.render(TILTED, size=(15, 14)).image, wanted)


@pytest.mark.parametrize("mode", ["1", "L", "P", "RGBA", "CMYK", "I;16", "F"])
def test_pillow_s_modes_become_arrays(mode: str) -> None:
    from PIL import Image

    gray = Image.fromarray(photo(12, 16)).convert("L")
    image = Image.fromarray(np.asarray(gray).astype(np.uint16)) if mode == "I;16" else gray
    image = image if mode == "I;16" else Image.fromarray(photo(12, 16)).convert(mode)
    array = as_picture(image)
    assert array.shape[:2] == (12, 16)
    assert array.dtype.kind in "uf"
    assert warp(image, TILTED, (10, 10)).image.shape[:2] == (10, 10)


@pytest.mark.parametrize(
    ("given", "error", "message"),
    [
        (None, TypeError, "a picture of NoneType; give an array"),
        (7, TypeError, "a picture of int; give an array"),
        ({"a": 1}, TypeError, "a picture of dict; give an array"),
        ([[1, 2], [3]], ValueError, "lists of different lengths are not a picture"),
        (np.zeros((4, 4), object), TypeError, "a picture of object; its values must be real"),
        (np.full((4, 4), "a"), TypeError, "its values must be real or complex numbers"),
        (np.zeros((0, 4)), ValueError, "a picture is"),
        (np.zeros(4), ValueError, "a picture is"),
        ("none.png", OSError, "no such file"),
    ],
)
def test_what_is_no_picture_is_said_in_a_line(
    given: Any, error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message) as raised:
        warp(given, TILTED, (8, 8))
    assert "\n" not in str(raised.value)


def test_choices_that_there_are_not_are_refused() -> None:
    scene = PictureScene(photo())
    with pytest.raises(ValueError, match="quality 'best'; it can be final or preview"):
        scene.render(TILTED, quality="best")  # type: ignore[arg-type]
    for quality in ("final", "preview"):
        with pytest.raises(LookupError, match="magic"):
            scene.render(TILTED, method="magic", quality=quality)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="a preview has no roi; leave it out"):
        scene.render(TILTED, quality="preview", roi=(0, 0, 4, 4))
    assert scene.render(TILTED, quality="preview", filter="gaussian", detail=2.0).is_preview
    with pytest.raises(ValueError, match="give width and height"):
        scene.render(TILTED, size=7.5)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="one picture"):
        PictureScene(np.zeros((2, 8, 8, 3), np.uint8)).render(TILTED)
    assert scene.render(Homography(TILTED)).image.shape == (90, 120, 3)
