"""OpenCV's own calls and ours, over types, layouts, channels, flags and borders."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from resample_dropins import opencv
from resample_texture.texels.encoding import DTYPES

GROWN = np.array([[3.3, 0.4, -4.3], [-0.3, 3.1, 6.2], [0.0007, 0.001, 1.0]])
SIZE, SHAPE = (70, 60), (60, 70)
OF_OPENCV = {"uint8", "uint16", "int16", "float32", "float64"}
BORDERS = {
    "constant": cv2.BORDER_CONSTANT,
    "replicate": cv2.BORDER_REPLICATE,
    "reflect": cv2.BORDER_REFLECT,
    "reflect 101": cv2.BORDER_REFLECT_101,
    "wrap": cv2.BORDER_WRAP,
    "transparent": cv2.BORDER_TRANSPARENT,
}
PADDINGS = {
    "constant": "constant",
    "replicate": "edge",
    "reflect": "symmetric",
    "reflect 101": "reflect",
    "wrap": "wrap",
    "transparent": "constant",
}
FAR = 40  # texels beyond the picture that are looked at
FLAGS = {
    "nearest": cv2.INTER_NEAREST,
    "linear": cv2.INTER_LINEAR,
    "cubic": cv2.INTER_CUBIC,
    "lanczos4": cv2.INTER_LANCZOS4,
}
# OpenCV's positions of LANCZOS4 have five bits.
RADII = {"nearest": 1, "linear": 2, "cubic": 3, "lanczos4": 5}
SAME = {"nearest": 1e-6, "linear": 2e-4, "cubic": 2e-4, "lanczos4": 0.01}
LAYOUTS = {
    "c": np.ascontiguousarray,
    "fortran": np.asfortranarray,
    "chw": lambda a: np.ascontiguousarray(np.moveaxis(a, -1, 0)).transpose(*range(1, a.ndim), 0),
    "backward": lambda a: a[::-1, ::-1].copy()[::-1, ::-1],
    "strided": lambda a: np.repeat(np.repeat(a, 2, axis=0), 3, axis=1)[::2, ::3],
    "read-only": lambda a: np.frombuffer(a.tobytes(), a.dtype).reshape(a.shape),
}


def smooth(dtype, channels, height=16, width=18):
    """Picture that goes on smoothly when it is wrapped around, over 0.6 of the type's range."""
    v, u = np.mgrid[:height, :width] * (2 * np.pi / np.array([height, width])[:, None, None])
    planes = [0.5 + 0.2 * np.sin(u + c) + 0.1 * np.cos(v - 2 * c) for c in range(channels or 1)]
    share = np.stack(planes, axis=2) if channels else planes[0]
    if np.dtype(dtype).kind == "b":
        return share > 0.5
    if np.dtype(dtype).kind == "f":
        return share.astype(dtype)
    limits = np.iinfo(dtype)
    return (limits.min + share * (float(limits.max) - limits.min)).astype(dtype)


def shares(values, dtype):
    """Values of a type as shares of its range."""
    if np.dtype(dtype).kind in "bf":
        return values.astype(np.float64)
    limits = np.iinfo(dtype)
    return (values.astype(np.float64) - limits.min) / (float(limits.max) - limits.min)


@pytest.mark.sweep
@settings(deadline=None, max_examples=250, derandomize=True)
@given(
    st.sampled_from(sorted({*DTYPES} - {"bool"})),
    st.sampled_from(sorted(LAYOUTS)),
    st.sampled_from([None, 1, 2, 3, 4, 5]),
    st.sampled_from(sorted(FLAGS)),
    st.sampled_from(sorted(BORDERS)),
    st.sampled_from(["warpPerspective", "warpAffine", "remap", "inverse"]),
)
def test_any_picture_is_warped_as_opencv_warps_it(dtype, layout, channels, flag, border, name):
    image = smooth(dtype, channels)
    choices = {"borderMode": BORDERS[border]}
    ours = warped(opencv, LAYOUTS[layout](image), name, FLAGS[flag], **choices)
    assert ours.dtype == image.dtype
    if dtype in OF_OPENCV - {"float64"} and (channels != 5 or flag in ("nearest", "linear")):
        theirs = warped(cv2, image, name, FLAGS[flag], **choices)
        np.testing.assert_array_equal(ours, theirs)
        return
    # OpenCV is asked channel by channel, as it takes no five, and of a picture that NumPy
    # continues, as its cubic borders are wrong beyond a period.
    floats = np.atleast_3d(shares(image, dtype).astype(np.float32))
    margins = ((FAR, FAR), (FAR, FAR))
    planes = [np.pad(floats[..., c], margins, PADDINGS[border]) for c in range(floats.shape[2])]
    theirs = [warped(cv2, plane, name, FLAGS[flag], FAR) for plane in planes]
    inner = np.ones(SHAPE, np.bool_)
    if border in ("constant", "transparent"):
        beside = RADII[flag]  # texels that are mixed with the border's color there, not here
        ones = np.pad(np.ones((16 - 2 * beside, 18 - 2 * beside), np.float32), FAR + beside)
        inner = warped(cv2, ones, name, FLAGS["linear"], FAR) == 1.0
    assert inner.sum() > 300
    error = np.abs(shares(ours, dtype) - np.stack(theirs, axis=2).reshape(ours.shape))[inner]
    step = 0.6 / 255 if dtype in ("uint8", "int8") else 1e-3
    if flag == "nearest":  # a pixel's center on the line between texels may go either way
        assert (error > step).mean() < 0.01
    else:
        assert error.max() < SAME[flag] + step


def warped(module, image, name, flag, margin=0, **choices):
    """Picture warped by a call of OpenCV's; of a picture with a margin as if it had none."""
    matrix = GROWN @ [[1, 0, -margin], [0, 1, -margin], [0, 0, 1.0]]
    if choices.get("borderMode") == cv2.BORDER_TRANSPARENT:
        choices["dst"] = np.zeros((*SHAPE, *image.shape[2:]), image.dtype)
    if name == "warpAffine":
        return module.warpAffine(image, matrix[:2], SIZE, flags=flag, **choices)
    if name == "remap":
        y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)
        x, y = x * 0.3137 - 2.0713 + 0.0213 * y, y * 0.3319 - 1.0917 - 0.0117 * x
        return module.remap(image, x + margin, y + margin, flag, **choices)
    if name == "inverse":
        flag, matrix = flag | cv2.WARP_INVERSE_MAP, np.linalg.inv(matrix)
    return module.warpPerspective(image, matrix, SIZE, flags=flag, **choices)


@pytest.mark.parametrize("dtype", sorted(OF_OPENCV))
@pytest.mark.parametrize("channels", [None, 1, 3, 4])
@pytest.mark.parametrize("border", sorted({*BORDERS} - {"transparent"}))
def test_every_border_is_opencv_s_texel_by_texel(border, channels, dtype):
    image = np.random.default_rng(7).integers(0, 200, (5, 7, channels or 1)).astype(dtype)
    image = image if channels else image[..., 0]
    shift = np.array([[1.0, 0.0, 3.0], [0.0, 1.0, 2.0]])
    value = (7, 8, 9, 10)
    for flag in (cv2.INTER_NEAREST, cv2.INTER_LINEAR):
        choices = {"flags": flag, "borderMode": BORDERS[border], "borderValue": value}
        ours = opencv.warpAffine(image, shift, (14, 11), **choices)
        theirs = cv2.warpAffine(image, shift, (14, 11), **choices)
        np.testing.assert_array_equal(ours, theirs.reshape(ours.shape))


@pytest.mark.parametrize("border", [cv2.BORDER_REFLECT_101, cv2.BORDER_DEFAULT])
def test_reflection_goes_on_for_ever(border):
    image = np.random.default_rng(7).random((4, 5)).astype(np.float32)
    shift = np.array([[1.0, 0.0, 50.0], [0.0, 1.0, 40.0]])
    ours = opencv.warpAffine(image, shift, (100, 90), borderMode=border)
    expected = np.pad(image, ((40, 46), (50, 45)), mode="reflect")
    np.testing.assert_array_equal(ours, expected)


@pytest.mark.parametrize("flag", [cv2.INTER_NEAREST, cv2.INTER_NEAREST_EXACT])
@pytest.mark.parametrize("size", [(34, 30), (9, 8), (5, 7), (17, 15), (40, 3), (6, 5)])
def test_resizing_by_nearest_picks_opencv_s_texels(size, flag):
    labels = np.arange(15 * 17, dtype=np.uint16).reshape(15, 17)
    ours = opencv.resize(labels, size, interpolation=flag)
    theirs = cv2.resize(labels, size, interpolation=flag)
    if flag == cv2.INTER_NEAREST:
        np.testing.assert_array_equal(ours, theirs)
    else:  # a center on the line between two texels: either will do
        assert np.isin(ours, labels).all()
        assert (ours == theirs).mean() > 0.7


@pytest.mark.each_value
@pytest.mark.parametrize("dtype", sorted({*DTYPES} - {"bool"}))
@pytest.mark.parametrize("layout", ["c", "chw", "fortran"])
@pytest.mark.parametrize("channels", [None, 1, 3, 4])
def test_a_picture_grown_by_resizing_is_opencv_s(dtype, layout, channels):
    image = smooth(dtype, channels)
    given = LAYOUTS[layout](image)
    floats = shares(image, dtype).astype(np.float32)
    ours = shares(opencv.resize(given, (54, 64)), dtype)
    theirs = cv2.resize(floats, (54, 64)).reshape(ours.shape)
    np.testing.assert_allclose(ours, theirs, atol=1e-4 + 1 / 255)


@pytest.mark.parametrize("size", [(8, 4), (4, 8), (2, 2)])
def test_a_picture_shrunk_by_whole_factors_is_opencv_s_area(size):
    image = np.random.default_rng(7).random((32, 32, 3)).astype(np.float32)
    ours = opencv.resize(image, size, interpolation=cv2.INTER_AREA)
    theirs = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    np.testing.assert_allclose(ours, theirs, atol=1e-6)


@pytest.mark.parametrize(("fx", "fy"), [(0.5, 0.25), (2.0, 3.0), (0.37, 1.9)])
def test_scales_give_opencv_s_size(fx, fy):
    image = smooth("float32", 3)
    ours = opencv.resize(image, None, fx=fx, fy=fy)
    assert ours.shape == cv2.resize(image, None, fx=fx, fy=fy).shape
    np.testing.assert_array_equal(opencv.resize(image, (0, 0), None, fx, fy), ours)


def test_maps_may_be_counted_from_each_pixel_and_be_of_whole_numbers():
    image = smooth("float32", 3)
    y, x = np.mgrid[:40, :50].astype(np.float32)
    x, y = x * 0.31, y * 0.33
    expected = opencv.remap(image, x, y, cv2.INTER_LINEAR)
    at_y, at_x = np.mgrid[:40, :50]
    relative = opencv.remap(image, x - at_x, y - at_y, cv2.INTER_LINEAR | cv2.WARP_RELATIVE_MAP)
    np.testing.assert_allclose(relative, expected, atol=1e-5)
    fixed = cv2.convertMaps(x, y, cv2.CV_16SC2)
    rounded = opencv.remap(image, *fixed, cv2.INTER_LINEAR)
    np.testing.assert_allclose(rounded, expected, atol=0.02)
    both = opencv.remap(image, np.stack([x, y], axis=2), None, cv2.INTER_LINEAR)
    np.testing.assert_array_equal(both, expected)


def test_what_a_map_does_not_see_has_the_border_s_color():
    image = smooth("int32", None)
    x, y = np.meshgrid(np.arange(6.0), np.arange(5.0))
    x[2, 3] = np.nan
    for flag in (cv2.INTER_NEAREST, cv2.INTER_LINEAR):
        ours = opencv.remap(image, x, y, flag, borderValue=-5)
        assert ours[2, 3] == -5
        assert (ours[0] != -5).all()


@pytest.mark.parametrize("dtype", ["int16", "int64", "uint64", "float16", "bool"])
def test_results_are_put_where_they_are_asked_to_be(dtype):
    image = smooth(dtype, 3)
    dst = np.zeros((*SHAPE, 3), dtype)
    ours = opencv.warpPerspective(image, GROWN, SIZE, dst)
    assert ours is dst
    np.testing.assert_array_equal(dst, opencv.warpPerspective(image, GROWN, SIZE))


@pytest.mark.parametrize("value", [2**62 + 1, -(2**63), 5])
def test_a_border_s_color_is_a_whole_number_to_the_last_bit(value):
    image = np.full((4, 4), value, np.int64)
    ours = opencv.warpAffine(image, np.eye(3)[:2], (6, 6), borderValue=-3)
    assert ours[0, 0] == value
    assert ours[5, 5] == -3


# Gaps


@pytest.mark.parametrize("border", sorted({*BORDERS} - {"transparent"}))
@pytest.mark.parametrize("flag", FLAGS)
@pytest.mark.parametrize("name", ["warpPerspective", "remap", "resize"])
def test_what_is_not_a_number_is_kept_and_weighs_nothing(name, flag, border):
    image = np.full((16, 18, 2), [3.0, -5.0])
    image[4:8, 5:9, 1] = np.nan
    if name == "resize":
        ours = opencv.resize(image, (54, 48), interpolation=FLAGS[flag])
    elif name == "remap":
        x, y = np.meshgrid(np.arange(54) / 3 - 1 / 3, np.arange(48) / 3 - 1 / 3)
        ours = opencv.remap(image, x, y, FLAGS[flag], None, BORDERS[border], (3.0, -5.0))
    else:
        matrix = np.array([[3, 0, 1], [0, 3, 1], [0, 0, 1.0]])
        ours = opencv.warpPerspective(
            image, matrix, (54, 48), None, FLAGS[flag], BORDERS[border], (3.0, -5.0)
        )
    np.testing.assert_allclose(ours[..., 0], 3.0, rtol=1e-4)
    known = np.isfinite(ours[..., 1])
    np.testing.assert_allclose(ours[..., 1][known], -5.0, rtol=1e-4)
    lost = ~known[:24, :30]
    np.testing.assert_array_equal(lost[13:23, 16:26], True)  # 12:24, 15:27 is where it lies
    assert lost.sum() <= 14 * 14


def test_a_masked_array_comes_back():
    image = np.ma.MaskedArray(np.full((8, 8), 40, np.uint8), np.zeros((8, 8), np.bool_))
    image.mask[2:4, 2:4] = True
    matrix = np.diag([4.0, 4.0, 1.0])
    ours = opencv.warpPerspective(image, matrix, (40, 40), borderValue=9)
    assert isinstance(ours, np.ma.MaskedArray)
    assert ours.mask[7:13, 7:13].all()
    assert not ours.mask[20:].any()
    assert ours[39, 39] == 9
    assert set(ours[:20, :20].compressed().tolist()) == {40}


# Refusals


def test_an_affine_matrix_has_two_lines():
    with pytest.raises(ValueError, match=r"an affine matrix is \(2, 3\), not \(3, 3\)"):
        opencv.warpAffine(smooth("uint8", 3), np.eye(3), SIZE)


@pytest.mark.parametrize("scale", [(0, 0), (0.5, 0), (np.nan, 1), (-1, 1)])
def test_a_size_or_scales_are_needed(scale):
    with pytest.raises(ValueError, match="neither dsize nor scales"):
        opencv.resize(smooth("uint8", 3), None, None, *scale)


def test_unknown_interpolations_are_refused():
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    for flag in (5, 6, 7, 16):
        with pytest.raises(ValueError, match=f"interpolation {flag}: known are cv2.INTER_NEAREST"):
            opencv.remap(smooth("uint8", 3), x, y, flag)
    with pytest.raises(ValueError, match="interpolation 7: known are"):
        opencv.resize(smooth("uint8", 3), (5, 5), interpolation=7)
