import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from resample.measuring import quality


@pytest.fixture
def pair(rng) -> tuple[np.ndarray, np.ndarray]:
    """A smooth picture and one with noise."""
    rows, columns = np.mgrid[0:40, 0:48] / 48
    clean = np.stack([rows, columns, 0.5 + 0.5 * np.sin(20 * rows * columns)], axis=2)
    noisy = np.clip(clean + 0.1 * rng.standard_normal(clean.shape), 0.0, 1.0)
    return clean.astype(np.float32), noisy.astype(np.float32)


def naive_ssim(a: np.ndarray, b: np.ndarray) -> float:
    """Wang et al. 2004, equation 13, with their constants, of one channel in 0..1."""
    mean_a, mean_b, ab, aa, bb = (
        gaussian_filter(x, 1.5, truncate=3.5, mode="mirror") for x in (a, b, a * b, a * a, b * b)
    )
    covariance, variance_a, variance_b = ab - mean_a * mean_b, aa - mean_a**2, bb - mean_b**2
    c1, c2 = 0.01**2, 0.03**2
    above = (2 * mean_a * mean_b + c1) * (2 * covariance + c2)
    below = (mean_a**2 + mean_b**2 + c1) * (variance_a + variance_b + c2)
    return float((above / below).mean())


def test_psnr_is_that_of_the_formula(pair):
    clean, noisy = pair
    mean = np.mean((clean.astype(float) - noisy) ** 2)
    assert quality.psnr(*pair) == pytest.approx(10 * math.log10(1 / mean))


def test_psnr_grows_with_the_peak(pair):
    clean, noisy = pair
    assert quality.psnr(clean * 255, noisy * 255, peak=255) == pytest.approx(
        quality.psnr(*pair), abs=1e-4
    )


def test_psnr_of_an_even_difference():
    assert quality.psnr(np.zeros((4, 4)), np.full((4, 4), 0.1)) == pytest.approx(20.0)


def test_a_picture_that_is_not_a_number_is_not_taken_for_equal():
    assert math.isnan(quality.psnr(np.zeros((4, 4)), np.full((4, 4), np.nan)))


def test_psnr_looks_only_at_the_mask():
    a, b = np.zeros((4, 4, 3)), np.zeros((4, 4, 3))
    b[0] = 0.1
    mask = np.zeros((4, 4), bool)
    mask[0] = True
    assert quality.psnr(a, b, mask=mask) == pytest.approx(20.0)
    assert quality.psnr(a, b, mask=~mask) == math.inf


def test_a_mask_has_to_fit_and_to_leave_a_pixel():
    a = np.zeros((4, 4, 3))
    for mask in (np.zeros((4, 4), bool), np.ones((3, 4), bool)):
        with pytest.raises(ValueError, match="a mask of"):
            quality.psnr(a, a, mask=mask)


def test_bytes_do_not_wrap_around():
    a, b = np.zeros((2, 2), np.uint8), np.full((2, 2), 255, np.uint8)
    assert quality.largest(a, b) == quality.rms(a, b) == 255.0


def test_rms_and_largest_are_those_of_the_formulas(pair):
    difference = pair[0].astype(float) - pair[1]
    assert quality.rms(*pair) == pytest.approx(np.sqrt((difference**2).mean()))
    assert quality.largest(*pair) == pytest.approx(np.abs(difference).max())


def test_ssim_is_that_of_the_paper(pair):
    clean, noisy = (picture.astype(float) for picture in pair)
    expected = np.mean([naive_ssim(clean[..., c], noisy[..., c]) for c in range(3)])
    assert quality.ssim(*pair) == pytest.approx(expected, abs=2e-3)  # windows of 11 px, borders


def test_ssim_of_gray_is_that_of_equal_channels(pair):
    gray = [picture[..., 0] for picture in pair]
    rgb = [np.repeat(picture[..., None], 3, axis=2) for picture in gray]
    assert quality.ssim(*gray) == pytest.approx(quality.ssim(*rgb), abs=1e-6)


def test_flip_of_gray_is_that_of_equal_channels(pair):
    gray = [picture[..., 0] for picture in pair]
    rgb = [np.repeat(picture[..., None], 3, axis=2) for picture in gray]
    assert quality.flip(*gray) == quality.flip(*rgb)


def test_flip_of_black_and_white_is_almost_one():
    black = np.zeros((64, 64, 3), np.float32)
    assert quality.flip(black, black + 1.0) == pytest.approx(1.0, abs=0.04)


def test_flip_takes_the_values_as_srgb_encoded():
    # Encoded, 0.5 and 0.6 are 0.214 and 0.319 in linear light; taken as linear they look closer.
    even = np.full((32, 32, 3), 0.5, np.float32)
    assert quality.flip(even, even + 0.1) == pytest.approx(flip_of_linear(0.2140, 0.3185), abs=1e-3)


def flip_of_linear(a: float, b: float) -> float:
    """FLIP of two even pictures of linear light."""
    import OpenImageIO

    buffers = [OpenImageIO.ImageBuf(np.full((32, 32, 3), x, np.float32)) for x in (a, b)]
    for buffer in buffers:
        buffer.specmod().attribute("oiio:ColorSpace", "lin_rec709_scene")
    result = OpenImageIO.ImageBufAlgo.FLIP_diff(*buffers, hdr=0, ppd=67.02)
    return result.spec().get_float_attribute("FLIP:meanerror")


def test_equal_pictures_have_no_difference(pair):
    measured = quality.measure(pair[0], pair[0])
    assert measured == {"psnr": math.inf, "ssim": 1.0, "flip": 0.0, "rms": 0.0, "largest": 0.0}


def test_noise_is_seen_by_every_measure(pair):
    measured = quality.measure(pair[1], pair[0])
    assert 15 < measured["psnr"] < 25
    assert 0 < measured["ssim"] < 0.9
    assert all(measured[name] > 0.02 for name in ("flip", "rms", "largest"))


@pytest.mark.parametrize("name", ["psnr", "ssim", "flip", "rms", "largest", "measure"])
def test_pictures_of_different_sizes_are_refused(name):
    with pytest.raises(
        ValueError, match=r"a picture of \(4, 4, 3\) cannot be compared with one of"
    ):
        getattr(quality, name)(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)))


def test_ssim_is_that_of_opencvs_own_module(pair):
    cv2 = pytest.importorskip("cv2")
    if not hasattr(cv2, "quality"):
        pytest.skip("this build of OpenCV has no module quality")
    one, two = (np.float32(picture) * np.float32(255) for picture in pair)
    wanted = np.mean(cv2.quality.QualitySSIM_compute(one, two)[0][:3])
    assert quality.ssim(*pair) == pytest.approx(wanted, abs=1e-6)
