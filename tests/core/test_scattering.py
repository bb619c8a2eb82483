"""Scattered samples on a grid: their mass, their means, and what is refused."""

import numpy as np
import pytest

from resample import Scatter, registry
from resample.engine.surfaces import RIM
from resample.library import FILTER_SIGMA, SIGMA, TURNED, UPRIGHT
from tests import naive

METHODS = ("hybrid", "points", "splats")


def scattered(count=400, seed=3, channels=()):
    """Places well inside 80 × 120 px, values, and Jacobians from a tenth of a pixel to six."""
    rng = np.random.default_rng(seed)
    position = rng.uniform([35, 30], [85, 50], (count, 2))
    turn, size = rng.uniform(0, np.pi, (count, 2)), np.exp(rng.uniform(-2.3, 1.8, (count, 2)))
    rotate = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    first, second = np.moveaxis(rotate, 2, 0)[:, :, :, 0], np.moveaxis(rotate, 2, 0)[:, :, :, 1]
    jacobian = first @ (size[:, :, None] * second)
    return position, rng.normal(size=(count, *channels)), jacobian


def lattice(spacing, size, beyond=0):
    """Centers of the cells of a lattice that tiles a frame (height, width) and what is around."""
    height, width = size
    column = np.arange(-beyond, round(width / spacing) + beyond)
    row = np.arange(-beyond, round(height / spacing) + beyond)
    x, y = np.meshgrid((column + 0.5) * spacing, (row + 0.5) * spacing)
    return np.stack([x.ravel(), y.ravel()], axis=1)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("pixel_filter", registry.names("filters"))
def test_coverage_sums_to_the_areas_of_the_samples(method, pixel_filter):
    position, value, jacobian = scattered()
    coverage = Scatter(method, pixel_filter)(
        position, value, jacobian=jacobian, shape=(80, 120)
    ).coverage
    area = np.abs(np.linalg.det(jacobian)).sum()
    assert coverage.sum(dtype=np.float64) == pytest.approx(area, rel=1e-6)


@pytest.mark.parametrize("spacing", [1, 1 / 2, 1 / 4, 0.4])
def test_a_lattice_of_small_samples_covers_every_pixel_once(spacing):
    size = (24, 32)
    position = lattice(spacing, size)
    result = Scatter()(
        position, np.full(len(position), 7.0), jacobian=np.eye(2) * spacing, shape=size
    )
    np.testing.assert_allclose(result.coverage, 1, atol=1e-6)
    np.testing.assert_allclose(result.value, 7, rtol=1e-6)


@pytest.mark.parametrize("spacing", [1.25, 1.6, 2, 8])
def test_a_lattice_of_splats_covers_every_pixel_once_but_for_their_ripple(spacing):
    size = (40, 80)
    position = lattice(spacing, size, beyond=20)
    result = Scatter()(
        position, np.full(len(position), 7.0), jacobian=np.eye(2) * spacing, shape=size
    )
    # 4 exp(−2 π² σ²) of the Gaussians at σ = 0.6, and exp(−RIM / 2) / (2 π σ²) of where they end.
    np.testing.assert_allclose(result.coverage, 1, atol=3.3e-3 + 1.8e-3)
    np.testing.assert_allclose(result.value, 7, rtol=1e-5)


@pytest.mark.sweep
@pytest.mark.parametrize("spacing", [0.3, 0.5, 0.7, 1.0, 3.0])
def test_a_turned_lattice_covers_every_pixel_within_a_twentieth(spacing):
    turn = np.array([[np.cos(0.5), -np.sin(0.5)], [np.sin(0.5), np.cos(0.5)]])
    position = lattice(spacing, (40, 40), beyond=round(40 / spacing)) @ turn.T
    result = Scatter()(position, np.ones(len(position)), jacobian=spacing * turn, shape=(30, 30))
    np.testing.assert_allclose(result.coverage, 1, atol=0.05)


@pytest.mark.some(1)
@pytest.mark.parametrize("method", METHODS)
def test_points_and_splats_are_those_of_the_obvious_loop(method):
    position, value, jacobian = scattered(60)
    position[:10] -= [35, 30]  # some reach beyond the edges
    longest = {"hybrid": 1.0, "points": np.inf, "splats": 0.0}[method]
    total, coverage = naive.scatter(
        position, value, jacobian, height=60, width=90, sigma=SIGMA, filter_sigma=FILTER_SIGMA,
        rim=RIM, longest=longest, turned=(UPRIGHT, TURNED),
    )  # fmt: skip
    result = Scatter(method)(position, value, jacobian=jacobian, shape=(60, 90))
    np.testing.assert_allclose(result.coverage, coverage, atol=2e-4)  # of a polynomial for exp
    filled = coverage > 1e-2
    mean = total[filled] / coverage[filled]
    np.testing.assert_allclose(result.value[filled], mean, atol=2e-3)
    assert np.isnan(result.value[result.coverage == 0]).all()


@pytest.mark.parametrize("method", METHODS)
def test_neither_order_nor_threads_change_a_bit(method):
    position, value, jacobian = scattered(3000, channels=(5,))
    position[::3] = position[0]  # of one place, so that values have to decide
    order = np.random.default_rng(8).permutation(3000)
    one = Scatter(method)(position, value, jacobian=jacobian, shape=(80, 120), threads=1)
    two = Scatter(method)(
        position[order], value[order], jacobian=jacobian[order], shape=(80, 120), threads=2
    )
    np.testing.assert_array_equal(one.value, two.value)
    np.testing.assert_array_equal(one.coverage, two.coverage)


def test_every_channel_is_what_it_is_alone():
    position, value, jacobian = scattered(channels=(5,))
    scatter = Scatter()
    together = scatter(position, value, jacobian=jacobian, shape=(80, 120))
    for channel in range(5):
        alone = scatter(position, value[:, channel], jacobian=jacobian, shape=(80, 120))
        np.testing.assert_allclose(together.value[..., channel], alone.value, rtol=1e-5, atol=1e-5)


def test_a_disc_has_its_area():
    result = Scatter()([[20.0, 20.0], [19, 22]], [1, 1], radius=[0.3, 3.0], shape=(40, 40))
    area = np.pi * (0.3**2 + 3.0**2)
    assert result.coverage.sum(dtype=np.float64) == pytest.approx(area, rel=1e-6)


def test_samples_of_a_plane_lie_and_spread_as_its_homography_says():
    position, value, jacobian = scattered(50)
    plane = np.array([[1.1, 0.2, -8.0], [0.1, 0.9, 2.0], [1e-3, 2e-3, 0.9]])

    def on_screen(p):
        x, y, depth = plane @ np.array([*p, 1.0])
        return np.array([x, y]) / depth

    step, placed = 1e-5, np.array([on_screen(p) for p in position])
    local = [
        np.stack([(on_screen(p + d) - on_screen(p - d)) / (2 * step) for d in step * np.eye(2)], 1)
        for p in position
    ]
    given = Scatter()(position, value, jacobian=jacobian, plane=plane, shape=(80, 120))
    wanted = Scatter()(placed, value, jacobian=np.array(local) @ jacobian, shape=(80, 120))
    np.testing.assert_allclose(given.coverage, wanted.coverage, atol=1e-4)


def test_what_lies_behind_a_plane_is_left_out():
    plane = np.array([[1.0, 0, 0], [0, 1, 0], [1, 0, 0]])  # the eye lies at x = 0
    position = [[-5.0, 1.0], [0.0, 1.0], [1e-300, 1.0]]
    result = Scatter()(position, [1, 1, 1], radius=1.0, plane=plane, shape=(8, 8))
    assert not result.coverage.any()


def test_a_sample_without_a_value_has_no_weight():
    position, value, jacobian = scattered(channels=(2,))
    missing = value.copy()
    missing[::2, 1], missing[1, 0] = np.nan, np.inf
    kept = np.isfinite(missing).all(axis=1)
    all_given = Scatter()(position, missing, jacobian=jacobian, shape=(80, 120))
    wanted = Scatter()(position[kept], value[kept], jacobian=jacobian[kept], shape=(80, 120))
    np.testing.assert_array_equal(all_given.value, wanted.value)
    np.testing.assert_array_equal(all_given.coverage, wanted.coverage)


@pytest.mark.parametrize("channels", [(), (4,)])
def test_no_samples_leave_an_empty_grid(channels):
    result = Scatter()(np.zeros((0, 2)), np.zeros((0, *channels)), radius=1.0, shape=(3, 5))
    assert result.value.shape == (3, 5, *channels)
    assert np.isnan(result.value).all()
    assert not result.coverage.any()


def test_samples_far_away_leave_nothing_and_vast_ones_fill_the_grid():
    far = [[1e300, 5.0], [-1e300, 5], [5, 1e12], [5, -1e12], [1e19, -1e19]]
    assert not Scatter()(far, np.ones(5), radius=2.0, shape=(10, 10)).coverage.any()
    vast = Scatter()([[5.0, 5.0]], [3.0], jacobian=1e6 * np.eye(2), shape=(10, 10))
    np.testing.assert_allclose(vast.value, 3, rtol=1e-6)
    np.testing.assert_allclose(vast.coverage, 1 / (2 * np.pi * 0.36), rtol=5e-3)  # its peak


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position": np.zeros((3, 3))}, r"positions are \(N, 2\)"),
        ({"value": [1, 2]}, "do not fit 3 positions"),
        ({"value": np.zeros((3, 0))}, "do not fit 3 positions"),
        ({"position": [[0, 0], [np.nan, 0], [0, 0]]}, "a position is not finite"),
        ({"jacobian": np.eye(2)}, "give one of them"),
        ({"radius": None}, "give one of them"),
        ({"radius": -1}, "radius is a number of 0 or more"),
        ({"radius": [1, 2]}, "radius is a number of 0 or more"),
        ({"radius": None, "jacobian": np.eye(3)}, "a jacobian is"),
        ({"radius": 1e7}, "covers more than 1e"),
        ({"radius": None, "jacobian": np.full((2, 2), np.nan)}, "not finite"),
        ({"plane": np.eye(2)}, r"homography \(3, 3\)"),
        ({"shape": (0, 4)}, "at least 1"),
    ],
)
def test_what_does_not_fit_is_refused_in_one_line(changes, message):
    given = {"position": np.zeros((3, 2)), "value": np.ones(3), "radius": 1.0, "shape": (4, 4)}
    with pytest.raises(ValueError, match=message) as refused:
        Scatter()(**{**given, **changes})
    assert "\n" not in str(refused.value)


def test_unknown_choices_are_refused_by_name():
    with pytest.raises(ValueError, match="known are hybrid, points, splats"):
        Scatter("nearest")
    with pytest.raises(LookupError, match="known filters"):
        Scatter(pixel_filter="boxy")
