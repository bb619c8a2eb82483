"""Polar pictures as OpenCV has them; zoom, shift, rotate and points as SciPy has them."""

import cv2
import numpy as np
import pytest
from scipy import ndimage

from resample_dropins import ndimage as like_ndimage
from resample_dropins import opencv

CENTER, RADIUS = (68.0, 61.0), 55.0
FILL, INVERSE, LOG = cv2.WARP_FILL_OUTLIERS, cv2.WARP_INVERSE_MAP, cv2.WARP_POLAR_LOG


def waves(height=120, width=140):
    y, x = np.mgrid[:height, :width]
    return (0.5 + 0.3 * np.sin(0.15 * x) + 0.2 * np.cos(0.11 * y)).astype(np.float32)


@pytest.mark.parametrize("log", [0, LOG])
@pytest.mark.parametrize("flag", [cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4])
def test_a_polar_picture_is_opencv_s(flag, log, record):
    ours = opencv.warpPolar(waves(), (70, 180), CENTER, RADIUS, flag | log | FILL)
    theirs = cv2.warpPolar(waves(), (70, 180), CENTER, RADIUS, flag | log | FILL)
    record.error("rms", np.sqrt(np.square(ours - theirs).mean()))  # near the pole texels grow


@pytest.mark.some(3)
@pytest.mark.parametrize("log", [0, LOG])
@pytest.mark.parametrize("flag", [cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4])
def test_a_polar_picture_becomes_what_it_was(flag, log, record):
    polar = opencv.warpPolar(waves(), (90, 360), CENTER, RADIUS, flag | log | FILL)
    back = opencv.warpPolar(polar, (140, 120), CENTER, RADIUS, flag | log | FILL | INVERSE)
    y, x = np.mgrid[:120, :140]
    distance = np.hypot(x - CENTER[0], y - CENTER[1])
    ring = (distance > 10) & (distance < 50)  # the seam at angle 0 included
    theirs = cv2.warpPolar(polar, (140, 120), CENTER, RADIUS, flag | log | FILL | INVERSE)
    error, other = (np.square(made - waves())[ring].mean() for made in (back, theirs))
    record.error("rms", np.sqrt(error))
    assert error < 2.0 * other


def test_sizes_not_given_are_opencv_s():
    for size in ((0, 0), (60, 0)):
        ours = opencv.warpPolar(waves(), size, CENTER, RADIUS, 1)
        assert ours.shape == cv2.warpPolar(waves(), size, CENTER, RADIUS, 1).shape


def test_older_names_have_the_picture_s_own_size():
    linear = opencv.linearPolar(waves(), CENTER, RADIUS, 1 | FILL)
    expected = opencv.warpPolar(waves(), (140, 120), CENTER, RADIUS, 1 | FILL)
    np.testing.assert_array_equal(linear, expected)
    logarithmic = opencv.logPolar(waves(), CENTER, 35.0, 1 | FILL)
    expected = opencv.warpPolar(waves(), (140, 120), CENTER, np.exp(4.0), 1 | FILL | LOG)
    np.testing.assert_allclose(logarithmic, expected, atol=1e-6)


@pytest.mark.parametrize(("radius", "flags"), [(0.0, 1), (-2.0, 1), (1.0, 1 | LOG), (np.inf, 1)])
def test_a_radius_without_room_is_refused(radius, flags):
    with pytest.raises(ValueError, match=r"maxRadius is above . px, not"):
        opencv.warpPolar(waves(), (9, 9), CENTER, radius, flags)


MODES = ["constant", "grid-constant", "reflect", "nearest", "mirror", "grid-wrap", "wrap"]


@pytest.mark.filterwarnings("ignore:It is recommended to use mode")  # SciPy's, of grid_mode
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("order", [1, 2, 3, 4, 5])
def test_scipy_s_calls_return_what_scipy_returns(order, mode):
    image = np.random.default_rng(1).random((30, 37))
    choices = {"order": order, "mode": mode}
    for call in (
        lambda module: module.shift(image, (2.3, -1.6), **choices),
        lambda module: module.zoom(image, (1.7, 2.2), **choices),
        lambda module: module.zoom(image, 2, grid_mode=True, **choices),
        lambda module: module.rotate(image, 17, **choices),
        lambda module: module.rotate(image, -40, axes=(0, 1), reshape=False, **choices),
    ):
        np.testing.assert_array_equal(call(like_ndimage), call(ndimage))


@pytest.mark.some(8)
@pytest.mark.parametrize("shape", [(200,), (3, 4, 5), ()])
@pytest.mark.parametrize("order", [0, 1, 3])
def test_points_are_none_another_s_neighbours(order, shape):
    image = np.random.default_rng(1).random((30, 37))
    places = np.random.default_rng(2).uniform(-5, 40, (2, *shape)) if shape else np.ones((2, 1))
    ours = like_ndimage.map_coordinates(image, places, order=order, mode="reflect")
    theirs = ndimage.map_coordinates(image, places, order=order, mode="reflect")
    np.testing.assert_allclose(ours, theirs, atol=2e-6)
    out = np.zeros(places.shape[1:], np.float32)
    assert like_ndimage.map_coordinates(image, places, out, order=order, mode="reflect") is out
    np.testing.assert_allclose(out, theirs, atol=2e-6)


def test_no_points_are_no_values():
    assert like_ndimage.map_coordinates(np.ones((4, 4)), np.zeros((2, 0))).shape == (0,)


@pytest.mark.sweep
def test_a_shrunk_picture_is_averaged_where_scipy_picks():
    y, x = np.mgrid[:256, :256]
    stripes = 0.5 + 0.5 * np.cos(2.9 * x + 0.3 * y)
    assert (
        like_ndimage.zoom(stripes, 0.2, mode="reflect").std()
        < 0.2 * ndimage.zoom(stripes, 0.2, mode="reflect").std()
    )


def test_what_leaves_no_pixel_is_refused():
    with pytest.raises(ValueError, match="leaves no pixel of a picture"):
        like_ndimage.zoom(np.ones((4, 4)), 0.01)
    with pytest.raises(ValueError, match="invalid rotation plane"):
        like_ndimage.rotate(np.ones((4, 4)), 5, axes=(0, 2))
    with pytest.raises(ValueError, match=r"axes are 0 and 1 of a picture, not \(0, 2\)"):
        like_ndimage.rotate(np.full((4, 4), np.nan), 5, axes=(0, 2))
