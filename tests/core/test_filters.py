import dataclasses
from functools import partial

import numpy as np
import pytest

from resample import registry
from resample.profiles.filters import (
    Box,
    CatmullRom,
    Gaussian,
    Lanczos,
    Mitchell,
    Tent,
    profile_table,
    table,
)
from resample.profiles.subpixels import subpixels_of
from resample.testing import check_filter

CONTINUOUS = [
    Tent(),
    Tent(2.5),
    Gaussian(lowered=True),
    Gaussian(0.7, 1.0, lowered=True),
    Mitchell(),
    CatmullRom(),
    Lanczos(),
]


@pytest.fixture(params=registry.names("filters"))
def installed(request):
    return registry.build("filters", request.param)


def read(profile, distance):
    """Value of a table, 0 beyond its end."""
    places = np.linspace(0.0, profile.extent, profile.values.size)
    return np.interp(distance, places, profile.values, right=0.0)


def test_every_installed_filter_keeps_the_rules(installed):
    check_filter(installed)


def test_a_table_has_the_integral_one(installed):
    profile = table(installed)
    step = profile.extent / (profile.values.size - 1)
    assert 2 * np.trapezoid(profile.values, dx=step) == pytest.approx(1.0, abs=1e-6)  # float32


def test_a_table_ends_at_zero(installed):
    assert table(installed).values[-1] == 0.0


def test_a_table_follows_its_filter(installed):
    profile = table(installed)
    distance = np.linspace(0.0, installed.radius * 0.9995, 20001)
    weight = installed(distance)
    scale = profile.values[0] / weight[0]
    # Largest second derivative: 4 of the peak (Gaussian), so 4 h² / 8 at h = 1.5e-3.
    np.testing.assert_allclose(read(profile, distance), weight * scale, atol=5e-6)


def test_a_table_is_float32_with_one_entry_per_step(installed):
    profile = table(installed, steps=100)
    assert profile.values.dtype == np.float32
    assert profile.values.shape == (101,)


@pytest.mark.parametrize("continuous", CONTINUOUS, ids=repr)
def test_a_continuous_filter_is_zero_at_the_rim(continuous):
    assert continuous(np.array([continuous.radius])) == pytest.approx(0.0, abs=1e-12)
    assert table(continuous).extent == continuous.radius


def test_a_step_at_the_rim_lies_in_the_middle_of_the_last_interval():
    profile = table(Box(), steps=100)
    assert profile.extent == pytest.approx(0.5 * 100 / 99.5)
    assert read(profile, 0.5) == pytest.approx(0.5)


PARTITIONS = [Box(), Box(1.5), Tent(), Tent(2.0), Mitchell(), Mitchell(1.0, 0.0), CatmullRom()]
SHIFTS = [*np.linspace(0.0, 1.0, 41), 0.5 - 1e-7, 0.5 + 1e-7]  # a pixel's border and its neighbours


@pytest.mark.parametrize("partition", PARTITIONS, ids=repr)
def test_the_weights_of_a_point_in_all_pixels_add_up_to_one(partition):
    profile = table(partition)
    pixel = np.arange(-6, 7)
    sums = [read(profile, np.abs(pixel - shift)).sum() for shift in SHIFTS]
    np.testing.assert_allclose(sums, 1.0, atol=2e-6)  # cubics: table of 1024 steps


@pytest.mark.parametrize("interpolating", [CatmullRom(), Lanczos(), Lanczos(2), Tent()], ids=repr)
def test_an_interpolating_filter_is_one_in_its_pixel_and_zero_in_others(interpolating):
    distance = np.arange(int(interpolating.radius) + 1.0)
    np.testing.assert_allclose(interpolating(distance), distance == 0.0, atol=1e-15)


def test_mitchell_has_the_values_of_the_paper():
    np.testing.assert_allclose(
        Mitchell()(np.array([0.0, 1.0, 2.0])), [16 / 18, 1 / 18, 0], atol=1e-15
    )


def test_a_tent_of_radius_one_interpolates_linearly():
    assert Tent()(np.array([0.25])) == pytest.approx(0.75)


def test_a_gaussian_without_radius_ends_at_four_sigma():
    assert Gaussian(sigma=0.6).radius == pytest.approx(2.4)


def test_a_lowered_gaussian_ends_at_zero():
    assert Gaussian(radius=1.0, lowered=True)(np.array([1.0])) == 0.0


def test_a_gaussian_keeps_its_width_when_cut():
    distance = np.array([0.0, 0.5])
    center, one_sigma = Gaussian(sigma=0.5, radius=3.0)(distance)
    assert one_sigma / center == pytest.approx(np.exp(-0.5), abs=1e-7)  # rim: 1.5e-8


@pytest.mark.parametrize(
    ("construct", "complaint"),
    [
        (lambda: Box(0.0), "radius is a positive number of pixels, not 0.0"),
        (lambda: Tent(-1.0), "radius is a positive number"),
        (lambda: Tent(float("inf")), "radius is a positive number"),
        (lambda: Gaussian(sigma=float("nan")), "sigma is a positive number"),
        (lambda: Gaussian(radius=-2.0), "radius is a positive number"),
        (lambda: Mitchell(b=float("inf")), "b is a finite number"),
        (lambda: Mitchell(c=float("nan")), "c is a finite number"),
        (lambda: Lanczos(a=2.5), "a is a whole number of lobes from 1 to 16, not 2.5"),
        (lambda: Lanczos(a=0), "a is a whole number"),
    ],
)
def test_a_bad_parameter_is_refused(construct, complaint):
    with pytest.raises(ValueError, match=complaint):
        construct()


def test_a_filter_cannot_be_changed():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Gaussian().sigma = 2.0


def test_a_table_of_one_step_is_refused():
    with pytest.raises(ValueError, match="at least 2 steps, not 1"):
        table(Box(), steps=1)


@dataclasses.dataclass(frozen=True)
class Own:
    """A filter with a fault to choose."""

    profile: object
    radius: object = 1.0

    def __call__(self, distance):
        return self.profile(distance)


def test_a_filter_without_mass_has_no_table():
    with pytest.raises(ValueError, match="cannot be scaled to 1"):
        table(Own(np.zeros_like))


def _overwrite(distance):
    distance *= 0.5
    return distance


@pytest.mark.parametrize(
    ("faulty", "complaint"),
    [
        (Own(np.ones_like, radius=0.0), "has the radius 0.0; it must be"),
        (Own(np.ones_like, radius=np.inf), "has the radius inf"),
        (Own(np.ones_like, radius="1"), "has the radius '1'"),
        (Own(np.ones_like, radius=None), "has the radius None"),
        (Own(np.sum), r"gives the shape \(\) for distances"),
        (Own(lambda distance: np.full_like(distance, np.nan)), "not finite"),
        (Own(lambda distance: np.ones(distance.shape, int)), "of type int64"),
        (Own(np.zeros_like), "integrates to 0"),
        (Own(lambda distance: -1.0 - distance), "integrates to -3"),
        (Own(_overwrite), "overwrites the distances"),
        (Own(lambda distance: distance / distance.shape[0]), "different weights"),
        (3.0, "3.0 has no __call__"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_check_filter_names_the_fault(faulty, complaint):
    with pytest.raises(AssertionError, match=complaint):
        check_filter(faulty)


@pytest.mark.parametrize("radius", [65.0, 1e4, 1e9])
def test_a_filter_that_would_never_end_is_refused(radius):
    for use in (table, partial(profile_table, count=4), subpixels_of):
        with pytest.raises(ValueError, match="above 0 to 64 are allowed"):
            use(Box(radius))
