"""Bricks that were read first stay on a shelf, which is never larger than it may be."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from resample.outofcore import bricks as caches
from resample.outofcore.bricks import PinnedCache
from resample_volume.classification.value_statistics import survey, without_padding
from resample_volume.data.values import Bricks
from resample_volume.types import Volume

SIDE = (4, 4, 4)


def counted(values):
    """Bricks of an array, and the corners of those that are read of it."""
    read = []

    def at(box):
        read.append(tuple(part.start for part in box))
        return np.ascontiguousarray(values[box])

    return Bricks(at, values.shape, values.dtype, SIDE), read


@pytest.mark.sweep
@given(st.integers(0, 1200), st.lists(st.integers(0, 26), max_size=60), st.integers(0, 2**32 - 1))
def test_any_shelf_gives_the_values_of_the_file(most, asked, seed):
    values = np.random.default_rng(seed).integers(0, 3, (10, 9, 12)).astype(np.int16)
    values[:4, :4, :4] = 2
    bricks, read = counted(values)
    bricks.pin_bricks(most)
    for number in asked:
        index = tuple(int(n) for n in np.unravel_index(number, (3, 3, 3)))
        assert (bricks.brick(index) == values[bricks.box(index)]).all()
        assert bricks.pinned.size <= most
    assert bricks.reads == len(read)
    kept = sum(part.nbytes for part in bricks.pinned._kept.values())
    assert kept == bricks.pinned.size


def test_bricks_of_one_value_are_not_kept():
    bricks, _ = counted(np.zeros((8, 8, 8), np.uint8))
    bricks.pin_bricks(1000)
    bricks.whole()
    assert bricks.pinned.size == 0


def test_the_same_bricks_serve_values_with_and_without_padding(rng):
    values = rng.integers(0, 100, (8, 8, 8)).astype(np.int16)
    values[rng.random(values.shape) < 0.3] = -2000
    bricks, read = counted(values)
    bricks.pin_bricks(10_000)
    known = Volume(bricks, np.ones(3), np.zeros(3), np.eye(3), "padded")
    shown = without_padding(known, survey(known))
    found = shown.values.whole()
    assert (found[values >= 0] == values[values >= 0]).all()
    assert (found[values < 0] >= 0).all()
    assert len(read) == 8


def test_a_shelf_that_gives_way_keeps_nothing_more(rng):
    bricks, read = counted(rng.integers(0, 100, (8, 8, 8)).astype(np.uint8))
    bricks.pin_bricks(10_000)
    bricks.whole()
    bricks.pin_bricks(20_000)
    assert bricks.pinned.most == 10_000
    bricks.pin_bricks(100)
    assert bricks.pinned.size == 64
    bricks.whole()
    assert bricks.pinned.size == 64
    assert len(read) == 15


def test_other_processes_have_shelves_of_their_own(monkeypatch):
    monkeypatch.setattr(caches, "_CACHES", {})
    first, second = PinnedCache(100, ("a", "1")), PinnedCache(100, ("a", "2"))
    first.keep((0, 0, 0), np.arange(9))
    one = pickle.loads(pickle.dumps(first))
    assert one is not first
    assert one.found((0, 0, 0)) is None
    one.keep((0, 0, 1), np.arange(9))
    two = pickle.loads(pickle.dumps(second))
    again = pickle.loads(pickle.dumps(first))
    assert again is one
    assert two.found((0, 0, 1)) is None
    pickle.loads(pickle.dumps(PinnedCache(100, ("another command", "1"))))
    assert list(caches._CACHES) == [("another command", "1")]
