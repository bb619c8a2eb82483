"""An array is one brick: values say the same of themselves wherever they are."""

from functools import partial

import numpy as np
import pytest

from resample_volume.data.scanning import are_few
from resample_volume.data.values import (
    ArrayValues,
    Bricks,
    bricks_of,
    is_streamed,
    values_of,
    with_bricks,
)
from resample_volume.types import Volume

KINDS = ("uint8", "int8", "uint16", "int16", "int32", "float32", "float64")
SHAPE, SIDE = (5, 7, 6), (2, 3, 4)


def both(kind, rng):
    """Values in memory, and the same in bricks."""
    values = rng.integers(0 if kind[0] == "u" else -90, 90, SHAPE).astype(kind)
    if kind[0] == "f":
        values[0, 0, :3], values[4, 6, 5] = (np.nan, np.inf, -np.inf), 1e4
    return values, Bricks(partial(_part, values), SHAPE, values.dtype, SIDE)


def _part(values, box):
    return values[box].copy()


def sorted_values(parts):
    return np.sort(np.concatenate([np.ravel(part) for part in parts]))


@pytest.mark.parametrize("kind", KINDS)
def test_an_array_and_its_bricks_say_the_same(kind, rng):
    values, bricks = both(kind, rng)
    array, inner = values_of(values), values_of(bricks)
    assert isinstance(array, ArrayValues)
    assert inner is bricks
    assert (array.shape, array.dtype) == (inner.shape, inner.dtype)
    assert array.range() == inner.range()
    np.testing.assert_array_equal(array.whole(), inner.whole())
    np.testing.assert_array_equal(array.sample(), inner.sample())
    np.testing.assert_array_equal(sorted_values(array.parts()), sorted_values(inner.parts()))
    np.testing.assert_array_equal(*(np.sort(one.border()) for one in (array, inner)))
    box = slice(1, 4), slice(0, 7), slice(2, 5)
    np.testing.assert_array_equal(array.read(box), inner.read(box))


@pytest.mark.parametrize("kind", [kind for kind in KINDS if kind[0] != "f"])
def test_whole_numbers_that_occur_are_the_same(kind, rng):
    values, bricks = both(kind, rng)
    assert values_of(values).unique() == bricks.unique() == set(values.ravel().tolist())
    if are_few(values.dtype):
        np.testing.assert_array_equal(values_of(values).codes(), bricks.codes())


@pytest.mark.parametrize("kind", ["float32", "float64"])
def test_values_outside_of_a_sample_are_the_same(kind, rng):
    values, bricks = both(kind, rng)
    low, high = -50.0, 50.0
    (found, infinite), (others, as_many) = (
        one.outside(low, high) for one in (values_of(values), bricks)
    )
    assert infinite == 2
    assert as_many == 2
    finite = values[np.isfinite(values)]
    np.testing.assert_array_equal(np.sort(found), np.sort(finite[(finite < low) | (finite > high)]))
    assert set(others) <= set(found)


@pytest.mark.parametrize("kind", KINDS)
def test_padding_is_replaced_alike(kind, rng):
    values, bricks = both(kind, rng)
    padding, by = [float(values[1, 1, 1])], 7 if kind[0] != "f" else np.nan
    made = values_of(values).without(padding, by, "values")
    np.testing.assert_array_equal(made, bricks.without(padding, by).whole())
    assert padding[0] not in made or padding[0] == by


def test_a_volume_in_memory_has_no_bricks(rng):
    values, bricks = both("uint8", rng)
    volume = Volume(values, np.ones(3), np.zeros(3), np.eye(3), "here")
    assert not is_streamed(volume)
    with pytest.raises(TypeError, match="here is in memory, not in bricks"):
        bricks_of(volume)
    assert bricks_of(with_bricks(volume, bricks)) is bricks
