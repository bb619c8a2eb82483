"""Values that stay in their file: read brick by brick, with cached statistics."""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import product
from math import prod
from threading import Lock
from typing import Any, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample.watching import report
from resample_volume.data.parts import threads_at_work
from resample_volume.data.statistics.caches import LruCache, PinnedCache, is_known_by_its_ends
from resample_volume.data.statistics.scanning import (
    BrickStats,
    Helpers,
    are_few,
    finite_outside,
    scanned,
)

Step = tuple[int, int, int]  # z, y, x
Box = tuple[slice, slice, slice]  # z, y, x
R = TypeVar("R")


def with_neighbours(is_chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Dilate a selection of bricks (Z, Y, X) by one brick."""
    found = np.pad(is_chosen, 1)  # so that nothing wraps around
    for axis, by in product(range(3), (-1, 1)):
        found |= np.roll(found, by, axis)
    return found[1:-1, 1:-1, 1:-1]


def bricks_in_memory(is_needed: NDArray[np.bool_]) -> int:
    """Return the number of bricks held at once, as slopes need adjacent ones: two layers."""
    layers = is_needed.sum(axis=(1, 2))
    return int((layers[1:] + layers[:-1]).max(initial=layers.max(initial=0)))


class BrickRequest(NamedTuple):
    """Blocks whose voxels are requested."""

    side: int  # voxels along each axis
    is_requested: NDArray[np.bool_]  # (Z, Y, X) of blocks

    def has_any(self, box: Box) -> bool:
        """Return whether any voxel of a box is requested."""
        z, y, x = (slice(p.start // self.side, (p.stop - 1) // self.side + 1) for p in box)
        return bool(self.is_requested[z, y, x].any())

    def holds(self, at: Sequence[NDArray[np.int64]]) -> NDArray[np.bool_]:
        """Return which voxels (N,) are requested, by indices along z, y and x."""
        z, y, x = (n // self.side for n in at)
        return self.is_requested[z, y, x]


class StatisticsCache(Protocol):
    """Stores statistics of values for later commands."""

    @property
    def store(self) -> object:
        """Path of the values."""
        ...

    def load(self, bricks: "Bricks") -> BrickStats | None:
        """Return the stored statistics; None if there are none that are valid."""
        ...

    def state(self) -> str | None:
        """Return the state of the file, which shows changes; None if changes may go unnoticed."""
        ...

    def keep(self, bricks: "Bricks", found: BrickStats, state: str | None) -> None:
        """Store the statistics of a file in a state."""
        ...


@dataclass(eq=False)
class Bricks:
    """Values (Z, Y, X) of a volume in a file, instead of a NumPy array.

    Statistics of all values are found in one pass and cached.
    """

    read: Callable[[Box], NDArray[Any]]  # reads the values of a box from the file
    shape: Step
    dtype: np.dtype[Any]
    side: Step  # voxels of a brick; the last along each axis may be smaller
    replaced: tuple[NDArray[Any], Any] | None = (
        None  # replacements of values that stand for missing ones
    )
    found: dict[Any, Any] = field(default_factory=dict)  # see `resample_volume.data.memoization`
    memory: int | None = None  # memory limit for all that is made of them; None: the machine's
    reads: int = 0  # counts bricks read
    most_held: int = 0  # peak bytes of bricks in memory together
    request: BrickRequest | None = None  # blocks whose voxels are requested; None: all
    statistics_cache: "StatisticsCache | None" = None  # for later commands
    recent: LruCache | None = None  # cache of bricks
    pinned: PinnedCache | None = None  # pinned bricks, as stored in the file
    helpers: Callable[[], Helpers | None] | None = None  # workers of the first pass
    period: int | None = None  # period along z, voxels, at which bricks restart; None: none
    _lock: Lock = field(default_factory=Lock)

    @property
    def size(self) -> int:
        """Voxels."""
        return prod(self.shape)

    @property
    def count(self) -> Step:
        """Bricks along z, y and x."""
        deep, down, across = self.shape
        each = self.period or deep
        z, y, x = (
            -(-size // side) for size, side in zip((each, down, across), self.side, strict=True)
        )
        return z * (deep // each), y, x

    def box(self, index: Step) -> Box:
        """Return the box of voxels of a brick."""
        each = self.period or self.shape[0]
        period, n = divmod(index[0], -(-each // self.side[0]))
        sizes, first = (each, *self.shape[1:]), period * each
        z, y, x = (
            slice(n * side, min((n + 1) * side, size))
            for n, side, size in zip((n, *index[1:]), self.side, sizes, strict=True)
        )
        return slice(first + z.start, first + z.stop), y, x

    def one_of(self, values: "Bricks", number: int) -> "Bricks":
        """Return the values of one period alone, with their known statistics."""
        layers = values.count[0]
        own = slice(number * layers, (number + 1) * layers)
        values.__dict__["ends"] = tuple(end[own] for end in self.ends)
        return values

    @property
    def limits(self) -> Box:
        """Least and greatest index along each axis."""
        z, y, x = (slice(0, size) for size in self.shape)
        return z, y, x

    def all(self) -> list[Step]:
        """Indices of all bricks, z slowest."""
        return [(z, y, x) for z, y, x in product(*map(range, self.count))]

    def brick(self, index: Step) -> NDArray[Any]:
        """Return the values of a brick; one known to be constant is not read."""
        if is_known_by_its_ends(self.dtype) and "ends" in self.__dict__:
            least, greatest = (end[index] for end in self.ends)
            if least == greatest:
                return np.full(
                    [part.stop - part.start for part in self.box(index)], least, self.dtype
                )
        values = None if self.recent is None else self.recent.found(index)
        if values is None:
            values = self._read(index)
            if self.recent is not None:
                self.recent.keep(index, values)
        return values

    def _read(self, index: Step) -> NDArray[Any]:
        """Read the values of a brick, from the cache or the file."""
        values = None if self.pinned is None else self.pinned.found(index)
        if values is None:
            values = self.read(self.box(index))
            with self._lock:
                self.reads += 1
            if self.pinned is not None:
                self.pinned.keep(index, values)
        if self.replaced is None:
            return values
        padding, by = self.replaced
        is_none = np.isin(values, padding)
        if self.dtype.kind == "f":
            is_none |= np.isinf(values)
        return np.where(is_none, np.asarray(by, self.dtype), values)

    def within(self, request: BrickRequest | None, recent: LruCache | None = None) -> "Bricks":
        """Return a copy restricted to some blocks; it counts its own reads."""
        part = replace(self.anew(), request=request, recent=recent)
        part.__dict__["ends"] = self.ends  # of the whole
        return part

    def anew(self) -> "Bricks":
        """Return a copy that counts its own reads."""
        return replace(self, reads=0, most_held=0, _lock=Lock())

    def __getstate__(self) -> dict[str, Any]:
        """Return what another process needs; of the statistics only the ends of bricks."""
        known = {"ends": self.ends} if {"ends", "statistics"} & self.__dict__.keys() else {}
        left = {name: part for name, part in self.__dict__.items() if name != "statistics"}
        return left | known | {"found": {}, "recent": None, "helpers": None, "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=Lock())

    def pin_bricks(self, most: int) -> None:
        """Pin the bricks read first, up to a limit in bytes."""
        if self.pinned is None:
            self.pinned = PinnedCache(most)
        else:
            self.pinned.limit(min(most, self.pinned.most))

    @property
    def pinned_bytes(self) -> int:
        """Limit of the pinned bricks in bytes."""
        return 0 if self.pinned is None else self.pinned.most

    @property
    def noted(self) -> int:
        """Bytes of the statistics, if found or loaded here."""
        statistics = self.__dict__.get("statistics", ())
        return sum(np.asarray(part).nbytes for part in statistics if part is not None)

    def hold(self, count: int) -> None:
        """Record the number of bricks in memory."""
        self.most_held = max(self.most_held, count * self.bytes_each)

    @property
    def bytes_each(self) -> int:
        """Bytes of a brick."""
        return prod(map(min, self.side, self.shape)) * self.dtype.itemsize

    def each(self, job: Callable[[Step], R], indices: Sequence[Step]) -> Iterator[R]:
        """Run a job on bricks, several at a time; yield results in the order of the bricks."""
        threads = threads_at_work()
        pool, waiting = ThreadPoolExecutor(threads), deque[Future[R]]()
        try:
            for index in indices:
                waiting.append(pool.submit(job, index))
                if len(waiting) > threads:
                    yield waiting.popleft().result()
            while waiting:
                yield waiting.popleft().result()
        finally:
            pool.shutdown(cancel_futures=True)

    def whole(self) -> NDArray[Any]:
        """Read all values into memory."""
        values = np.empty(self.shape, self.dtype)
        self.put_into(values)
        return values

    def put_into(self, values: NDArray[Any]) -> None:
        """Fill an array with all values."""

        def put(index: Step) -> None:
            values[self.box(index)] = self.brick(index)

        for n, _ in enumerate(self.each(put, self.all())):
            report(n + 1, prod(self.count))

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

    def state(self) -> tuple[Any, ...] | None:
        """Return what identifies the values of a store; None if nothing does."""
        state = None if self.statistics_cache is None else self.statistics_cache.state()
        if self.statistics_cache is None or state is None:
            return None
        form = (self.shape, self.dtype.str, self.side, self.period, self.replaced)
        return (str(self.statistics_cache.store), state, *form)

    @property
    def is_streamed(self) -> bool:
        """Whether the values stay in their file."""
        return True

    @property
    def bytes_to_load(self) -> int:
        """Bytes of all values."""
        return self.size * self.dtype.itemsize

    def parts(self) -> Iterator[NDArray[Any]]:
        """Yield the values of all bricks."""
        return self.each(self.brick, self.all())

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
        for part in self.each(lambda index: np.unique(self.brick(index)), self.all()):
            found.update(part.tolist())
        return found

    def at(self, index: Sequence[NDArray[np.int64]]) -> NDArray[Any]:
        """Return values (N,) at indices along z, y and x; each brick with any is read once."""
        homes = [n // side for n, side in zip(index, self.side, strict=True)]
        home = np.ravel_multi_index(homes, self.count)
        order = np.argsort(home, kind="stable")
        bricks, starts = np.unique(home[order], return_index=True)
        found = np.empty(home.size, self.dtype)
        for number, own in zip(bricks, np.split(order, starts[1:]), strict=True):
            z, y, x = (int(n) for n in np.unravel_index(number, self.count))
            box = self.box((z, y, x))
            within = tuple(n[own] - part.start for n, part in zip(index, box, strict=True))
            found[own] = self.brick((z, y, x))[within]
        return found

    def evidence(self) -> tuple[NDArray[Any], ...]:
        """Return arrays that change with the values, in this process or another."""
        known = self.statistics
        return known.least, known.greatest, known.some, known.border

    def _helped(self) -> Helpers | None:
        return None if self.helpers is None else self.helpers()
