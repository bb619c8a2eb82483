import numpy as np
import pytest

from resample.engine.sorting import FEW, member_of, paired, put_in_order, sort_pairs
from resample.types import FOOTPRINT

COLUMNS = ("y", "x", "extinction", "red", "green", "blue")


def footprints(rng, count, choices=None):
    """Records whose columns take any value, or few so that there are ties."""
    record = np.zeros(count, FOOTPRINT)
    for name in COLUMNS:
        values = rng.uniform(0, 5, count) if choices is None else rng.choice(choices, count)
        record[name] = values
    return record


def ordered(key, record, member):
    given = np.array(member, np.int32)
    put_in_order(given, np.asarray(key, np.float32).view(np.uint32), record)
    return given


def lexsorted(key, record, member):
    """The obvious twin; equal in all columns stay as they come, and cannot be told apart."""
    chosen = record[member]
    columns = [chosen[name] for name in reversed(COLUMNS)]
    return member[np.lexsort((*columns, np.asarray(key, np.float32)[member]))]


def values_of(key, record, member):
    return [(float(key[n]), *(float(record[n][name]) for name in COLUMNS)) for n in member]


SIZES = [0, 1, 2, 3, FEW - 1, FEW, FEW + 1, 300, 5000]


@pytest.mark.parametrize("size", SIZES)
def test_distinct_depths_are_put_in_ascending_order(size, rng):
    key = rng.normal(0, 100, 6000).astype(np.float32)
    record = footprints(rng, 6000)
    member = rng.choice(6000, size, replace=False).astype(np.int32)
    np.testing.assert_array_equal(ordered(key, record, member), lexsorted(key, record, member))


@pytest.mark.parametrize("size", SIZES[2:])
@pytest.mark.parametrize("depths", [1, 3, 40])
def test_samples_of_equal_depth_are_ordered_by_what_they_are(size, depths, rng):
    key = rng.choice(rng.normal(0, 10, depths), 6000).astype(np.float32)
    record = footprints(rng, 6000)
    member = rng.choice(6000, size, replace=False).astype(np.int32)
    np.testing.assert_array_equal(ordered(key, record, member), lexsorted(key, record, member))


@pytest.mark.parametrize("size", [2, FEW, 300])
def test_exact_duplicates_end_side_by_side(size, rng):
    key = rng.choice([1.0, 2.0], 400).astype(np.float32)
    record = footprints(rng, 400, choices=(0.0, 1.0))
    member = rng.integers(0, 400, size).astype(np.int32)
    got, expected = ordered(key, record, member), lexsorted(key, record, member)
    assert values_of(key, record, got) == values_of(key, record, expected)
    np.testing.assert_array_equal(np.sort(got), np.sort(member))


@pytest.mark.parametrize("size", [20, 500])
def test_the_result_does_not_depend_on_the_order_of_members(size, rng):
    key = rng.choice([-1.0, 0.0, 3.0], size).astype(np.float32)
    record = footprints(rng, size, choices=(0.0, 1.0, 2.0))
    first = ordered(key, record, np.arange(size))
    again = ordered(key, record, rng.permutation(size))
    assert values_of(key, record, first) == values_of(key, record, again)


@pytest.mark.parametrize("size", [9, 90])
def test_negative_tiny_huge_and_infinite_depths_are_in_order(size, rng):
    special = [-np.inf, -3e38, -1.0, -1e-45, 0.0, 1e-45, 1.0, 3e38, np.inf]
    key = np.tile(np.array(special, np.float32), size // 9)
    record = footprints(rng, size)
    got = ordered(key, record, rng.permutation(size))
    np.testing.assert_array_equal(key[got], np.sort(key))


@pytest.mark.parametrize("size", [8, 80])
def test_members_in_order_stay_as_they_are(size, rng):
    key = np.arange(size, dtype=np.float32)
    got = ordered(key, footprints(rng, size), np.arange(size))
    np.testing.assert_array_equal(got, np.arange(size))


@pytest.mark.parametrize("form", ["a", "b", "c"])
def test_records_that_differ_in_their_form_only_are_told_apart(form):
    """Spheres that the near plane cuts all stand in the middle of the screen."""
    record = np.zeros(2, FOOTPRINT)
    record[form] = [1.0, 0.0]
    key = np.zeros(2, np.float32)
    np.testing.assert_array_equal(ordered(key, record, [0, 1]), ordered(key, record, [1, 0]))


@pytest.mark.parametrize("span", [1, 2, 2**11, 2**12 + 1, 2**22, 2**32])
@pytest.mark.parametrize("size", [1, FEW, FEW + 1, 3000])
def test_pairs_are_sorted_by_keys_of_any_span(size, span, rng):
    key = (2**32 - span + rng.integers(0, span, size)).astype(np.uint32)
    pair = np.array([paired(*both) for both in zip(key, range(size), strict=True)], np.uint64)
    sort_pairs(pair, np.empty_like(pair))
    np.testing.assert_array_equal([member_of(one) for one in pair], np.argsort(key, kind="stable"))
