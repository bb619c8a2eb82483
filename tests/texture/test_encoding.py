import numpy as np
import pytest

from resample.colors import from_srgb
from resample_texture.texels.encoding import DTYPES, decoded, encoded, without_gaps
from resample_texture.types import Warped


def levels(dtype):
    """Every level of an integer type, in rows of 256."""
    return np.arange(np.iinfo(dtype).max + 1).astype(dtype).reshape(-1, 256)


def there_and_back(image, **choices):
    texels, encoding = decoded(image, **choices)
    return encoded(Warped(texels, np.ones(image.shape[:2], np.float32)), encoding).image


def picture(dtype, *shape):
    values = np.random.default_rng(7).random(shape)
    is_integer = np.dtype(dtype).kind == "u"
    return (values * np.iinfo(dtype).max if is_integer else values).astype(dtype)


@pytest.mark.parametrize("linear_light", [True, False])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", ">u2"])
def test_every_level_comes_back(dtype, linear_light):
    every = levels(dtype)
    np.testing.assert_array_equal(there_and_back(every, linear_light=linear_light), every)


@pytest.mark.parametrize("channels", [None, 1, 2, 3, 4, 5, 7])
@pytest.mark.parametrize("dtype", DTYPES)
def test_texels_are_planes_of_float32_and_go_back_to_the_picture_s_form(dtype, channels):
    image = picture(dtype, 3, 4, *([] if channels is None else [channels]))
    texels, _ = decoded(image, alpha="none")
    assert texels.shape == (3, 4, channels or 1)
    assert texels.dtype == np.float32
    assert texels.flags.c_contiguous
    back = there_and_back(image, alpha="none")
    assert (back.dtype, back.shape) == (image.dtype, image.shape)
    np.testing.assert_allclose(back, image, rtol=1e-7)  # float64 goes through float32


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_color_of_integers_is_decoded_and_opacity_is_not(dtype):
    texels, _ = decoded(np.full((1, 1, 4), np.iinfo(dtype).max // 2 + 1, dtype))
    half = (np.iinfo(dtype).max // 2 + 1) / np.iinfo(dtype).max
    expected = [*[from_srgb(np.float32(half)) * half] * 3, half]
    np.testing.assert_allclose(texels[0, 0], expected, rtol=1e-6)


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
def test_only_a_fourth_channel_of_four_is_opacity(channels):
    image = picture("uint8", 4, 4, channels)
    np.testing.assert_allclose(decoded(image)[0], from_srgb(image / 255), rtol=1e-5)


def test_floats_are_taken_as_they_are():
    image = picture("float32", 3, 5, 4) - 0.5
    np.testing.assert_array_equal(decoded(image)[0], image)


def test_straight_opacity_multiplies_the_color_of_texels(rng):
    image = rng.random((3, 4, 4), np.float32)
    texels, _ = decoded(image, alpha="straight")
    np.testing.assert_array_equal(texels[..., :3], image[..., :3] * image[..., 3:])
    np.testing.assert_allclose(there_and_back(image, alpha="straight"), image, rtol=1e-6)


def test_without_opacity_a_fourth_channel_is_decoded_like_the_others():
    image = picture("uint8", 4, 4, 4)
    np.testing.assert_allclose(decoded(image, alpha="none")[0], from_srgb(image / 255), rtol=1e-5)


def test_what_was_transparent_stays_black():
    image = np.uint8([[[200, 100, 50, 0]]])
    np.testing.assert_array_equal(there_and_back(image), np.zeros((1, 1, 4)))


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("alpha", ["straight", "premultiplied", "none"])
def test_a_value_that_is_not_finite_makes_a_gap_of_its_texel(rng, alpha, missing):
    image = rng.random((3, 4, 4))
    image[1, 2, 0] = missing
    image[1, 2, 3] = 0.0  # infinity times nothing
    texels, encoding = decoded(image, alpha=alpha)
    assert encoding.has_gaps
    expected = np.ones((3, 4))
    expected[1, 2] = 0.0
    np.testing.assert_array_equal(texels[..., -1], expected)
    np.testing.assert_array_equal(texels[1, 2], np.zeros(5))


def test_what_float32_cannot_hold_is_missing():
    texels, encoding = decoded(np.array([[1e300, 2.0]]))
    assert encoding.has_gaps
    np.testing.assert_array_equal(texels, [[[0.0, 0.0], [2.0, 1.0]]])


def test_large_values_whose_sum_overflows_are_no_gaps():
    assert not decoded(np.full((4, 4), 3e38, np.float32))[1].has_gaps


def test_gaps_lower_the_coverage():
    texels, encoding = decoded(np.array([[1.0, np.nan]]))
    back = without_gaps(Warped(texels, np.float32([[0.5, 0.5]])), encoding)
    np.testing.assert_array_equal(back.coverage, [[0.5, 0.0]])
    assert back.image.shape == (1, 2, 1)


def test_values_beyond_the_type_are_clipped():
    _, encoding = decoded(np.zeros((1, 2), np.uint8))
    texels = np.float32([[[-0.2], [1.3]]])
    image = encoded(Warped(texels, np.ones((1, 2), np.float32)), encoding).image
    np.testing.assert_array_equal(image, [[0, 255]])


def test_half_floats_overflow_to_infinity():
    _, encoding = decoded(np.zeros((1, 1), np.float16))
    image = encoded(Warped(np.full((1, 1, 1), 1e6, np.float32), np.ones((1, 1))), encoding).image
    assert np.isinf(image[0, 0])


def test_the_picture_is_left_as_it_is(rng):
    image = rng.random((3, 4, 4))
    image[0, 0] = np.nan
    before = image.copy()
    there_and_back(image, alpha="straight")
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize(
    "dtype", ["int8", "int32", "int64", "uint32", "bool", "complex64", "object", "S3"]
)
def test_other_types_are_refused(dtype):
    with pytest.raises(ValueError, match=r"uint8, uint16, float16, float32, float64, not .*\w+$"):
        decoded(np.zeros((2, 2), dtype))


@pytest.mark.parametrize("shape", [(), (4,), (0, 4), (4, 0), (4, 4, 0), (1, 4, 4, 3)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match=r"is \(height, width\) or \(height, width, channels\), n"):
        decoded(np.zeros(shape))


def test_an_unknown_alpha_names_the_known_ones():
    with pytest.raises(ValueError, match="'stright'; known: straight, premultiplied, none"):
        decoded(np.zeros((2, 2, 4)), alpha="stright")


def test_a_mask_is_refused_rather_than_forgotten():
    with pytest.raises(ValueError, match="not numbers where it is set"):
        decoded(np.ma.masked_greater(np.ones((2, 2)), 0.5))
