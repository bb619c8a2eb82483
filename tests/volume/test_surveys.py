"""What is found in values: their robust range, padding and strays."""

import numpy as np
import pytest

from resample_volume.classification.value_statistics import ends, findings, survey, without_padding
from resample_volume.data.scanning import Histogram, otsu
from resample_volume.inputs import as_volume
from resample_volume.viewing.volumes import histogram


def ball(rng, dtype=np.int16):
    """0 around 1000 around 1800, with noise."""
    z, y, x = np.mgrid[:40, :40, :40] - 19.5
    away = np.sqrt(x**2 + y**2 + z**2)
    values = np.clip((16 - away) * 100, 0, 1000) + np.clip((7 - away) * 100, 0, 800)
    return (values + rng.normal(0, 20, away.shape)).astype(dtype)


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32, np.float64])
def test_strays_are_out_of_the_range(dtype, rng):
    values = ball(rng, dtype)
    clean = survey(as_volume(values.copy()))
    assert clean.is_plain
    values[3, 3, 3], values[30, 2, 2], values[5, 6, 7] = 30000, 9000, -20000
    known = survey(as_volume(values))
    assert known.span == pytest.approx(clean.span, abs=25)  # they took the place of others
    assert (known.stray, known.padding) == (3, ())
    assert known.whole == (-20000, 30000)
    assert findings(known)[0].startswith("3 voxels are far beyond")


@pytest.mark.parametrize("dtype", [np.int16, np.int32, np.float32])
@pytest.mark.parametrize("value", [-32768, 32767])
def test_a_slice_of_padding_is_found_and_left_out(dtype, value, rng):
    values = ball(rng, dtype)
    values[0] = value
    values[7, 7, 7] = -15000
    volume = as_volume(values)
    known = survey(volume)
    assert (known.padding, known.padded, known.stray) == ((value,), 1600, 1)
    clean = without_padding(volume, known).values
    assert volume.values[0, 0, 0] == value  # what is given stays
    assert np.array_equal(clean[1:], values[1:])
    rest = known.low if dtype != np.float32 else np.nan
    assert np.array_equal(clean[0], np.full((40, 40), rest), equal_nan=True)
    assert findings(known)[0] == f"1600 voxels of {value} are taken for padding and left out"


def test_two_kinds_of_padding_are_found(rng):
    values = ball(rng, np.float32)
    values[0], values[-1] = -1e20, 1e20
    known = survey(as_volume(values))
    assert set(known.padding) == {float(np.float32(-1e20)), float(np.float32(1e20))}
    assert known.padded == 3200


@pytest.mark.parametrize("where", ["background", "saturated", "metal", "bytes", "labels"])
def test_what_belongs_to_the_data_is_no_padding(where, rng):
    values = ball(rng)
    if where == "background":  # something was cut out
        values = np.where(values > 500, values + 4000, 0).astype(np.int16)
    elif where == "saturated":
        values = np.minimum(values, 900).astype(np.int16)
    elif where == "metal":
        values[18:22, 18:22, 18:22] = 20000
    elif where == "bytes":
        values = np.where(values > 500, 190 + values % 20, 0).astype(np.uint8)
    else:
        values = np.where(values > 500, 7, -1).astype(np.int16)
    known = survey(as_volume(values))
    assert known.padding == ()
    assert known.is_plain
    assert without_padding(as_volume(values), known).values is values


def test_infinite_values_are_left_out(rng):
    values = ball(rng, np.float32)
    values[0], values[-1, 0, 0] = np.inf, -np.inf
    volume = as_volume(values)
    known = survey(volume)
    assert (known.infinite, known.padding) == (1601, ())
    assert np.isfinite(known.span).all()
    clean = without_padding(volume, known).values
    assert np.isnan(clean[0]).all()
    assert not np.isinf(clean).any()


@pytest.mark.parametrize("dtype", [np.uint8, np.int8, np.uint16, np.int16, np.int32, np.float32])
def test_ranges_are_exact_for_all_types(dtype, rng):
    values = rng.integers(0, 100, (5, 6, 7)).astype(dtype)
    if np.dtype(dtype).kind != "u":
        values -= 50
    known = survey(as_volume(values))
    assert known.whole == (values.min(), values.max())
    assert known.levels.number.sum() == values.size
    assert np.array_equal(known.levels.value, np.unique(values))


@pytest.mark.sweep
def test_a_range_of_many_floats_is_exact_beyond_the_sample(rng):
    values = rng.normal(size=(140, 140, 140)).astype(np.float32)
    values[1, 1, 1], values[3, 3, 3] = 5.9, -5.8  # in no sample of every other voxel
    assert survey(as_volume(values)).whole == (values.min(), values.max())


def test_no_value_at_all_is_a_range_of_0_to_1():
    known = survey(as_volume(np.full((3, 3, 3), np.nan, np.float32)))
    assert (known.span, known.levels.value.size) == ((0.0, 1.0), 0)


@pytest.mark.parametrize(
    ("value", "most", "expected"),
    [
        ([0, 1, 2, 3, 4], 1, (0, 4)),
        ([0, 1, 2, 3, 9], 1, (0, 3)),
        ([-9, 0, 1, 2, 3], 1, (1, 4)),
        ([-9, 0, 1, 2, 9], 1, (1, 3)),
        ([0, 1, 2, 8, 9], 1, (0, 4)),  # two are more than one
        ([0, 1, 2, 8, 9], 2, (0, 2)),
        ([0, 1, 2, 3, 9], 0, (0, 4)),
        ([5], 1, (0, 0)),
    ],
)
def test_ends_are_where_strays_begin(value, most, expected):
    number = np.ones(len(value), np.int64)
    assert ends(np.array(value, float), number, most, 1.0) == expected


def test_thresholds_are_the_best_of_all(rng):
    value = np.sort(rng.choice(60, 25, replace=False)).astype(float)
    number = rng.integers(1, 50, 25)

    def evenness(*limits):
        parts = np.split(np.arange(25), np.searchsorted(value, limits, side="right"))
        means = [np.average(value[part], weights=number[part]) for part in parts if part.size]
        mean = np.average(value, weights=number)
        weights = [number[part].sum() for part in parts if part.size]
        return np.sum(np.array(weights) * (np.array(means) - mean) ** 2)

    levels = Histogram(value, number)
    assert evenness(*otsu(levels)) == pytest.approx(max(evenness(v) for v in value[:-1]))
    best = max(evenness(a, b) for a in value for b in value if a < b)
    assert evenness(*otsu(levels, 3)) == pytest.approx(best)


def test_thresholds_need_values():
    assert otsu(Histogram(np.zeros(1), np.ones(1, np.int64))) == []
    assert otsu(Histogram(np.zeros(0), np.ones(0, np.int64))) == []
    assert otsu(Histogram(np.array([0.0, 1.0]), np.array([5, 5]))) == [0.5]


@pytest.mark.parametrize("span", [(0.0, 10.0), (2.0, 7.0), (3.0, 3.0)])
def test_a_page_s_histogram_counts_the_finite_values_of_a_range(rng, span):
    values = rng.integers(0, 11, (4, 5, 6)).astype(np.float32)
    values[0, 0, 0] = np.nan
    found = histogram(as_volume(values), span)
    assert (found["low"], found["high"]) == span
    assert sum(found["counts"]) == np.count_nonzero((values >= span[0]) & (values <= span[1]))
    assert "scale" not in found
