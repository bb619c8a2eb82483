import numpy as np
import pytest
from scipy.integrate import quad

from resample import registry
from resample.profiles.reconstruction import (
    BSplineKernel,
    GaussianKernel,
    footprint_table,
    ripple,
    variance,
)


@pytest.fixture(params=registry.names("reconstructions"))
def installed(request):
    return registry.build("reconstructions", request.param)


def integrated(function, end, knot):
    return quad(function, 0, end, points=[min(knot, end * 0.999)], epsabs=1e-11)[0]


def mass(reconstruction):
    """Integral over the ball of radius 1 in units of the radius."""

    def shell(r):
        return 4 * np.pi * r**2 * float(reconstruction(np.array(r * reconstruction.radius)))

    return integrated(shell, 1.0, 0.5)


def test_a_kernel_is_zero_from_its_radius_on(installed):
    beyond = np.array([1.0, 1.001, 2.0, 10.0]) * installed.radius
    np.testing.assert_allclose(installed(beyond), 0.0, atol=1e-12)
    assert installed(np.array([0.0])) > 0


def test_a_kernel_keeps_the_shape_of_its_argument(installed):
    distance = np.linspace(0, installed.radius, 12).reshape(3, 4)
    assert installed(distance).shape == (3, 4)


def test_the_footprint_table_holds_line_integrals(installed):
    table, unit = footprint_table(installed), mass(installed)
    peak = float(table.values[0])
    for entry in range(0, table.values.size - 1, 31):
        squared = entry / (table.values.size - 1)
        end = np.sqrt(1 - squared)

        def density(along, squared=squared):
            r = np.sqrt(squared + along**2)
            return float(installed(np.array(r * installed.radius)))

        knot = np.sqrt(max(1e-9, 0.25 - squared))
        truth = 2 * integrated(density, end, knot) / unit
        assert table.values[entry] == pytest.approx(truth, abs=1e-5 * peak)


def test_between_its_entries_the_footprint_table_is_as_good(installed):
    """Read linearly, half-way between entries."""
    table = footprint_table(installed)
    node, weight = np.polynomial.legendre.leggauss(64)
    squared = (np.arange(0, table.values.size - 1, 7) + 0.5) / (table.values.size - 1)
    half = np.sqrt(1 - squared)[:, None]
    r = np.sqrt(squared[:, None] + (half * node) ** 2)
    truth = (installed(r * installed.radius) * weight).sum(axis=1) * half[:, 0] / mass(installed)
    read = np.interp(squared, np.linspace(0, 1, table.values.size), table.values)
    np.testing.assert_allclose(read, truth, atol=1e-5 * table.values[0])


def test_tables_have_the_mass_one(installed):
    squared = np.linspace(0, 1, footprint_table(installed).values.size)
    disk = np.pi * np.trapezoid(footprint_table(installed).values, squared)
    assert disk == pytest.approx(1.0, abs=1e-5)  # dA = π d(r²)


def test_tables_end_at_zero(installed):
    assert footprint_table(installed).values[-1] == 0.0


def test_the_variance_is_the_second_moment_along_an_axis(installed):
    def moment(r):
        return 4 / 3 * np.pi * r**4 * float(installed(np.array(r * installed.radius)))

    truth = integrated(moment, 1.0, 0.5) / mass(installed) * installed.radius**2
    assert variance(installed) == pytest.approx(truth, rel=1e-6)


@pytest.mark.some(1)
@pytest.mark.parametrize(
    ("kernel", "low", "high"),
    [(GaussianKernel(), -0.0037, 0.0076), (BSplineKernel(), -0.0021, 0.0021)],
)
def test_the_ripple_is_as_the_docstring_says(kernel, low, high):
    smallest, largest = ripple(kernel)
    if isinstance(kernel, GaussianKernel):
        assert (smallest, largest) == pytest.approx((low, high), abs=5e-5)  # two digits
    assert low - 5e-5 <= smallest <= 0 <= largest <= high + 5e-5


@pytest.mark.sweep
def test_the_defaults_are_flat_within_a_percent(installed):
    smallest, largest = ripple(installed)
    assert -0.01 < smallest <= 0 <= largest < 0.01


@pytest.mark.sweep
def test_another_width_ripples_more():
    best = max(np.abs(ripple(GaussianKernel())))
    for sigma in (0.5, 0.6, 0.7, 0.8):
        assert max(np.abs(ripple(GaussianKernel(sigma)))) > best


@pytest.mark.parametrize("number", [0.0, -1.0, np.nan, np.inf])
def test_kernels_of_no_width_are_refused(number):
    for make in (
        lambda: GaussianKernel(sigma=number),
        lambda: GaussianKernel(radius=number),
        lambda: BSplineKernel(radius=number),
    ):
        with pytest.raises(ValueError, match="above 0"):
            make()


def test_a_kernel_without_mass_is_refused():
    class Nothing:
        radius = 1.0

        def __call__(self, distance):
            return np.zeros_like(distance)

    with pytest.raises(ValueError, match="above 0"):
        footprint_table(Nothing())


@pytest.mark.parametrize("radius", [65.0, 1e9])
def test_a_kernel_that_would_never_end_is_refused(radius):
    with pytest.raises(ValueError, match="above 0 to 64 are allowed"):
        footprint_table(BSplineKernel(radius))
