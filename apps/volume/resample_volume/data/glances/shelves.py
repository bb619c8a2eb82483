"""Bricks that are in memory because they may be asked for again."""

from collections.abc import Callable
from threading import Lock
from typing import Any
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

Step = tuple[int, int, int]  # z, y, x

SHARE = 8  # of the memory that is allowed, inverted, that a shelf takes
OWN = uuid4().hex  # tells shelves of this process from those of others


class Recent:
    """Bricks that were read last, as many as so many bytes hold."""

    def __init__(self, most: int) -> None:
        self.most, self._size = most, 0
        self._kept: dict[Step, NDArray[Any]] = {}
        self._lock = Lock()

    def found(self, index: Step) -> NDArray[Any] | None:
        """A brick, if it is kept; it is the last one then."""
        with self._lock:
            values = self._kept.pop(index, None)
            if values is not None:
                self._kept[index] = values
            return values

    def keep(self, index: Step, values: NDArray[Any]) -> None:
        """Keep a brick in place of those that were read or found before all others."""
        with self._lock:
            if index not in self._kept and values.nbytes <= self.most:
                self._kept[index] = values
                self._size += values.nbytes
            while self._size > self.most:
                self._size -= self._kept.pop(next(iter(self._kept))).nbytes


class Shelf:
    """Bricks that were read first, as many as so many bytes hold, for all later passes.

    Passes go over all bricks in one order, so that those which were read last would be of no use to
    the next one. To other processes a shelf goes without its bricks: there, whoever does parts of
    one command's work shares a shelf of that process. It ends with the process, or as soon as it
    works for another command.
    """

    def __init__(self, most: int, name: tuple[str, str] | None = None) -> None:
        self.most, self.size = most, 0
        self._name = name or (OWN, uuid4().hex)
        self._kept: dict[Step, NDArray[Any]] = {}
        self._lock = Lock()

    def __reduce__(self) -> tuple[Callable[..., "Shelf"], tuple[Any, ...]]:
        return _shelf_here, (self.most, self._name)

    def found(self, index: Step) -> NDArray[Any] | None:
        """A brick, if it is kept."""
        return self._kept.get(index)

    def keep(self, index: Step, values: NDArray[Any]) -> None:
        """Keep a brick if there is room; not if it has one value, as then it is known without."""
        if values.nbytes > self.most - self.size or _is_known(values):
            return
        with self._lock:
            if index not in self._kept and values.nbytes <= self.most - self.size:
                self._kept[index] = values
                self.size += values.nbytes

    def limit(self, most: int) -> None:
        """Hold no more than so many bytes from here on; 0 lets go of all."""
        with self._lock:
            self.most = most
            while self.size > most:
                self.size -= self._kept.popitem()[1].nbytes


_SHELVES: dict[tuple[str, str], Shelf] = {}  # of the command that this process works for
_SHELVES_LOCK = Lock()


def _shelf_here(most: int, name: tuple[str, str]) -> Shelf:
    """Shelf of this process, by a name that another gave; those of other commands end."""
    with _SHELVES_LOCK:
        for other in [other for other in _SHELVES if other[0] != name[0]]:
            del _SHELVES[other]
        shelf = _SHELVES.setdefault(name, Shelf(most, name))
    shelf.limit(most)
    return shelf


def _is_known(values: NDArray[Any]) -> bool:
    return is_known_by_its_ends(values.dtype) and bool(values.min() == values.max())


def is_known_by_its_ends(dtype: np.dtype[Any]) -> bool:
    """Whether values of a type are known where their least is their greatest one."""
    return dtype.kind in "iu" and dtype.itemsize <= 4  # which float64 holds, and none is missing
