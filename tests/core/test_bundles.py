"""Bundles as rows of words: what is stored is loaded, compiled and not."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from resample.engine.bundles import loaded, rows_of, store
from resample.engine.jit import kernel
from resample.types import Doubles, Flags, Indices


class Part(NamedTuple):
    weight: Doubles
    count: int


class Whole(NamedTuple):
    scale: float
    part: Part
    is_odd: bool
    place: tuple[float, float]
    flag: Flags


def wholes() -> list[Whole]:
    return [
        Whole(1.5 * n, Part(n + np.arange(6.0).reshape(2, 3), -n), n % 2 > 0, (0.5, n + 0.25), flag)
        for n, flag in enumerate(np.arange(12, dtype=np.uint8).reshape(3, 4))
    ]


@kernel
def total(rows: Indices, like: Whole, found: Doubles) -> None:
    for k in range(len(rows)):
        scale, part, is_odd, place, flag = loaded(rows[k], like)
        found[k] = scale + part.weight[1, 0] * part.count + 100 * place[1] + flag[3]
        if is_odd:
            found[k] += 1000


@kernel
def keep(row: Indices, value: Any) -> None:
    store(row, value)


def test_one_kernel_takes_any_number_of_bundles() -> None:
    for count in (1, 3):
        given = wholes()[:count]
        rows, kept = rows_of(given)
        assert len(kept) == 2 * count
        found = np.empty(count)
        total(rows, given[0], found)
        wanted = [
            w.scale + w.part.weight[1, 0] * w.part.count + 100 * w.place[1] + w.flag[3]
            + 1000 * w.is_odd
            for w in given
        ]  # fmt: skip
        assert found.tolist() == wanted
        for row, one in zip(rows, given, strict=True):
            again = loaded(row, given[0])
            assert again[0] == one[0]
            assert again[2:4] == one[2:4]
            assert np.array_equal(again.part.weight, one.part.weight)
            assert np.array_equal(again.flag, one.flag)


def test_numbers_are_stored_as_they_are_loaded() -> None:
    given = ((2.5, -3), (1.0, 2.0), True, 1 << 60)
    one, two = np.zeros((2, 7), np.int64)
    keep(one, given)
    store(two, given)
    assert one.tolist() == two.tolist()
    assert loaded(two, given) == given
    assert one[6] == 0


def test_arrays_of_another_kind_are_converted_and_kept() -> None:
    first = wholes()[0]
    other = first._replace(part=Part(np.asfortranarray(first.part.weight.astype(np.float32)), 1))
    rows, kept = rows_of([first, other])
    assert kept[2].dtype == np.float64
    assert loaded(rows[1], first).part.weight.tolist() == first.part.weight.tolist()
    with pytest.raises(ValueError, match="zip"):
        rows_of([first, first[:4]])
