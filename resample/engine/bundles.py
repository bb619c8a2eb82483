"""Bundles of numbers and arrays as rows of words, so that one kernel takes any number of them.

A word has 64 bits. A number takes one, and an array its address and lengths; its elements
stay where they are. Bundles of one type have rows of one length.
"""

import ctypes
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import when_compiling

Words = NDArray[np.int64]
T = TypeVar("T")


def rows_of(bundles: Sequence[T]) -> tuple[Words, list[Any]]:
    """Words (K, W) of bundles like the first, and the objects that must outlive them."""
    kept: list[Any] = []
    rows = [_words_of(bundle, bundles[0], kept) for bundle in bundles]
    return np.array(rows, np.int64), kept


def _words_of(value: Any, like: Any, kept: list[Any]) -> list[int]:
    """Words of a value, in the layout of another value."""
    if isinstance(like, tuple):
        pairs = zip(value, like, strict=True)
        return [word for pair in pairs for word in _words_of(*pair, kept)]
    if isinstance(like, np.ndarray):
        array = np.ascontiguousarray(value, like.dtype)
        kept.append(array)
        return [array.ctypes.data, *array.shape]
    kind = np.float64 if isinstance(like, float) else np.int64
    return [int(kind(value).view(np.int64))]


def loaded(row: Words, like: T) -> T:
    """Bundle of the type of another one, from its words."""
    found, _ = _value_at(row, 0, like)
    return found  # type: ignore[no-any-return]


def _value_at(row: Words, at: int, like: Any) -> tuple[Any, int]:
    """Value unpacked from the words at a place, and the place after them."""
    if isinstance(like, tuple):
        parts = []
        for one in like:
            part, at = _value_at(row, at, one)
            parts.append(part)
        return type(like)(*parts) if hasattr(like, "_fields") else tuple(parts), at
    if isinstance(like, np.ndarray):
        end = at + 1 + like.ndim
        shape = tuple(row[at + 1 : end].tolist())
        held: Any = (ctypes.c_char * (int(np.prod(shape)) * like.itemsize)).from_address(
            int(row[at])
        )
        return np.frombuffer(held, like.dtype).reshape(shape), end
    kind = np.float64 if isinstance(like, float) else np.int64
    return type(like)(row[at : at + 1].view(kind)[0]), at + 1


def store(row: Words, value: Any) -> None:
    """Write a bundle of numbers to its words."""
    words = _words_of(value, value, [])
    row[: len(words)] = words


@when_compiling
def _compile_as_loads() -> None:
    from resample.engine.compiled import rows

    rows.define(loaded, store)
