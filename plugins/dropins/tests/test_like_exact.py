"""Drop-ins are the calls they replace: bit by bit where nothing moves, to rounding where it grows.

The truths are OpenCV, SciPy and, for shrunk pictures, means of blocks and the scene itself.
"""

from itertools import pairwise

import cv2
import numpy as np
import pytest
from scipy import ndimage

from resample_dropins import ndimage as like_ndimage
from resample_dropins import opencv, scikit
from resample_texture import BackwardMap, Hybrid, warp

FLAGS = {
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "area": cv2.INTER_AREA,
    "lanczos4": cv2.INTER_LANCZOS4,
}
TURN = np.deg2rad(7.0)
TURNED = np.array([[np.cos(TURN), -np.sin(TURN)], [np.sin(TURN), np.cos(TURN)]])


def noise(dtype="float32", shape=(40, 50)):
    values = np.random.default_rng(3).random(shape)
    return values.astype(dtype) if dtype[0] == "f" else (values * 255).astype(dtype)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "int16", "float32", "float64"])
@pytest.mark.parametrize("shift", [(0, 0), (3, -2)])
@pytest.mark.parametrize("flag", FLAGS.values())
def test_maps_of_whole_shifts_return_the_texels_themselves(flag, shift, dtype):
    image = noise(dtype, (12, 15, 3))
    y, x = np.mgrid[:12, :15].astype(np.float32)
    moved = opencv.remap(image, x + shift[0], y + shift[1], flag, borderMode=cv2.BORDER_WRAP)
    np.testing.assert_array_equal(moved, np.roll(image, (-shift[1], -shift[0]), (0, 1)))


@pytest.mark.parametrize("order", range(6))
def test_scipy_s_identity_returns_scipy_s_values(order):
    image = noise("float64")
    calls = (
        lambda module: module.map_coordinates(image, np.mgrid[:40, :50], order=order),
        lambda module: module.affine_transform(image, np.eye(2), order=order),
    )
    for call in calls:
        np.testing.assert_array_equal(call(like_ndimage), call(ndimage))
        np.testing.assert_allclose(call(like_ndimage), image, rtol=0, atol=1e-14)


@pytest.mark.parametrize("edge", ["transparent", "clamp", "wrap", "mirror", "reflect-101"])
def test_an_identity_map_is_no_warp(edge):
    image = noise("float64", (9, 8))
    y, x = np.mgrid[:9, :8]
    same = warp(image, BackwardMap.from_opencv(x, y), (9, 8), edge=edge)
    np.testing.assert_array_equal(same.image, image)


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("scale", [1.0, 1.7])
@pytest.mark.parametrize("flag", ["linear", "cubic"])
def test_turned_and_grown_pictures_are_opencv_s_up_to_rounding(flag, scale, dtype):
    image = noise(dtype)
    matrix = np.column_stack([scale * TURNED, (5.3, -4.1)])
    choices = {"flags": FLAGS[flag], "borderMode": cv2.BORDER_REFLECT}
    ours = opencv.warpAffine(image, matrix, (60, 50), **choices)
    theirs = cv2.warpAffine(image.astype(np.float32), matrix, (60, 50), **choices)
    if dtype == "uint8":
        np.testing.assert_allclose(ours, np.clip(theirs, 0, 255), atol=0.51)
    else:
        np.testing.assert_allclose(ours, theirs, atol=2e-5)


@pytest.mark.parametrize("shift", [(0.25, 0.5), (0.40625, 0.96875)])  # 32nds: all that it resolves
def test_lanczos_is_opencv_s(shift):
    image = noise()
    matrix = np.array([[1, 0, shift[0]], [0, 1, shift[1]]])
    choices = {"flags": cv2.INTER_LANCZOS4, "borderMode": cv2.BORDER_REFLECT_101}
    ours = opencv.warpAffine(image, matrix, (50, 40), **choices)
    np.testing.assert_allclose(ours, cv2.warpAffine(image, matrix, (50, 40), **choices), atol=2e-6)


@pytest.mark.parametrize("flag", ["linear", "cubic", "lanczos4"])
@pytest.mark.parametrize("size", [(100, 80), (77, 61), (50, 120)])
def test_enlarged_pictures_are_opencv_s(size, flag):
    image = noise()
    ours = opencv.resize(image, size, interpolation=FLAGS[flag])
    theirs = cv2.resize(image, size, interpolation=FLAGS[flag])
    np.testing.assert_allclose(ours, theirs, atol=2e-5)


@pytest.mark.parametrize("mode", ["nearest", "reflect", "mirror", "grid-wrap"])
@pytest.mark.parametrize("order", range(1, 6))
def test_orders_are_scipy_s_splines(order, mode):
    image = noise("float64")
    turned = like_ndimage.affine_transform(image, TURNED, (3.2, -2.7), order=order, mode=mode)
    theirs = ndimage.affine_transform(image, TURNED, (3.2, -2.7), order=order, mode=mode)
    # Beyond the outermost texels SciPy's "nearest" filters a padded picture instead.
    np.testing.assert_allclose(turned, theirs, atol=1e-5)


def test_scikit_s_order_of_three_is_cubic_convolution_by_a_matrix_and_a_spline_by_a_map():
    image, inverse = noise("float64"), np.eye(3)
    inverse[:2, 2] = 0.25, 0.5
    by_matrix = scikit.warp(image, inverse, order=3, mode="edge", clip=False)
    keys = Hybrid(interpolation="catmull-rom", average="shrinking")
    expected = warp(image, inverse, (40, 50), keys, edge="clamp", convention="opencv", inverse=True)
    np.testing.assert_array_equal(by_matrix, expected.image)
    shift = np.array([0.25, 0.5])
    by_map = scikit.warp(image, lambda xy: xy + shift, order=3, mode="symmetric", clip=False)
    theirs = ndimage.shift(image, (-0.5, -0.25), order=3, mode="reflect")
    np.testing.assert_allclose(by_map, theirs, atol=1e-5)


@pytest.mark.parametrize("flag", ["linear", "cubic", "lanczos4"])
def test_there_and_back_keeps_as_much_as_opencv(flag):
    y, x = np.mgrid[:90, :110]
    image = (127 + 60 * np.sin(0.9 * x + 0.2 * y) + 50 * np.cos(0.1 * x * y / 20)).astype(np.uint8)
    there, back = (cv2.getRotationMatrix2D((55, 45), angle, 1) for angle in (7, -7))

    def error(module):
        turned = module.warpAffine(image, there, (110, 90), flags=FLAGS[flag])
        again = module.warpAffine(turned, back, (110, 90), flags=FLAGS[flag])
        return np.square(again.astype(float) - image)[20:-20, 20:-20].mean()

    assert error(opencv) <= 1.01 * error(cv2)  # either rounds some values the other way


@pytest.mark.parametrize("dtype", ["uint8", "float32", "float64"])
@pytest.mark.parametrize(("down", "across"), [(2, 2), (3, 5), (1, 4), (8, 1)])
def test_area_is_the_mean_of_blocks(down, across, dtype):
    image = noise(dtype, (48, 120, 3))
    ours = opencv.resize(image, (120 // across, 48 // down), interpolation=cv2.INTER_AREA)
    blocks = image.reshape(48 // down, down, 120 // across, across, 3).astype(np.float64)
    if dtype == "uint8":
        np.testing.assert_allclose(ours, blocks.mean(axis=(1, 3)), atol=0.501)
    else:
        np.testing.assert_allclose(ours, blocks.mean(axis=(1, 3)), atol=2e-6)


@pytest.mark.parametrize("size", [(33, 21), (75, 90), (50, 80)])
def test_area_is_opencv_s_at_any_factor(size):
    image = noise()
    ours = opencv.resize(image, size, interpolation=cv2.INTER_AREA)
    theirs = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(ours, theirs, atol=2e-5)


@pytest.mark.some(1)
@pytest.mark.parametrize("flag", ["linear", "cubic", "lanczos4"])
def test_nothing_jumps_where_pixels_begin_to_be_averaged(flag, record):
    image = noise("float64", (32, 32))  # own code's

    def scaled(factor):
        matrix = np.diag([1 / factor, 1 / factor, 1])[:2]
        return opencv.warpAffine(image, matrix, (16, 16), flags=FLAGS[flag], borderMode=4)

    # Linear interpolation widens texels to √3 of them. Texels at 16 px move by 0.0016 to 0.0028.
    seam = np.sqrt(3) if flag == "linear" else 1.0
    pictures = [scaled(seam * factor) for factor in np.arange(0.9985, 1.0015, 1e-4)]
    steps = [np.abs(after - before).max() for before, after in pairwise(pictures)]
    record.error("largest step", max(steps))


def test_shrunk_pictures_do_not_alias():
    y, x = np.mgrid[:256, :256]
    rings = 0.5 + 0.5 * np.cos(0.0055 * (x * x + y * y))  # beyond the grid's limit at 1/4
    for flag in FLAGS.values():
        ours = opencv.resize(rings, (64, 64), interpolation=flag)[40:, 40:]
        theirs = cv2.resize(rings, (64, 64), interpolation=flag)[40:, 40:]
        if flag != cv2.INTER_AREA:
            assert ours.std() < 0.4 * theirs.std()


def test_our_own_interpolations_are_there_by_name():
    image = noise()
    matrix = np.diag([2.0, 2.0, 1.0])
    named = {"interpolation": "area-spline"}
    expected = warp(image, matrix, (80, 100), edge="clamp").image
    np.testing.assert_array_equal(opencv.resize(image, (100, 80), **named), expected)
    expected = warp(image, matrix, (80, 100), convention="opencv", fill="premultiplied").image
    ours = opencv.warpAffine(image, matrix[:2], (100, 80), **named)
    np.testing.assert_array_equal(ours, expected)
    ours = opencv.warpPerspective(image, matrix, (100, 80), **named)
    np.testing.assert_array_equal(ours, expected)
    ours = scikit.warp(image, np.linalg.inv(matrix), output_shape=(80, 100), **named)
    np.testing.assert_allclose(ours, expected, atol=1e-6)
    ours = like_ndimage.affine_transform(image, (0.5, 0.5), output_shape=(80, 100), **named)
    np.testing.assert_allclose(ours, expected, atol=1e-6)
    y, x = np.mgrid[:40, :50] + 0.25
    expected = warp(image, BackwardMap.from_opencv(x, y), (40, 50), fill="premultiplied").image
    ours = opencv.remap(image, x, y, **named)
    np.testing.assert_array_equal(ours, expected)
    ours = like_ndimage.map_coordinates(image, (y, x), **named)
    np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"average": "never"}, "average is always or shrinking, not 'never'"),
        ({"average": "shrinking"}, "takes texels for means, so it averages always"),
        ({"average": "shrinking", "filter": "gaussian"}, "leave filter, magnified and total out"),
        ({"average": "shrinking", "total": True}, "leave filter, magnified and total out"),
    ],
)
def test_what_cannot_be_averaged_so_is_refused(choices, message):
    with pytest.raises(ValueError, match=message):
        Hybrid(**choices)
