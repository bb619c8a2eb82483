import numpy as np
import pytest

from resample import registry
from resample.profiles.interpolation import (
    Bilinear,
    InterpolatingCatmullRom,
    InterpolatingGaussian,
    Nearest,
    Spline,
    prefilter,
    taps,
)
from resample.testing import check_interpolation


@pytest.fixture(params=registry.names("interpolations"))
def installed(request):
    return registry.build("interpolations", request.param)


def interpolated(interpolation, samples, place, extent=0.0):
    """Values of a ring of samples at places, or means around them, by the definition."""
    weights = prefilter(interpolation)
    half = weights.size // 2
    index = np.arange(samples.size)
    shifted = [samples[(index + k) % samples.size] for k in range(-half, half + 1)]
    coefficients = weights.astype(float) @ shifted
    nearest = np.floor(place + 0.5).astype(int)
    weight = taps(interpolation, place - nearest, extent)
    reach = weight.shape[0] // 2
    around = [coefficients[(nearest + k) % samples.size] for k in range(-reach, reach + 1)]
    return (weight * around).sum(axis=0)


def test_every_installed_interpolation_keeps_the_rules(installed):
    check_interpolation(installed)


def test_an_interpolation_passes_through_the_samples(installed, rng):
    samples = rng.random(64)
    found = interpolated(installed, samples, np.arange(64.0), 1.0)  # if it is one of means
    np.testing.assert_allclose(found, samples, atol=2e-6)  # float32 taps, cut at 1e-7


def test_a_constant_stays_constant(installed):
    found = interpolated(installed, np.ones(64), np.linspace(0.0, 63.0, 1001))
    np.testing.assert_allclose(found, 1.0, atol=1e-6)  # float32


@pytest.mark.parametrize(
    "interpolation", [Bilinear(), InterpolatingCatmullRom(), Spline()], ids=repr
)
def test_a_straight_line_stays_straight(interpolation):
    samples = np.arange(256.0)
    place = np.linspace(100.0, 140.0, 777)
    found = interpolated(interpolation, samples, place)
    np.testing.assert_allclose(found, place, atol=2e-4)  # float32 at values of 256


def test_a_spline_is_that_of_scipy(rng):
    from scipy.ndimage import map_coordinates

    samples, place = rng.random(64), np.linspace(0.0, 63.0, 501)
    truth = map_coordinates(samples, [place], order=3, mode="grid-wrap")
    np.testing.assert_allclose(interpolated(Spline(), samples, place), truth, atol=2e-6)


def test_the_nearest_sample_is_taken():
    assert taps(Nearest(), np.array([0.49]))[:, 0].tolist() == [0.0, 1.0, 0.0]


def test_a_gaussian_that_blurs_too_much_is_refused():
    with pytest.raises(ValueError, match="sigma must be between"):
        InterpolatingGaussian(2.0)


def test_a_kernel_that_passes_through_no_samples_is_refused():
    class Wide:
        radius = 4.0

        def __call__(self, distance):
            return np.exp(-0.5 * (distance / 2.0) ** 2)

    with pytest.raises(ValueError, match="blurs too much"):
        prefilter(Wide())
