"""What two values share if and only if they say the same."""

import math
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from resample.files.writing import source_fingerprint
from resample.fingerprints import fingerprint


class Pair(NamedTuple):
    left: object
    right: object


class OtherPair(NamedTuple):
    left: object
    right: object


@dataclass
class Record:
    values: object


class Slotted:
    __slots__ = ("value",)

    def __init__(self, value):
        self.value = value


def one_side(x, y=2):
    return x + y


MAKERS = [
    lambda: None,
    lambda: False,
    lambda: 0,
    lambda: 0.0,
    lambda: -0.0,
    lambda: math.inf,
    lambda: 0j,
    lambda: "0",
    lambda: b"0",
    lambda: "",
    lambda: (),
    lambda: [],
    lambda: {},
    lambda: (1, 2),
    lambda: ((1,), 2),
    lambda: (1, (2,)),
    lambda: ("1", "2"),
    lambda: ("12",),
    lambda: [1, 2],
    lambda: {1: 2},
    lambda: {1: 2, 3: 4},
    lambda: {1, 2},
    lambda: frozenset({1, 2}),
    lambda: Path("a/b"),
    lambda: Pair(1, 2),
    lambda: OtherPair(1, 2),
    lambda: Record((1, 2)),
    lambda: Record([1, 2]),
    lambda: Slotted(1),
    lambda: Slotted(2),
    lambda: Pair,
    lambda: math.sin,
    lambda: one_side,
    lambda: partial(one_side, 1),
    lambda: partial(one_side, y=1),
    lambda: Record(3).__eq__,
    lambda: np.float32(1),
    lambda: np.float64(1),
    lambda: np.dtype("<f4"),
    lambda: np.arange(4),
    lambda: np.arange(4.0),
    lambda: np.arange(4).reshape(2, 2),
    lambda: np.arange(4).reshape(2, 2).T,
    lambda: np.zeros(0),
    lambda: np.array([("a", 1)], dtype=[("name", "U1"), ("count", "i4")]),
    lambda: Pair(np.arange(3), {"deep": [Record(np.eye(2))]}),
]


def test_values_that_say_the_same_share_it_and_no_others_do():
    names = [fingerprint(make()) for make in MAKERS]
    assert None not in names
    assert [fingerprint(make()) for make in MAKERS] == names
    assert len(set(names)) == len(names)


def test_memory_layout_does_not_matter():
    assert fingerprint(np.eye(3)[::2]) == fingerprint(np.eye(3)[::2].copy())


def test_parts_may_be_told_by_something_else():
    def place(part):
        return id(part) if isinstance(part, np.ndarray) else None

    array = np.arange(3)
    assert fingerprint([array], place) == fingerprint([array], place)
    assert fingerprint([array], place) != fingerprint([array.copy()], place)


class Refusing:
    def __reduce__(self):
        raise ValueError("not this one")


def endless():
    items = []
    items.append(items)
    return items


@pytest.mark.parametrize(
    "value",
    [
        lambda: 1,
        partial(lambda: 1),
        (i for i in ()),
        Refusing(),
        endless(),
        np.array([object()]),
        {object, Refusing()},
        [].append,
        np.add,
    ],
    ids=lambda value: type(value).__name__,
)
def test_what_cannot_be_told_is_not(value):
    assert fingerprint([value]) is None


@pytest.mark.sweep
def test_other_processes_find_the_same():
    code = (
        "from resample.fingerprints import fingerprint\n"
        "print(fingerprint([{'b', 'a', 'c'}, frozenset({'x', 'y'}), {'k': 1.5}]))"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True, text=True)
    here = fingerprint([{"b", "a", "c"}, frozenset({"x", "y"}), {"k": 1.5}])
    assert there.stdout.strip() == here


def test_source_code_is_known_by_the_content_of_its_files(tmp_path, monkeypatch):
    (tmp_path / "kept_code").mkdir()
    for name in ("__init__.py", "part.py"):
        (tmp_path / "kept_code" / name).write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    before = source_fingerprint("kept_code"), source_fingerprint("kept_code.part")
    (tmp_path / "kept_code" / "part.py").write_text("x = 1\n")
    source_fingerprint.cache_clear()
    after = source_fingerprint("kept_code"), source_fingerprint("kept_code.part")
    assert all(new != old for new, old in zip(after, before, strict=True))


def test_source_code_that_is_not_there_is_an_error():
    with pytest.raises(ModuleNotFoundError, match="no_such"):
        source_fingerprint("resample.no_such")
