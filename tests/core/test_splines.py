"""Fields between samples: they pass through these, lie within bounds, and keep their types."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates, spline_filter

from resample.engine.jit import kernel
from resample.engine.rays import coefficients as splines
from resample.engine.rays.coefficients import BRICK, PAD, SLAB
from resample.painting.rays import visible_cells
from resample.painting.splines import spline_of
from resample.types import SplineField
from tests.kernels import run_in_python
from tests.record import Record

BEYOND = 24  # samples of mirror images that the truth goes on for


def coefficients(spline: SplineField) -> NDArray[np.float64]:
    """Of a spline, (Z + 2 PAD, ...), in data units."""
    shape = [count + 2 * PAD for count in spline.shape]
    return spline.zero + spline.scale * spline.coefficient.reshape(shape).astype(np.float64)


def at_samples(spline: SplineField) -> NDArray[np.float64]:
    """Values of a spline where its samples are."""
    field = coefficients(spline)
    for axis in range(3):
        field = np.moveaxis(field, axis, 0)
        count = len(field) - 2 * PAD
        first = PAD - 1
        field = (
            field[first : first + count]
            + 4 * field[first + 1 : first + 1 + count]
            + field[first + 2 : first + 2 + count]
        ) / 6
        field = np.moveaxis(field, 0, axis)
    return field


def truth_at(values: NDArray[np.generic], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cubic spline through samples that are mirrored beyond the ends, at places (3, N)."""
    wide = np.pad(values.astype(np.float64), BEYOND, mode="symmetric")
    return map_coordinates(spline_filter(wide, 3), place + BEYOND, order=3, prefilter=False)


@pytest.mark.parametrize(
    "shape", [(1, 1, 1), (1, 2, 1), (3, 5, 4), (7, 1, 9), (2 * SLAB + 5, 4, 6), (20, 33, 17)]
)
def test_a_field_passes_through_its_samples(shape: tuple[int, int, int]) -> None:
    values = np.random.default_rng(1).normal(size=shape).astype(np.float32)
    spline, _ = spline_of(values)
    assert np.abs(at_samples(spline) - values).max() < 2e-6


def test_planes_that_are_filtered_apart_join() -> None:
    values = np.random.default_rng(2).random((3 * SLAB, 5, 4)).astype(np.float32)
    spline, _ = spline_of(values)
    wide = spline_filter(np.pad(values.astype(np.float64), BEYOND, mode="symmetric"), 3)
    inner = wide[BEYOND:-BEYOND, BEYOND:-BEYOND, BEYOND:-BEYOND]
    found = coefficients(spline)[PAD:-PAD, PAD:-PAD, PAD:-PAD]
    assert np.abs(found - inner).max() < 1e-5


def test_what_lies_beyond_the_ends_is_mirrored() -> None:
    spline, _ = spline_of(np.random.default_rng(3).random((5, 6, 7)).astype(np.float32))
    field = coefficients(spline)
    inner = field[PAD:-PAD, PAD:-PAD, PAD:-PAD]
    np.testing.assert_array_equal(field, np.pad(inner, PAD, mode="symmetric"))


def test_sharpness_leads_from_samples_to_coefficients() -> None:
    values = np.random.default_rng(4).random((9, 8, 7)).astype(np.float32)
    smooth, half, sharp = (coefficients(spline_of(values, s)[0]) for s in (0.0, 0.5, 1.0))
    inner = (slice(PAD, -PAD),) * 3
    np.testing.assert_allclose(smooth[inner], values, atol=1e-6)
    np.testing.assert_allclose(half, 0.5 * (smooth + sharp), atol=1e-6)


@pytest.mark.parametrize("contrast", [1, 200])
def test_sixteen_bits_hold_a_field_of_eight(contrast: int) -> None:
    values = (np.random.default_rng(5).random((20, 21, 22)) * contrast + 20).astype(np.uint8)
    short, exact = spline_of(values)[0], spline_of(values.astype(np.float32))[0]
    assert short.coefficient.dtype == np.uint16
    error = np.abs(coefficients(short) - coefficients(exact)).max()
    span = float(values.max()) - float(values.min())
    assert error <= 0.51 * short.scale + 1e-4
    assert short.scale <= 28.001 * max(span, 1.0) / 65535


def test_peaks_that_are_too_steep_for_sixteen_bits_get_wider_steps(record: Record) -> None:
    checker = np.indices((12, 12, 12)).sum(axis=0) % 2 * 255
    spline, _ = spline_of(checker.astype(np.uint8))
    record.error("largest", np.abs(at_samples(spline) - checker).max())


@pytest.mark.parametrize(
    "dtype",
    [
        pytest.param("i1", marks=pytest.mark.sweep),
        *("?", "u1", ">u2", "<i2", ">i4", "u4", "f2", "f4", ">f4", "f8", "i8"),
    ],
)
def test_types_give_what_their_values_give(dtype: str) -> None:
    values = np.random.default_rng(6).integers(0, 2 if dtype == "?" else 100, (7, 8, 9))
    spline, bounds = spline_of(values.astype(dtype))
    exact, limits = spline_of(values.astype(np.float32))
    bits = 0.51 * spline.scale if spline.coefficient.dtype == np.uint16 else 0.0
    assert np.abs(coefficients(spline) - coefficients(exact)).max() <= bits + 1e-4
    assert np.abs(bounds.least - limits.least).max() <= bits + 1e-4


def test_layouts_do_not_matter() -> None:
    values = np.random.default_rng(7).random((12, 10, 8)).astype(np.float32)
    turned = np.asfortranarray(values)
    part = np.zeros((24, 10, 8), np.float32)
    part[::2] = values
    fixed = values.copy()
    fixed.setflags(write=False)
    expected = spline_of(values)[0].coefficient
    for given in (turned, part[::2], fixed):
        np.testing.assert_array_equal(spline_of(given)[0].coefficient, expected)


@pytest.mark.sweep
@pytest.mark.parametrize("dtype", ["u1", "f4"])
def test_bounds_of_bricks_hold_and_are_tight(dtype: str) -> None:
    rng = np.random.default_rng(8)
    values = (rng.random((21, 13, 18)) * 200).astype(dtype)
    _, bounds = spline_of(values)
    shape = np.array(values.shape)
    place = rng.random((3, 100_000)) * shape[:, None] - 0.5
    value = truth_at(values, place)
    brick = tuple(np.floor(place + 1).astype(int) // BRICK)
    assert (value >= bounds.least[brick] - 0.05).all()
    assert (value <= bounds.greatest[brick] + 0.05).all()
    # Bernstein coefficients overestimate, but not by much.
    least = np.full(bounds.least.shape, np.inf)
    np.minimum.at(least, brick, value)
    seen = np.isfinite(least)
    slack = (least - bounds.least)[seen]
    assert np.median(slack) < 0.25 * np.ptp(value)


def test_cells_are_visible_where_a_value_in_them_is() -> None:
    rng = np.random.default_rng(12)
    values = (rng.random((11, 6, 9)) * 200).astype(np.float32)
    spline, bounds = spline_of(values)
    extinction = np.zeros(201, np.float32)
    extinction[30:33] = 1.0
    cells = visible_cells(spline, bounds, extinction, (0.0, 200.0))
    assert cells.shape == bounds.least.shape
    # Look at many places of each cell.
    place = rng.random((3, 400_000)) * np.array(values.shape)[:, None] - 0.5
    value = truth_at(values, place)
    cell = np.floor(place + 1).astype(int)
    shape = tuple(count + 1 for count in values.shape)
    shows = np.zeros(shape, bool)
    np.logical_or.at(shows, tuple(cell), (value >= 29.0) & (value <= 33.0))
    bit = [np.arange(count) for count in shape]
    k, j, i = np.meshgrid(*bit, indexing="ij")
    number = ((k % BRICK * BRICK + j % BRICK) * BRICK + i % BRICK).astype(np.uint64)
    found = (cells[k // BRICK, j // BRICK, i // BRICK] >> number) & np.uint64(1) > 0
    assert found[shows].all()
    assert 0.3 < shows.mean() < found.mean() < 1.4 * shows.mean()


@kernel
def sample(spline: SplineField, place: NDArray[np.float64], found: NDArray[np.float64]) -> None:
    """Values, gradients, least and greatest samples around (N, 6) at places (N, 3)."""
    for n in range(len(place)):
        value, slope = splines.value_and_slope_at(spline, (place[n, 0], place[n, 1], place[n, 2]))
        found[n, 0], found[n, 1], found[n, 2], found[n, 3] = value, slope[0], slope[1], slope[2]
        found[n, 4], found[n, 5] = splines.samples_around(
            spline, (place[n, 0], place[n, 1], place[n, 2])
        )


@pytest.mark.parametrize("dtype", ["u1", "f4"])
def test_values_and_slopes_are_those_of_the_spline(
    dtype: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(13)
    values = (rng.random((6, 7, 9)) * 200).astype(dtype)
    spline, _ = spline_of(values)
    place = rng.random((40, 3)) * np.array(values.shape[::-1]) + 0.5
    spline = spline._replace(coefficient=splines.bundled(spline.coefficient))
    found = np.empty((len(place), 6))
    sample(spline, place, found)
    # Places count from the first coefficient on; those of the truth from the first sample on.
    np.testing.assert_allclose(found[:, 0], truth_at(values, (place - 1)[:, ::-1].T), atol=0.05)
    for n, step in enumerate(1e-3 * np.eye(3), start=1):
        here, there = (truth_at(values, (at - 1)[:, ::-1].T) for at in (place + step, place - step))
        np.testing.assert_allclose(found[:, n], (here - there) / 2e-3, atol=0.2)
    wide = np.pad(values, 1, mode="edge")
    for at, ends in zip(place, found[:, 4:], strict=True):
        i, j, k = at.astype(int)
        around = wide[k : k + 2, j : j + 2, i : i + 2]
        np.testing.assert_allclose(ends, (around.min(), around.max()), atol=0.05)
    # Plain Python computes them without vectors.
    run_in_python(monkeypatch, splines)
    for at, expected in zip(place, found, strict=True):
        value, slope = splines.value_and_slope_at(spline, tuple(at))
        ends = splines.samples_around(spline, tuple(at))
        np.testing.assert_allclose((value, *slope, *ends), expected, atol=2e-3)


def test_even_values_stay_even() -> None:
    spline, bounds = spline_of(np.full((5, 6, 7), 37, np.uint8))
    np.testing.assert_allclose(coefficients(spline), 37, atol=1e-3)
    np.testing.assert_allclose(bounds.least, bounds.greatest, atol=1e-4)


@pytest.mark.parametrize("scale", [1e-30, 1e30])
def test_huge_and_tiny_values_are_kept(scale: float) -> None:
    values = (np.random.default_rng(9).random((6, 7, 8)) * scale).astype(np.float32)
    spline, _ = spline_of(values)
    assert np.abs(at_samples(spline) / scale - values / scale).max() < 1e-5


@pytest.mark.parametrize("huge", [2e37, 1e300])
def test_values_beyond_float32_are_refused(huge: float) -> None:
    with pytest.raises(ValueError, match="below 1e\\+37 in size"):
        spline_of(np.array([[[0.0, huge]]]))


@pytest.mark.parametrize("dtype", ["i8", "f8"])
def test_small_differences_of_large_values_are_kept(dtype: str) -> None:
    values = np.random.default_rng(10).integers(0, 100, (6, 7, 8))
    spline, _ = spline_of((values + 10**12).astype(dtype))
    assert np.abs(at_samples(spline) - 10**12 - values).max() < 1e-3
