"""Results where arrays are wanted: NumPy, Matplotlib, Pillow and OpenCV take them."""

from pathlib import Path
from typing import Any

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from resample import Scatter, Scattering
from resample.types import Frame, Statistics
from resample_particles import Particles, column_density
from resample_sky import coadd
from resample_texture import Warped, warp
from resample_warp3d import Camera
from resample_warp3d import warp as warp_depth
from resample_warp3d.types import Warped as WarpedDepth

NO_COUNTS = Statistics(0, 0, 0, 0, 1, {})
SHIFT = [[1.0, 0, 4], [0, 1, 0]]


def frame() -> Frame:
    """Half of red light at the left, all of it at the right, premultiplied."""
    alpha = np.full((3, 2), 0.5, np.float32)
    alpha[:, 1] = 1
    rgba = np.stack([alpha, 0 * alpha, 0 * alpha, alpha], axis=2)
    return Frame(rgba, 2 * alpha, 2 * alpha, alpha, NO_COUNTS)


def moved(dtype: str = "uint8", channels: int = 3) -> Warped:
    levels = np.random.default_rng(1).integers(0, 200, (12, 20, channels)[: 2 + (channels > 1)])
    return warp(levels.astype(dtype), SHIFT, (12, 20))


def moved_depth() -> WarpedDepth:
    camera = Camera.from_fov(60, 12, 20)
    return warp_depth(np.full((12, 20, 3), 0.5), np.full((12, 20), 2.0), camera, camera)


def scattered() -> Scattering:
    return Scatter()([[2.5, 1.5]], [7.0], jacobian=np.eye(2)[np.newaxis], shape=(3, 4))


def test_an_array_of_a_frame_holds_the_levels_that_people_see() -> None:
    seen = np.asarray(frame())
    assert seen.dtype == np.uint8
    assert seen.tolist() == [[[255, 0, 0, 128], [255, 0, 0, 255]]] * 3


def test_an_array_of_a_warped_depth_image_holds_levels_too() -> None:
    seen = np.asarray(moved_depth())
    half = round(255 * (1.055 * 0.5 ** (1 / 2.4) - 0.055))  # linear light, as sRGB
    assert seen.dtype == np.uint8
    assert (seen[2:-2, 2:-2] == [half, half, half, 255]).all()


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize("channels", [1, 3])
def test_an_array_of_a_warped_picture_has_the_values_and_type_of_its_source(
    dtype: str, channels: int
) -> None:
    warped = moved(dtype, channels)
    seen = np.asarray(warped)
    assert seen.dtype == dtype
    np.testing.assert_array_equal(seen, warped.image)


def test_masks_stay_where_the_array_may_be_of_a_subclass() -> None:
    masked = np.ma.MaskedArray(np.ones((12, 20)), np.eye(12, 20) > 0)
    warped = warp(masked, np.eye(3), (12, 20))
    assert type(np.asarray(warped)) is np.ndarray
    assert np.asanyarray(warped).mask.sum() == 12  # type: ignore[attr-defined]


def test_arrays_of_measurements_are_their_values() -> None:
    found = scattered()
    np.testing.assert_array_equal(np.asarray(found), found.value)
    particles = Particles(np.eye(3)[:2], 1.0, 0.3)
    density = column_density(particles, "z", size=(16, 8))
    np.testing.assert_array_equal(np.asarray(density), density.value)
    mean = coadd([np.ones((4, 5))] * 2, [np.eye(3)] * 2, (4, 5))
    np.testing.assert_array_equal(np.asarray(mean), mean.mean)


@pytest.mark.parametrize("make", [frame, moved_depth, moved, scattered])
def test_an_array_has_the_type_asked_for(make: Any) -> None:
    result = make()
    seen = np.asarray(result, np.float64)
    assert seen.dtype == np.float64
    np.testing.assert_array_equal(seen, np.asarray(result))


def test_copies_follow_numpys_rules() -> None:
    """See NumPy 2's migration guide: `copy=False` never copies, None only if it must."""
    warped = moved("float32", 1)
    assert np.shares_memory(np.asarray(warped), warped.image)
    assert np.shares_memory(np.asarray(warped, copy=False), warped.image)
    assert not np.shares_memory(np.array(warped), warped.image)
    with pytest.raises(ValueError, match="copy"):
        np.asarray(warped, np.uint8, copy=False)
    with pytest.raises(ValueError, match=r"levels of a Frame are computed.*copy"):
        np.asarray(frame(), copy=False)


@pytest.mark.parametrize("make", [frame, moved, moved_depth])
def test_matplotlib_shows_the_colors_of_a_result(make: Any) -> None:
    result = make()
    with mpl.rc_context({"image.interpolation": "none", "image.interpolation_stage": "rgba"}):
        axes = Figure().add_subplot()
        shown = axes.imshow(result)
    np.testing.assert_array_equal(shown.get_array(), np.asarray(result))


def test_matplotlib_shows_the_values_of_measurements() -> None:
    shown = Figure().add_subplot().imshow(scattered())
    assert shown.get_array().shape == (3, 4)  # type: ignore[union-attr]


def test_pillow_takes_the_levels() -> None:
    found = frame().to_uint8()
    image = Image.fromarray(found)
    assert (image.mode, image.size) == ("RGBA", (2, 3))
    assert Image.fromarray(np.asarray(frame())).tobytes() == image.tobytes()


@pytest.mark.parametrize("background", [None, "black"])
def test_opencv_writes_the_picture_in_its_order_of_channels(
    background: str | None, tmp_path: Path
) -> None:
    seen, path = frame(), str(tmp_path / "a.png")
    assert cv2.imwrite(path, seen.to_uint8(background=background, order="bgr"))
    with Image.open(path) as written:
        np.testing.assert_array_equal(np.asarray(written), seen.to_uint8(background=background))
    assert cv2.imwrite(path, seen.to_uint8("depth", order="bgr"))
    with Image.open(path) as written:
        np.testing.assert_array_equal(np.asarray(written), seen.to_uint8("depth"))


def test_levels_for_opencv_are_contiguous() -> None:
    assert frame().to_uint8(order="bgr").flags.c_contiguous  # cv2 draws into no other


def test_unknown_orders_of_channels_are_refused() -> None:
    with pytest.raises(ValueError, match="order 'gbr'; give rgb or bgr"):
        frame().to_uint8(order="gbr")  # type: ignore[arg-type]


def test_results_are_pictures_for_further_warps() -> None:
    """In the light that they hold, not in 8-bit levels."""
    seen = warp(frame(), np.eye(3), (3, 2))
    assert seen.image.dtype == np.float32
    np.testing.assert_array_equal(seen.image, frame().rgba)
    once = moved()
    np.testing.assert_array_equal(warp(once, np.eye(3), (12, 20)).image, once.image)
    deep = moved_depth()
    np.testing.assert_array_equal(warp(deep, np.eye(3), (12, 20)).image, deep.image)


@pytest.mark.parametrize("make", [frame, moved, moved_depth])
def test_a_result_is_still_the_tuple_of_its_parts(make: Any) -> None:
    result = make()
    assert len(tuple(result)) == len(type(result)._fields)
