"""Check that a volume fits in memory, before anything large is allocated."""

import logging
from bisect import bisect_left
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import prod
from typing import Any, NamedTuple, Protocol, Self, cast

import numpy as np
from numpy.typing import NDArray

from resample import memory
from resample.memory import amount
from resample.memory.mapped import array_in_file, array_like, folder, most_of
from resample.outofcore.bricks import Box, BrickArray, Step, is_known_by_its_ends
from resample.outofcore.passes import PassContext, in_order, threads_at_work
from resample.painting.splines import bytes_of_field
from resample.types import Doubles
from resample_volume.data import scanning
from resample_volume.types import Volume

REMEDY = "take a smaller or downsampled volume"


def require_memory(count: int, what: str) -> None:
    """Reject a volume of `count` bytes that cannot fit, see `resample.memory.require_memory`."""
    memory.require_memory(count, what, REMEDY)


def require_beside(values: NDArray[Any], count: int, what: str) -> None:
    """Reject `count` bytes beside values if memory is short; mapped values have a limit."""
    most = most_of(values)
    if most is not None and count > most:
        raise ValueError(
            f"{what} need {memory.amount(count)} of memory, {memory.amount(most)} are left: give "
            "more memory, take a coarser level, or a look that rays show without them"
        )
    require_memory(count, what)


AS_THEY_ARE = (np.dtype(np.float32), np.dtype(np.float64))
SHORT = tuple(np.dtype(name) for name in ("uint8", "int8", "uint16", "int16"))  # exact in float32
CHUNK = 1 << 22  # voxels processed together
SHARE = 1 << 18  # voxels per task of a thread: temporaries stay in the CPU's cache


def slabs(values: NDArray[Any], voxels: int = CHUNK) -> Iterator[NDArray[Any]]:
    """Yield slices (z, Y, X) in order, about so many voxels at a time; views, not copies."""
    step = max(1, voxels // max(1, values[0].size))
    for z in range(0, len(values), step):
        yield values[z : z + step]


class PlaneRange(NamedTuple):
    """Planes of a volume that contain given voxels, with adjacent planes."""

    voxels: slice  # the voxels in them
    values: NDArray[Any]  # (z, Y, X) float32 or float64, read only
    first: int  # flat index of their first value into the volume


def kernel_layers(values: NDArray[Any], index: NDArray[np.int64]) -> Iterator[PlaneRange]:
    """Yield the parts of a volume that contain voxels, as float32 or float64.

    Indices (N,) come in the order of an array or of the painter's bricks. A contiguous volume of
    these types is passed as it is; others are converted some planes at a time.
    """
    from resample_volume.kernels.voxels import BRICK

    if values.dtype in AS_THEY_ARE and values.flags.c_contiguous:
        yield PlaneRange(slice(0, index.size), _frozen(values), 0)
        return
    kind = np.float32 if values.dtype.newbyteorder("=") in (*SHORT, AS_THEY_ARE[0]) else np.float64
    plane, begin = values[0].size, 0
    thick = BRICK * max(1, CHUNK // max(1, BRICK * plane))
    many = thick * plane
    while begin < index.size:
        # Within this many planes voxels come in any order, but before the next planes' voxels.
        number = int(index[begin]) // many
        end = bisect_left(index, number + 1, begin, key=lambda n: n // many)
        above = max(0, number * thick - 1)
        near = values[above : (number + 1) * thick + 1].astype(kind, order="C")
        yield PlaneRange(slice(begin, end), _frozen(near), above * plane)
        begin = end


def _frozen(values: NDArray[Any]) -> NDArray[Any]:
    """Return a read-only view, so that arrays and mapped files share one compiled kernel."""
    given = values.view()
    given.setflags(write=False)
    return given


def side_by_side(job: Callable[[slice], None], count: int) -> None:
    """Run a job on ranges of `count` voxels, in threads if there are many."""
    shares = [slice(n, min(n + SHARE, count)) for n in range(0, count, SHARE)]
    is_alone = min(threads_at_work(), len(shares)) < 2
    for _ in map(job, shares) if is_alone else in_order(job, shares):
        pass


class StatisticsCache(Protocol):
    """Stores statistics of values for later commands."""

    def load(self, bricks: "Bricks") -> scanning.BrickStats | None:
        """Return the stored statistics; None if missing or invalid."""

    def state(self) -> str | None:
        """Return the state of the file, to notice changes; None if they may go unnoticed."""

    def keep(self, bricks: "Bricks", found: scanning.BrickStats, state: str | None) -> None:
        """Store the statistics of a file in a state."""


@dataclass(eq=False)
class Bricks(BrickArray):
    """Values (Z, Y, X) of a volume in a file; statistics are found in one pass and cached."""

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
        """Return the state that another process needs; of the statistics only the bricks' ends."""
        known = {"ends": self.ends} if {"ends", "statistics"} & self.__dict__.keys() else {}
        state = super().__getstate__() | known | {"helpers": None}
        return {name: part for name, part in state.items() if name != "statistics"}

    def without(self, padding: Sequence[float], by: Any, _: str = "", /) -> "Bricks":
        """Return a copy with missing and infinite values replaced."""
        return replace(self.anew(), replaced=(np.array(padding), by), found={})

    @cached_property
    def ends(self) -> tuple[Doubles, Doubles]:
        """Return the least and greatest finite value of each brick, as in `BrickStats`."""
        return self.statistics.least, self.statistics.greatest

    @cached_property
    def statistics(self) -> scanning.BrickStats:
        """Return statistics of all values; the first call reads each brick."""
        cache = self.statistics_cache
        if cache is not None and (kept := cache.load(self)) is not None:
            return kept
        state = None if cache is None else cache.state()
        found = scanning.scanned(self, None if self.helpers is None else self.helpers())
        if cache is not None:
            cache.keep(self, found, state)
        return found

    def is_kept(self) -> bool:
        """Whether the statistics are cached, so that no scan is needed."""
        kept = None if self.statistics_cache is None else self.statistics_cache.load(self)
        if kept is not None:
            self.__dict__["statistics"] = kept
        return kept is not None

    def range(self) -> tuple[float, float]:
        """Return the least and greatest finite value; infinite if none is finite."""
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
        found, infinite = scanning.finite_outside([self.statistics.beyond], low, high)
        return found, infinite + self.statistics.infinite

    def codes(self) -> NDArray[np.int64]:
        """Return counts of each value, by its bits, for types of few values."""
        if (found := self.statistics.codes) is None:
            raise TypeError(f"{self.dtype} has too many values to count each")
        return found

    def unique(self) -> set[int]:
        """Return all whole numbers that occur."""
        if scanning.are_few(self.dtype):
            code = np.flatnonzero(self.codes()).astype(f"u{self.dtype.itemsize}")
            return set(code.view(self.dtype).tolist())
        _ = self.ends  # constant bricks need not be read after that
        found: set[int] = set()
        for part in in_order(lambda index: np.unique(self.brick(index)), self.all()):
            found.update(part.tolist())
        return found


LOG = logging.getLogger("resample")

Stored = NDArray[Any] | Bricks  # values of a volume


@dataclass(frozen=True, eq=False)
class ArrayValues:
    """An array in memory, with the statistics that `Bricks` have."""

    array: NDArray[Any]
    bytes_to_load = 0

    @property
    def shape(self) -> tuple[int, int, int]:
        z, y, x = self.array.shape
        return z, y, x

    @property
    def dtype(self) -> np.dtype[Any]:
        return self.array.dtype

    def read(self, box: Box, /) -> NDArray[Any]:
        return self.array[box]

    def whole(self) -> NDArray[Any]:
        return self.array

    def parts(self) -> Iterator[NDArray[Any]]:
        return slabs(self.array)

    def range(self) -> tuple[float, float]:
        low, high = np.inf, -np.inf
        for chunk in slabs(self.array):
            finite = chunk if self.dtype.kind in "iu" else chunk[np.isfinite(chunk)]
            if finite.size:
                low, high = min(low, float(finite.min())), max(high, float(finite.max()))
        return low, high

    def sample(self) -> NDArray[Any]:
        step = scanning.step_of(self.array.size)
        return self.array[::step, ::step, ::step]

    def border(self) -> NDArray[Any]:
        sides = [self.array.take(end, axis).ravel() for axis in range(3) for end in (0, -1)]
        return np.concatenate(sides)

    def outside(self, low: float, high: float) -> tuple[NDArray[Any], int]:
        return scanning.finite_outside(self.parts(), low, high)

    def codes(self) -> NDArray[np.int64]:
        total = np.zeros(1 << (self.dtype.itemsize * 8), np.int64)
        for part in self.parts():
            total += scanning.count_codes(part, of=prod(self.shape))
        return total

    def unique(self) -> set[int]:
        return {int(value) for part in self.parts() for value in np.unique(part)}

    def without(self, padding: Sequence[float], by: Any, name: str, /) -> NDArray[Any]:
        given, is_whole = self.array, self.dtype.kind in "iu"
        values = array_like(given, given.shape, given.dtype, name)
        for slab, with_padding in zip(slabs(values), slabs(given), strict=True):
            slab[:] = with_padding
            slab[np.isin(slab, padding)] = by
            if not is_whole:
                slab[np.isinf(slab)] = np.nan
        return values


def values_of(stored: Stored) -> ArrayValues | Bricks:
    """Return values with the common interface of arrays and bricks."""
    return stored if isinstance(stored, Bricks) else ArrayValues(stored)


def bricks_of(volume: Volume) -> Bricks:
    """Return the bricks of a volume."""
    stored: Any = volume.values
    if isinstance(stored, np.ndarray):
        raise TypeError(f"{volume.name} is in memory, not in bricks")
    return cast("Bricks", stored)


def with_bricks(volume: Volume, bricks: Any) -> Volume:
    """Return a volume with other bricks, or an object with their interface."""
    return volume._replace(values=bricks)


def is_streamed(volume: Volume) -> bool:
    """Return whether a volume's values stay in their file."""
    return isinstance(volume.values, Bricks)


def as_arrays(volumes: Sequence[Volume]) -> list[Volume]:
    """Apply `as_array` to the volumes of a scene; they share the memory limit by size."""
    sizes = [values_of(volume.values).bytes_to_load for volume in volumes]
    found = []
    for volume, size in zip(volumes, sizes, strict=True):
        bricks: Any = volume.values
        if is_streamed(volume) and bricks.memory is not None:
            bricks = replace(bricks.anew(), memory=bricks.memory * size // sum(sizes))
        found.append(as_array(with_bricks(volume, bricks)))
    return found


def as_array(volume: Volume) -> Volume:
    """Return the volume with its values as an array, in a mapped file if memory is short."""
    if not is_streamed(volume):
        return volume
    bricks = bricks_of(volume)
    size = bricks.bytes_to_load
    made = bytes_of_field(bricks.shape, bricks.dtype)
    if bricks.memory is None or size + made <= bricks.memory:
        require_memory(size, volume.name)
        return volume._replace(values=bricks.whole())
    beside = bytes_of_field(bricks.shape, bricks.dtype, bricks.memory)
    pages = bricks.memory - beside
    if pages < bricks.memory // 4:
        raise ValueError(
            f"{volume.name} is needed as a whole for this, with at least "
            f"{amount(beside * 4 // 3)} of memory and a file for the rest; "
            f"{amount(bricks.memory)} are allowed: give more memory or a coarser level"
        )
    most = pages // 2  # more are in memory until others are released
    values = array_in_file(bricks.shape, bricks.dtype, most, volume.name)
    LOG.info(
        "%s is needed as a whole and does not fit in %s of memory: it and its field are in a "
        "temporary file of %s",
        *(volume.name, amount(bricks.memory), folder()),
    )
    bricks.put_into(values)
    bricks.pin_bricks(0)  # they are all in the file now
    return volume._replace(values=values)
