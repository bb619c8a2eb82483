import cv2
import numpy as np
import pytest

from resample_dropins.opencv import warp_like_opencv
from resample_texture import Hybrid, warp

GROWN = np.array([[7.3, 0.9, -30.0], [-0.8, 8.1, -20.0], [0.004, 0.006, 1.0]])
SMALL = np.array([[3.7, 0.4, 21.0], [-0.3, 4.1, 17.0], [0.0, 0.0, 1.0]])  # within its frame
SIZE = (90, 80)  # width, height
SHAPE = (80, 90)
ROUNDING = 2e-4  # of OpenCV's positions where it has few bits
BORDERS = {
    "clamp": cv2.BORDER_REPLICATE,
    "mirror": cv2.BORDER_REFLECT,
    "reflect-101": cv2.BORDER_REFLECT_101,
    "wrap": cv2.BORDER_WRAP,
}


def smooth(height=15, width=17, channels=None):
    v, u = np.mgrid[:height, :width]
    planes = [0.5 + 0.25 * np.sin(0.4 * u + c) + 0.2 * np.cos(0.5 * v) for c in range(7)]
    stack = np.stack(planes, axis=2).astype(np.float32)
    return stack[..., 0] if channels is None else stack[..., :channels].copy()


def levels(image, dtype):
    return np.rint(image * np.iinfo(dtype).max).astype(dtype)


def inside(matrix, shape, picture=(15, 17)):
    """Pixels whose texels, and those around, all lie within the picture."""
    ones = np.zeros(picture, np.float32)
    ones[1:-1, 1:-1] = 1.0
    size = shape[::-1]
    return cv2.warpPerspective(ones, np.asarray(matrix), size, flags=cv2.INTER_LINEAR) == 1.0


def outside(matrix, shape, picture=(15, 17)):
    """Pixels more than a texel away from the picture."""
    ones = np.pad(np.ones(picture, np.float32), 2)
    moved = matrix @ np.array([[1, 0, -2], [0, 1, -2], [0, 0, 1.0]])
    return cv2.warpPerspective(ones, moved, shape[::-1], flags=cv2.INTER_LINEAR) == 0.0


@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4])
def test_a_grown_picture_is_opencv_s_bit_by_bit(channels):
    image = smooth(channels=channels)
    np.testing.assert_array_equal(
        warp_like_opencv(image, GROWN, SIZE), cv2.warpPerspective(image, GROWN, SIZE)
    )


def test_an_affine_matrix_is_that_of_warp_affine():
    image = smooth()
    theirs = cv2.warpAffine(image, SMALL[:2], SIZE)
    there = inside(SMALL, SHAPE)
    np.testing.assert_allclose(
        warp_like_opencv(image, SMALL[:2], SIZE)[there], theirs[there], atol=ROUNDING
    )


@pytest.mark.parametrize("flags", [cv2.INTER_LINEAR, cv2.INTER_CUBIC])
def test_a_matrix_may_lead_from_target_to_source(flags):
    image, inverse = smooth(), np.linalg.inv(GROWN)
    ours = warp_like_opencv(image, inverse, SIZE, flags=flags | cv2.WARP_INVERSE_MAP)
    np.testing.assert_allclose(ours, warp_like_opencv(image, GROWN, SIZE, flags=flags), atol=1e-5)
    theirs = cv2.warpPerspective(image, inverse, SIZE, flags=flags | cv2.WARP_INVERSE_MAP)
    there = inside(GROWN, SHAPE)
    np.testing.assert_allclose(ours[there], theirs[there], atol=ROUNDING)


def test_nearest_shows_squares_as_opencv_does():
    image = smooth()
    matrix = np.array([[6, 0, 2.5], [0, 6, 2.5], [0, 0, 1.0]])  # texels end where pixels do
    ours = warp_like_opencv(image, matrix, (102, 90), flags=cv2.INTER_NEAREST)
    theirs = cv2.warpPerspective(image, matrix, (102, 90), flags=cv2.INTER_NEAREST)
    np.testing.assert_allclose(ours, theirs, rtol=3e-5)  # boxes are 1e-5 px wider


@pytest.mark.parametrize(
    ("flags", "interpolation"),
    [
        (cv2.INTER_LINEAR, "bilinear"),
        (cv2.INTER_CUBIC, "cubic"),
        (cv2.INTER_AREA, "bilinear"),
        (cv2.INTER_LANCZOS4, "lanczos:a=4"),
        (cv2.INTER_CUBIC | cv2.WARP_FILL_OUTLIERS, "cubic"),
    ],
)
def test_flags_choose_the_reconstruction_of_what_shrinks(flags, interpolation):
    image, matrix = smooth(150, 170), np.diag([0.3, 0.4, 1.0])
    method = Hybrid(interpolation=interpolation, average="shrinking")
    expected = warp(image, matrix, SHAPE, method, convention="opencv", fill="premultiplied").image
    np.testing.assert_array_equal(warp_like_opencv(image, matrix, SIZE, flags=flags), expected)


def test_nearest_copies_texels():
    labels = np.random.default_rng(7).integers(-9, 9, (15, 17)).astype(np.int32)
    ours = warp_like_opencv(labels, SMALL, SIZE, flags=cv2.INTER_NEAREST, borderValue=77)
    theirs = cv2.warpPerspective(labels, SMALL, SIZE, flags=cv2.INTER_NEAREST, borderValue=77)
    np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
@pytest.mark.parametrize("edge", BORDERS)
def test_a_border_goes_on_like_opencv_s(edge, dtype):
    image = smooth(channels=3)
    image = image if dtype == "float32" else levels(image, dtype)
    largest = 1.0 if dtype == "float32" else np.iinfo(dtype).max
    ours = warp_like_opencv(image, SMALL, SIZE, borderMode=BORDERS[edge], linear_light=False)
    theirs = cv2.warpPerspective(image, SMALL, SIZE, borderMode=BORDERS[edge])
    assert ours.dtype == dtype
    error = (ours.astype(float) - theirs) / largest
    # Wrapping around, texels 0.9 apart are neighbours; OpenCV's weights have 5 bits for integers.
    np.testing.assert_allclose(error, 0.0, atol=0.03 if edge == "wrap" else ROUNDING)


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32", "float64"])
@pytest.mark.parametrize("value", [0, 200, (0.3, 0.2, 0.6), (10, 20, 30, 40), [9, 8, 7]])
def test_a_constant_border_has_its_color(value, dtype):
    image = smooth(channels=3)
    image = levels(image, dtype) if np.dtype(dtype).kind == "u" else image.astype(dtype)
    ours = warp_like_opencv(image, SMALL, SIZE, borderValue=value)
    theirs = cv2.warpPerspective(image, SMALL, SIZE, borderValue=value)  # a number: of blue alone
    beyond = outside(SMALL, SHAPE)
    assert beyond.mean() > 0.1
    np.testing.assert_allclose(ours[beyond], theirs[beyond], rtol=1e-7)  # float64 by float32


def test_a_constant_border_of_gray_is_one_number():
    image = smooth()
    ours = warp_like_opencv(image, SMALL, SIZE, borderValue=0.25)
    theirs = cv2.warpPerspective(image, SMALL, SIZE, borderValue=0.25)
    beyond = outside(SMALL, SHAPE)
    np.testing.assert_array_equal(ours[beyond], theirs[beyond])


@pytest.mark.parametrize(("value", "level"), [(-5, 0), (76.6, 77), (300, 255)])
def test_a_border_s_color_is_rounded_and_clipped(value, level):
    ours = warp_like_opencv(levels(smooth(), "uint8"), SMALL, SIZE, borderValue=value)
    assert ours[0, 0] == level


@pytest.mark.parametrize("matrix", [SMALL, np.array([[1, 0, 20], [0, 1, 15], [0, 0, 1.0]])])
@pytest.mark.parametrize("channels", [None, 3])
def test_a_border_may_be_not_a_number(channels, matrix):
    image = smooth(channels=channels)
    ours = warp_like_opencv(image, matrix, SIZE, borderValue=(np.nan,) * 3)
    assert np.isnan(ours[outside(matrix, SHAPE)]).all()
    assert np.isfinite(ours[inside(matrix, SHAPE)]).all()


def test_the_border_meets_the_picture_in_light():
    image = np.full((4, 4), 255, np.uint8)
    half = np.array([[1, 0, 0.5], [0, 1, 0.0]])
    in_light = warp_like_opencv(image, half, (6, 4), linear_light=True)
    assert in_light[1].tolist() == [188, 255, 255, 255, 188, 0]
    encoded = warp_like_opencv(image, half, (6, 4))  # as OpenCV does
    assert encoded[1].tolist() == [128, 255, 255, 255, 128, 0]
    gray = warp_like_opencv(image, half, (6, 4), borderValue=255)
    np.testing.assert_array_equal(gray, 255)


@pytest.mark.parametrize("dtype", ["uint8", "float32"])
@pytest.mark.parametrize("channels", [None, 3])
def test_under_a_transparent_border_the_target_shows_through(rng, channels, dtype):
    image = smooth(channels=channels)
    image = levels(image, dtype) if dtype == "uint8" else image
    dst = (255 * rng.random(SHAPE + image.shape[2:])).astype(dtype)
    before = dst.copy()
    ours = warp_like_opencv(image, SMALL, SIZE, dst=dst, borderMode=cv2.BORDER_TRANSPARENT)
    np.testing.assert_array_equal(dst, ours)  # as OpenCV does
    theirs = cv2.warpPerspective(image, SMALL, SIZE, dst=before, borderMode=cv2.BORDER_TRANSPARENT)
    beyond = outside(SMALL, SHAPE)
    np.testing.assert_array_equal(ours[beyond], theirs[beyond])
    np.testing.assert_array_equal(
        ours[inside(SMALL, SHAPE)], warp_like_opencv(image, SMALL, SIZE)[inside(SMALL, SHAPE)]
    )


def test_under_a_transparent_border_nothing_is_black():
    ours = warp_like_opencv(smooth(), SMALL, SIZE, borderMode=cv2.BORDER_TRANSPARENT)
    np.testing.assert_array_equal(ours, warp_like_opencv(smooth(), SMALL, SIZE))


@pytest.mark.parametrize("matrix", [SMALL, np.eye(3)], ids=["small", "identity"])
def test_gaps_are_kept(matrix):
    image = smooth(channels=2)
    image[6:9, 6:9, 1] = np.nan
    ours = warp_like_opencv(image, matrix, SIZE, borderValue=7.0)
    x, y, _ = matrix @ (7.0, 7.0, 1.0)
    assert np.isnan(ours[round(y), round(x), 1])
    assert np.isfinite(ours[..., 0]).all()
    lost = np.isnan(ours[..., 1]).sum()
    area = 9 * abs(np.linalg.det(matrix))
    assert abs(lost - area) < 0.1 * area  # gaps keep their size


@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float16", "float32", "float64"])
@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4, 5])
def test_a_shift_by_whole_pixels_is_opencv_s_bit_for_bit(channels, dtype):
    image = smooth(channels=channels)
    image = levels(image, dtype) if np.dtype(dtype).kind == "u" else image.astype(dtype)
    ours = warp_like_opencv(image, [[1, 0, 3], [0, 1, -2]], (20, 19), borderValue=(9,) * 4)
    expected = np.full((19, 20, *image.shape[2:]), 9, dtype)
    expected[:13, 3:] = image[2:]
    np.testing.assert_array_equal(ours, expected[..., 0] if channels == 1 else expected)
    assert ours.dtype == image.dtype


def test_a_fourth_channel_is_no_opacity():
    image = np.full((8, 8, 4), [200, 100, 50, 0], np.uint8)
    ours = warp_like_opencv(image, np.diag([2.5, 2.5, 1.0]), (16, 16))
    np.testing.assert_array_equal(ours[4:12, 4:12], image[:1, :1].repeat(8, 0).repeat(8, 1))


@pytest.mark.parametrize("method", ["bilinear", "points", "splats", Hybrid(quality=3.0)])
def test_any_method_will_do(method):
    ours = warp_like_opencv(smooth(channels=3), SMALL, SIZE, method=method)
    assert ours.shape == (80, 90, 3)


def test_a_shrunk_picture_is_antialiased_where_opencv_s_is_not(record):
    image = np.tile(np.float32([0, 1]), (64, 32))
    matrix = np.diag([0.13, 0.13, 1.0])
    middle = np.s_[2:-2, 2:-2]
    ours = warp_like_opencv(image, matrix, (8, 8))[middle]
    theirs = cv2.warpPerspective(image, matrix, (8, 8))[middle]
    record.error("ours", np.abs(ours - 0.5).max())  # a pixel holds 7.7 stripes
    assert np.abs(theirs - 0.5).max() > 0.4


@pytest.mark.parametrize("flags", [5, 6, 7])
def test_other_interpolations_are_refused(flags):
    with pytest.raises(ValueError, match=rf"interpolation {flags}: known are cv2.INTER_NEAREST"):
        warp_like_opencv(smooth(), SMALL, SIZE, flags=flags)
    with pytest.raises(cv2.error, match="known are"):  # as scripts of OpenCV expect
        warp_like_opencv(smooth(), SMALL, SIZE, flags=flags)


@pytest.mark.parametrize("border", [6, 99, -1])
def test_other_borders_are_refused(border):
    with pytest.raises(ValueError, match="CONSTANT, REPLICATE, REFLECT, WRAP, REFLECT_101 and"):
        warp_like_opencv(smooth(), SMALL, SIZE, borderMode=border)


@pytest.mark.parametrize("size", [(0, 0), (0, 5), None])
def test_a_size_that_is_not_given_is_the_source_s(size):
    for image in (smooth(), smooth().astype(np.float16)):
        assert warp_like_opencv(image, SMALL, size).shape == image.shape


@pytest.mark.parametrize("size", [(5,), (5, 5, 3), (5.5, 5), 5])
def test_a_size_is_two_whole_numbers(size):
    with pytest.raises(ValueError, match="is not width and height"):
        warp_like_opencv(smooth(), SMALL, size)


@pytest.mark.parametrize(
    "dst", [np.zeros(SIZE, np.float32), np.zeros(90, np.float32), np.zeros(SHAPE, np.uint8)]
)
def test_a_target_of_another_form_is_refused(dst):
    with pytest.raises(ValueError, match=r"the result is float32 of \(80, 90\)"):
        warp_like_opencv(smooth(), SMALL, SIZE, dst=dst, borderMode=cv2.BORDER_TRANSPARENT)


def test_a_color_is_a_row_of_numbers():
    with pytest.raises(ValueError, match="give one number, or 3"):
        warp_like_opencv(smooth(channels=3), SMALL, SIZE, borderValue=[[1, 2, 3]])


@pytest.mark.parametrize("value", [7, (1, 2), (1, 2, 3, 4)])
def test_own_code_has_opencv_s_colors(value):
    image, shrink = smooth(60, 70, channels=3), np.diag([0.3, 0.3, 1.0])
    ours = warp_like_opencv(image, shrink, SIZE, borderValue=value)
    theirs = cv2.warpPerspective(image, shrink, SIZE, borderValue=value)
    np.testing.assert_array_equal(ours[40:, 40:], theirs[40:, 40:])


@pytest.mark.parametrize("dtype", ["datetime64[s]", "object"])
def test_other_types_are_refused(dtype):
    with pytest.raises(ValueError, match="a picture's type is one of uint8, uint16, bool, int8"):
        warp_like_opencv(np.zeros((4, 4), dtype), SMALL, SIZE)


def test_a_singular_matrix_is_refused_but_by_opencv():
    with pytest.raises(ValueError, match="no inverse"):
        warp_like_opencv(smooth().astype(np.float16), np.zeros((3, 3)), SIZE)
    ours = warp_like_opencv(smooth(), np.zeros((3, 3)), SIZE)
    np.testing.assert_array_equal(ours, cv2.warpPerspective(smooth(), np.zeros((3, 3)), SIZE))
