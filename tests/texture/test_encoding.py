import numpy as np
import pytest

from resample.colors import from_srgb
from resample_texture.texels.encoding import DTYPES, decoded, encoded, mended
from resample_texture.types import Warped


def there_and_back(image, **choices):
    texels, encoding = decoded(image, **choices)
    return shown(texels, np.ones(image.shape[:2], np.float32), encoding)


def shown(texels, coverage, encoding):
    plain = mended(Warped(texels, coverage), encoding.gaps)
    return encoded(plain.image, plain.coverage, encoding, missing=plain.missing)


def picture(dtype, *shape):
    values = np.random.default_rng(7).random(shape)
    is_integer = np.dtype(dtype).kind in "iu"
    return (values * np.iinfo(dtype).max if is_integer else values).astype(dtype)


@pytest.mark.parametrize("linear_light", [True, False])
@pytest.mark.parametrize("dtype", ["uint8", "uint16", ">u2"])
def test_every_level_comes_back(dtype, linear_light):
    every = np.arange(np.iinfo(dtype).max + 1).astype(dtype).reshape(-1, 256)
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
    largest = np.abs(image).max() if image.dtype.kind != "b" else 1.0
    np.testing.assert_allclose(back, image, rtol=0, atol=6e-8 * float(largest))  # float32


@pytest.mark.parametrize("dtype", ["uint8", "uint16"])
def test_color_of_integers_is_decoded_and_opacity_is_not(dtype):
    image = np.full((1, 1, 4), np.iinfo(dtype).max // 2 + 1, dtype)
    texels, _ = decoded(image, linear_light=True)
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
@pytest.mark.parametrize("alpha", ["premultiplied", "none"])
def test_a_value_that_is_not_finite_makes_a_gap_of_its_channel(rng, alpha, missing):
    image = rng.random((3, 4, 4))
    image[1, 2, 0] = missing
    texels, encoding = decoded(image, alpha=alpha)
    assert encoding.gaps == 4
    expected = np.ones((3, 4, 4))
    expected[1, 2, 0] = 0.0
    np.testing.assert_array_equal(texels[..., 4:], expected)
    image[1, 2, 0] = 0.0
    np.testing.assert_array_equal(texels[..., :4], np.float32(image))


@pytest.mark.parametrize("missing", [np.nan, np.inf, -np.inf])
def test_under_straight_opacity_a_gap_is_one_of_the_whole_texel(rng, missing):
    image = rng.random((3, 4, 4))
    image[1, 2, 0] = missing
    image[1, 2, 3] = 0.0  # infinity times nothing
    texels, encoding = decoded(image, alpha="straight")
    assert encoding.gaps == 1
    expected = np.ones((3, 4))
    expected[1, 2] = 0.0
    np.testing.assert_array_equal(texels[..., -1], expected)
    np.testing.assert_array_equal(texels[1, 2], np.zeros(5))


def test_gaps_that_all_channels_share_take_one_channel(rng):
    image = rng.random((3, 4, 3))
    image[1, 2] = np.nan
    assert decoded(image)[0].shape == (3, 4, 4)


@pytest.mark.parametrize("scale", [1e300, 1e-300, 5e-324])
def test_what_float32_cannot_hold_is_counted_in_other_units(scale):
    image = np.array([[3.0, 2.0], [-1.0, np.nan]]) * scale
    texels, encoding = decoded(image)
    assert np.isfinite(texels).all()
    back = shown(texels, np.ones((2, 2), np.float32), encoding)
    np.testing.assert_allclose(back, np.nan_to_num(image), rtol=1e-7)  # of float32


def test_large_values_whose_sum_overflows_are_no_gaps():
    assert not decoded(np.full((4, 4), 3e38, np.float32))[1].gaps


def test_gaps_lower_the_coverage():
    texels, encoding = decoded(np.array([[1.0, np.nan]]))
    back = mended(Warped(texels, np.float32([[0.5, 0.5]])), encoding.gaps)
    np.testing.assert_array_equal(back.coverage, [[0.5, 0.0]])
    assert back.image.shape == (1, 2, 1)


def test_values_beyond_the_type_are_clipped():
    _, encoding = decoded(np.zeros((1, 2), np.uint8))
    texels = np.float32([[[-0.2], [1.3]]])
    image = shown(texels, np.ones((1, 2), np.float32), encoding)
    np.testing.assert_array_equal(image, [[0, 255]])


def test_half_floats_overflow_to_infinity():
    _, encoding = decoded(np.zeros((1, 1), np.float16))
    image = shown(np.full((1, 1, 1), 1e6, np.float32), np.ones((1, 1)), encoding)
    assert np.isinf(image[0, 0])


def test_the_picture_is_left_as_it_is(rng):
    image = rng.random((3, 4, 4))
    image[0, 0] = np.nan
    before = image.copy()
    there_and_back(image, alpha="straight")
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("dtype", ["complex64", "object", "S3", "datetime64[s]"])
def test_other_types_are_refused(dtype):
    with pytest.raises(ValueError, match=r"uint8, uint16, bool, .*, float64, not [\w\[\]|]+$"):
        decoded(np.zeros((2, 2), dtype))


@pytest.mark.parametrize("shape", [(), (4,), (0, 4), (4, 0), (4, 4, 0), (1, 4, 4, 3)])
def test_other_shapes_are_refused(shape):
    with pytest.raises(ValueError, match=r"is \(height, width\) or \(height, width, channels\), n"):
        decoded(np.zeros(shape))


def test_an_unknown_alpha_names_the_known_ones():
    with pytest.raises(ValueError, match="'stright'; known: straight, premultiplied, none"):
        decoded(np.zeros((2, 2, 4)), alpha="stright")


def test_a_mask_is_a_gap(rng):
    image = np.ma.MaskedArray(rng.random((3, 4, 3)), rng.random((3, 4, 3)) > 0.6)
    texels, encoding = decoded(image)
    np.testing.assert_array_equal(texels[..., 3:], ~image.mask)
    np.testing.assert_array_equal(texels[..., :3], np.float32(image.filled(0.0)))
    assert encoding.fill == image.fill_value
