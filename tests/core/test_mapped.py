"""Arrays in files, of which memory holds some pages."""

import os
import shutil
import time
from collections import namedtuple

import numpy as np
import pytest

from resample.memory import mapped, mapped_memory
from resample.memory.mapped import array_in_file, array_like, is_in_file, most_of

MIB = 1 << 20


@pytest.fixture(autouse=True)
def cache(tmp_path, monkeypatch):
    monkeypatch.setenv("HYBRID_RESAMPLE_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_an_array_in_a_file_is_like_any_other(cache):
    values = array_in_file((3, 4, 5), np.int16, MIB, "values")
    assert (values.shape, values.dtype) == ((3, 4, 5), np.int16)
    assert not values.any()
    values[1] = 7
    part = values[1:, ::2].reshape(-1)
    assert part.sum() == 7 * 10
    assert is_in_file(values)
    assert is_in_file(values[1:].view(np.uint16).reshape(-1))
    assert most_of(values) == MIB
    assert list(cache.iterdir()) == []  # no name, so nothing is left however the process ends


def test_what_is_made_of_values_lies_where_these_do():
    held = np.zeros((2, 2))
    assert not is_in_file(array_like(held, (4,), "f4", "sums"))
    made = array_like(array_in_file((2, 2), "f8", 5 * MIB, "values"), (4,), "f4", "sums")
    assert is_in_file(made)
    assert most_of(made) == 5 * MIB
    assert most_of(held) is None


@pytest.mark.sweep
def test_pages_that_are_not_allowed_are_let_go():
    if not mapped_memory():
        pytest.skip("this platform does not tell what is in memory")
    before = mapped_memory()
    values = array_in_file((64, MIB), np.uint8, 8 * MIB, "values")
    for n in range(64):
        values[n] = n
        time.sleep(0.002)
    deadline = time.monotonic() + 20
    while mapped_memory() - before > 9 * MIB and time.monotonic() < deadline:
        time.sleep(0.01)
    assert mapped_memory() - before <= 9 * MIB
    assert [values[n].min() for n in range(64)] == list(range(64))
    assert [values[n].max() for n in range(64)] == list(range(64))


def test_a_file_ends_with_its_array():
    values = array_in_file((MIB,), np.uint8, MIB, "values")
    kept = values[5:9]
    del values
    assert is_in_file(kept)
    count = len(mapped._held)
    del kept
    assert len(mapped._held) == count - 1


@pytest.mark.sweep
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform has no fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_child_goes_on_with_an_array():
    values = array_in_file((4,), np.uint8, MIB, "values")
    child = os.fork()
    if not child:  # pragma: no cover - another process
        values[1] = 3
        array_in_file((4,), np.uint8, MIB, "more")[0] = 1
        os._exit(0)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    assert values[1] == 3


def test_a_full_disk_is_said(monkeypatch):
    usage = namedtuple("usage", "total used free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(10, 10, 3 * MIB))
    with pytest.raises(ValueError, match=r"engine is .*3.00 MiB are free.*HYBRID_RESAMPLE_CACHE"):
        array_in_file((4, MIB), np.uint8, MIB, "engine")


def test_a_folder_that_is_none_is_said(cache):
    cache.write_text("a file")
    with pytest.raises(ValueError, match=r"cannot be kept in a file of .*exists"):
        array_in_file((4,), np.uint8, MIB, "engine")
