"""Caches of bricks: the most recently used, and the first ones pinned."""

from collections.abc import Callable
from threading import Lock
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

Step = tuple[int, int, int]  # z, y, x

SHARE = 8  # memory limit over that of the pinned bricks
OWN = uuid4().hex  # identifies caches of this process


class LruCache:
    """Cache of the most recently used bricks, up to a limit in bytes."""

    def __init__(self, most: int) -> None:
        self.most, self._size = most, 0
        self._kept: dict[Step, NDArray[Any]] = {}
        self._lock = Lock()

    def found(self, index: Step) -> NDArray[Any] | None:
        """Return a brick if cached, and mark it as the most recent."""
        with self._lock:
            values = self._kept.pop(index, None)
            if values is not None:
                self._kept[index] = values
            return values

    def keep(self, index: Step, values: NDArray[Any]) -> None:
        """Cache a brick, and evict the least recently used."""
        with self._lock:
            if index not in self._kept and values.nbytes <= self.most:
                self._kept[index] = values
                self._size += values.nbytes
            while self._size > self.most:
                self._size -= self._kept.pop(next(iter(self._kept))).nbytes


class PinnedCache:
    """Cache that pins the bricks read first, up to a limit in bytes, for all later passes.

    All passes go over the bricks in the same order, so an LRU cache would be useless for the next
    one. It is pickled without its bricks: in another process, all parts of one command's work share
    a cache of that process. That ends with the process, or when it works for another command.
    """

    def __init__(self, most: int, name: tuple[str, str] | None = None) -> None:
        self.most, self.size = most, 0
        self._name = name or (OWN, uuid4().hex)
        self._kept: dict[Step, NDArray[Any]] = {}
        self._lock = Lock()

    def __reduce__(self) -> tuple[Callable[..., "PinnedCache"], tuple[Any, ...]]:
        return _cache_here, (self.most, self._name)

    def found(self, index: Step) -> NDArray[Any] | None:
        """Return a brick if cached."""
        return self._kept.get(index)

    def keep(self, index: Step, values: NDArray[Any]) -> None:
        """Cache a brick if there is room, unless it is constant and so known without reading."""
        if values.nbytes > self.most - self.size or _is_known(values):
            return
        with self._lock:
            if index not in self._kept and values.nbytes <= self.most - self.size:
                self._kept[index] = values
                self.size += values.nbytes

    def limit(self, most: int) -> None:
        """Set the limit in bytes; 0 evicts all."""
        with self._lock:
            self.most = most
            while self.size > most:
                self.size -= self._kept.popitem()[1].nbytes


_CACHES: dict[tuple[str, str], PinnedCache] = {}  # of the command that this process works for
_CACHES_LOCK = Lock()


def _cache_here(most: int, name: tuple[str, str]) -> PinnedCache:
    """Return this process's cache of a command, and drop those of other commands."""
    with _CACHES_LOCK:
        for other in [other for other in _CACHES if other[0] != name[0]]:
            del _CACHES[other]
        cache = _CACHES.setdefault(name, PinnedCache(most, name))
    cache.limit(most)
    return cache


def _is_known(values: NDArray[Any]) -> bool:
    return is_known_by_its_ends(values.dtype) and bool(values.min() == values.max())


def is_known_by_its_ends(dtype: np.dtype[Any]) -> bool:
    """Return whether equal ends tell all values of a type."""
    return dtype.kind in "iu" and dtype.itemsize <= 4  # float64 holds them exactly, and none is NaN
