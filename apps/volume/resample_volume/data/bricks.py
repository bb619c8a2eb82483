"""Values that stay in their file: read brick by brick, with cached statistics."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.bricks import BrickArray, Step, is_known_by_its_ends
from resample.outofcore.passes import PassContext, in_order
from resample.types import Doubles
from resample_volume.data.scanning import BrickStats, are_few, finite_outside, scanned


class StatisticsCache(Protocol):
    """Stores statistics of values for later commands."""

    def load(self, bricks: "Bricks") -> BrickStats | None:
        """Return the stored statistics; None if there are none that are valid."""

    def state(self) -> str | None:
        """Return the state of the file, which shows changes; None if changes may go unnoticed."""

    def keep(self, bricks: "Bricks", found: BrickStats, state: str | None) -> None:
        """Store the statistics of a file in a state."""


@dataclass(eq=False)
class Bricks(BrickArray):
    """Values (Z, Y, X) of a volume in a file, instead of a NumPy array.

    Statistics of all values are found in one pass and cached.
    """

    shape: tuple[int, int, int]
    replaced: tuple[NDArray[Any], Any] | None = None  # of values that stand for missing ones
    statistics_cache: "StatisticsCache | None" = None  # for later commands
    helpers: Callable[[], PassContext | None] | None = None  # workers of the first pass

    def one_of(self, values: "Bricks", number: int) -> "Bricks":
        """Return the values of one period alone, with their known statistics."""
        layers = values.count[0]
        own = slice(number * layers, (number + 1) * layers)
        values.__dict__["ends"] = tuple(end[own] for end in self.ends)
        return values

    def brick(self, index: Step) -> NDArray[Any]:
        """Return the values of a brick; one known to be constant is not read."""
        if is_known_by_its_ends(self.dtype) and "ends" in self.__dict__:
            least, greatest = (end[index] for end in self.ends)
            if least == greatest:
                shape = [part.stop - part.start for part in self.box(index)]
                return np.full(shape, least, self.dtype)
        return super().brick(index)

    def decoded(self, stored: NDArray[Any]) -> NDArray[Any]:
        """Return values with replacements of missing ones."""
        if self.replaced is None:
            return stored
        padding, by = self.replaced
        is_none = np.isin(stored, padding)
        if self.dtype.kind == "f":
            is_none |= np.isinf(stored)
        return np.where(is_none, np.asarray(by, self.dtype), stored)

    def anew(self) -> Self:
        """Return a copy that counts its own reads, with the known statistics."""
        known = {"ends", "statistics"} & self.__dict__.keys()
        copy = super().anew()
        copy.__dict__.update({name: self.__dict__[name] for name in known})
        return copy

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs; of the statistics only the ends of bricks."""
        known = {"ends": self.ends} if {"ends", "statistics"} & self.__dict__.keys() else {}
        state = super().__getstate__() | known | {"helpers": None}
        return {name: part for name, part in state.items() if name != "statistics"}

    def without(self, padding: Sequence[float], by: Any, _: str = "", /) -> "Bricks":
        """Return a copy in which values for missing ones, and infinite ones, are replaced."""
        return replace(self.anew(), replaced=(np.array(padding), by), found={})

    @cached_property
    def ends(self) -> tuple[Doubles, Doubles]:
        """Return the least and greatest finite value of each brick, as in `BrickStats`."""
        return self.statistics.least, self.statistics.greatest

    @cached_property
    def statistics(self) -> BrickStats:
        """Return statistics of all values; the first call reads each brick."""
        cache = self.statistics_cache
        kept = None if cache is None else cache.load(self)
        if cache is None or kept is not None:
            return kept or scanned(self, self._helped())
        state = cache.state()
        found = scanned(self, self._helped())
        cache.keep(self, found, state)
        return found

    def is_kept(self) -> bool:
        """Whether the statistics are cached, so that no scan is needed."""
        kept = None if self.statistics_cache is None else self.statistics_cache.load(self)
        if kept is not None:
            self.__dict__["statistics"] = kept
        return kept is not None

    def range(self) -> tuple[float, float]:
        """Return the least and greatest finite value; infinite where there is none."""
        least, greatest = self.ends
        return float(least.min()), float(greatest.max())

    def sample(self) -> NDArray[Any]:
        """Return a regular sample, see `step_of`."""
        return self.statistics.some

    def border(self) -> NDArray[Any]:
        """Return all values (N,) on the six sides."""
        return self.statistics.border

    def outside(self, low: float, high: float) -> tuple[NDArray[Any], int]:
        """Return finite values (N,) outside the range of a sample, and the number of infinite."""
        found, infinite = finite_outside([self.statistics.beyond], low, high)
        return found, infinite + self.statistics.infinite

    def codes(self) -> NDArray[np.int64]:
        """Return counts of each value, by its bits, for types of few values."""
        found = self.statistics.codes
        if found is None:
            raise TypeError(f"{self.dtype} has too many values to count each")
        return found

    def unique(self) -> set[int]:
        """Return all whole numbers that occur."""
        if are_few(self.dtype):
            code = np.flatnonzero(self.codes()).astype(f"u{self.dtype.itemsize}")
            return set(code.view(self.dtype).tolist())
        _ = self.ends  # constant bricks need not be read after that
        found: set[int] = set()
        for part in in_order(lambda index: np.unique(self.brick(index)), self.all()):
            found.update(part.tolist())
        return found

    def _helped(self) -> PassContext | None:
        return None if self.helpers is None else self.helpers()
