"""Values that stay in their file: read brick by brick, and looked at once."""

import logging
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

from resample.memory import amount
from resample.memory.mapped import array_in_file, folder
from resample.painting.splines import bytes_of_field
from resample.types import Doubles
from resample.watching import look
from resample_volume.data.glances.looking import Glance, Helpers, looked_at, step_of
from resample_volume.data.glances.shelves import Recent, Shelf, is_known_by_its_ends
from resample_volume.data.memory import require_memory
from resample_volume.data.parts import slabs, threads_at_work
from resample_volume.types import Volume

Step = tuple[int, int, int]  # z, y, x
Box = tuple[slice, slice, slice]  # z, y, x
R = TypeVar("R")

LOG = logging.getLogger("resample")


def with_neighbours(is_chosen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Which bricks (Z, Y, X) are chosen, or touch those that are."""
    found = np.pad(is_chosen, 1)  # so that nothing comes in again on the other side
    for axis, by in product(range(3), (-1, 1)):
        found |= np.roll(found, by, axis)
    return found[1:-1, 1:-1, 1:-1]


def held_together(is_needed: NDArray[np.bool_]) -> int:
    """How many bricks are in memory at once, as slopes ask for those beside: of two layers."""
    layers = is_needed.sum(axis=(1, 2))
    return int((layers[1:] + layers[:-1]).max(initial=layers.max(initial=0)))


class Asked(NamedTuple):
    """Blocks whose voxels are asked for."""

    side: int  # voxels along each axis
    is_asked: NDArray[np.bool_]  # (Z, Y, X) of blocks

    def has_any(self, box: Box) -> bool:
        """Whether some voxel of a box is asked for."""
        z, y, x = (slice(p.start // self.side, (p.stop - 1) // self.side + 1) for p in box)
        return bool(self.is_asked[z, y, x].any())

    def holds(self, at: Sequence[NDArray[np.int64]]) -> NDArray[np.bool_]:
        """Which voxels (N,) are asked for, by their indices along z, y and x."""
        z, y, x = (n // self.side for n in at)
        return self.is_asked[z, y, x]


class Keeper(Protocol):
    """Keeps what is known of values for others who ask for the same."""

    @property
    def store(self) -> object:
        """Where values are."""
        ...

    def load(self, bricks: "Bricks") -> Glance | None:
        """What is kept; None if nothing is that still holds."""
        ...

    def state(self) -> str | None:
        """State of the file, by which a change is noticed; None where it might not be."""
        ...

    def keep(self, bricks: "Bricks", found: Glance, state: str | None) -> None:
        """Keep what was found of a file in a state."""
        ...


@dataclass(eq=False)
class Bricks:
    """Values (Z, Y, X) of a volume in a file, in place of an array of NumPy's.

    What is asked of all values is found in one pass and kept.
    """

    read: Callable[[Box], NDArray[Any]]  # values of a box, from the file
    shape: Step
    dtype: np.dtype[Any]
    side: Step  # voxels of a brick, but for the last along each axis
    replaced: tuple[NDArray[Any], Any] | None = None  # values that stand for none: by what
    found: dict[Any, Any] = field(default_factory=dict)  # see `resample_volume.data.keeping`
    memory: int | None = None  # bytes that what is made of them may take; None: the machine's
    reads: int = 0  # bricks that were read
    most_held: int = 0  # bytes of bricks that were in memory together, at most
    asked: Asked | None = None  # blocks whose voxels are asked for; None: all
    keeper: "Keeper | None" = None  # of what is known of all values
    recent: Recent | None = None  # that need not be read again
    shelf: Shelf | None = None  # of those that were read first, as they are in the file
    helpers: Callable[[], Helpers | None] | None = None  # who look at all values, too
    period: int | None = None  # voxels along z after which bricks begin anew; None: never
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
        """Voxels of a brick."""
        each = self.period or self.shape[0]
        period, n = divmod(index[0], -(-each // self.side[0]))
        sizes, first = (each, *self.shape[1:]), period * each
        z, y, x = (
            slice(n * side, min((n + 1) * side, size))
            for n, side, size in zip((n, *index[1:]), self.side, sizes, strict=True)
        )
        return slice(first + z.start, first + z.stop), y, x

    def one_of(self, values: "Bricks", number: int) -> "Bricks":
        """Values of one period, that are read by themselves, with what is known of them here."""
        layers = values.count[0]
        own = slice(number * layers, (number + 1) * layers)
        values.__dict__["ends"] = tuple(end[own] for end in self.ends)
        return values

    @property
    def limits(self) -> Box:
        """Voxels that there are."""
        z, y, x = (slice(0, size) for size in self.shape)
        return z, y, x

    def all(self) -> list[Step]:
        """Indices of all bricks, z slowest."""
        return [(z, y, x) for z, y, x in product(*map(range, self.count))]

    def brick(self, index: Step) -> NDArray[Any]:
        """Values of a brick; one that is known to have a single value is not read."""
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
        """Values of a brick, from the shelf or the file."""
        values = None if self.shelf is None else self.shelf.found(index)
        if values is None:
            values = self.read(self.box(index))
            with self._lock:
                self.reads += 1
            if self.shelf is not None:
                self.shelf.keep(index, values)
        if self.replaced is None:
            return values
        padding, by = self.replaced
        is_none = np.isin(values, padding)
        if self.dtype.kind == "f":
            is_none |= np.isinf(values)
        return np.where(is_none, np.asarray(by, self.dtype), values)

    def within(self, asked: Asked | None, recent: Recent | None = None) -> "Bricks":
        """The same, of which voxels of some blocks are asked for; it counts its own reads."""
        part = replace(self.anew(), asked=asked, recent=recent)
        part.__dict__["ends"] = self.ends  # of the whole
        return part

    def anew(self) -> "Bricks":
        """The same, which counts its own reads."""
        return replace(self, reads=0, most_held=0, _lock=Lock())

    def __getstate__(self) -> dict[str, Any]:
        """What another process needs, of what was found the ends of bricks alone."""
        known = {"ends": self.ends} if {"ends", "glance"} & self.__dict__.keys() else {}
        left = {name: part for name, part in self.__dict__.items() if name != "glance"}
        return left | known | {"found": {}, "recent": None, "helpers": None, "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=Lock())

    def shelve(self, most: int) -> None:
        """Keep bricks that are read first, as many as so many bytes hold."""
        if self.shelf is None:
            self.shelf = Shelf(most)
        else:
            self.shelf.limit(min(most, self.shelf.most))

    @property
    def shelved(self) -> int:
        """Bytes that bricks take which were read first, at most."""
        return 0 if self.shelf is None else self.shelf.most

    @property
    def noted(self) -> int:
        """Bytes of what is known of all values, if it was found or recalled here."""
        glance = self.__dict__.get("glance", ())
        return sum(np.asarray(part).nbytes for part in glance if part is not None)

    def hold(self, count: int) -> None:
        """Note that so many bricks are in memory."""
        self.most_held = max(self.most_held, count * self.bytes_each)

    @property
    def bytes_each(self) -> int:
        """Of a brick."""
        return prod(map(min, self.side, self.shape)) * self.dtype.itemsize

    def each(self, job: Callable[[Step], R], indices: Sequence[Step]) -> Iterator[R]:
        """What a job gives for bricks, in their order; several are worked on at a time."""
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
        """All values in memory."""
        values = np.empty(self.shape, self.dtype)
        self.put_into(values)
        return values

    def put_into(self, values: NDArray[Any]) -> None:
        """Fill an array with all values."""

        def put(index: Step) -> None:
            values[self.box(index)] = self.brick(index)

        for n, _ in enumerate(self.each(put, self.all())):
            look(n + 1, prod(self.count))

    def without(self, padding: Sequence[float], by: Any) -> "Bricks":
        """The same without values that stand for none, nor infinite ones."""
        return replace(self.anew(), replaced=(np.array(padding), by), found={})

    @cached_property
    def ends(self) -> tuple[Doubles, Doubles]:
        """Least and greatest finite value of each brick, as `Glance` has them."""
        return self.glance.least, self.glance.greatest

    @cached_property
    def glance(self) -> Glance:
        """What is known of all values; the first time, each brick is read."""
        keeper = self.keeper
        kept = None if keeper is None else keeper.load(self)
        if keeper is None or kept is not None:
            return kept or looked_at(self, self._helped())
        state = keeper.state()
        found = looked_at(self, self._helped())
        keeper.keep(self, found, state)
        return found

    def is_kept(self) -> bool:
        """Whether all values need not be looked at, as what is known of them is kept."""
        kept = None if self.keeper is None else self.keeper.load(self)
        if kept is not None:
            self.__dict__["glance"] = kept
        return kept is not None

    def state(self) -> tuple[Any, ...] | None:
        """What tells whether values in a store are the same; None where nothing does."""
        state = None if self.keeper is None else self.keeper.state()
        if self.keeper is None or state is None:
            return None
        form = (self.shape, self.dtype.str, self.side, self.period, self.replaced)
        return (str(self.keeper.store), state, *form)

    def _helped(self) -> Helpers | None:
        return None if self.helpers is None else self.helpers()


Values = NDArray[Any] | Bricks


def as_array(volume: Volume) -> Volume:
    """Volume whose values are an array, also where they are bricks.

    Where memory may not hold them and a field of them, they are in a file of which it holds pages
    (`resample.memory.mapped`): as many as what else a field needs leaves, a quarter at least.

    Raises
    ------
    ValueError
        Neither memory nor a disk holds them, or they cannot be read.
    """
    bricks: Values = volume.values
    if not isinstance(bricks, Bricks):
        return volume
    size = bricks.size * bricks.dtype.itemsize
    made = bytes_of_field(bricks.shape, bricks.dtype)
    if bricks.memory is None or size + made <= bricks.memory:
        require_memory(size, volume.name)
        return volume._replace(values=bricks.whole())
    beside = bytes_of_field(bricks.shape, bricks.dtype, bricks.memory)
    pages = bricks.memory - beside
    if pages < bricks.memory // 4:
        raise ValueError(
            f"{volume.name} is needed as a whole for this: {amount(beside * 4 // 3)} of memory at "
            f"least, and a file for the rest; {amount(bricks.memory)} are allowed: give more "
            "memory or a coarser level, or render it by classify pre and composite"
        )
    values = array_in_file(bricks.shape, bricks.dtype, pages, volume.name)
    LOG.info(
        "%s is needed as a whole, which %s of memory do not hold: it and a field of it are in a "
        "file of %s meanwhile",
        *(volume.name, amount(bricks.memory), folder()),
    )
    bricks.put_into(values)
    return volume._replace(values=values)


def parts(values: Values) -> Iterator[NDArray[Any]]:
    """Values of a volume, a part at a time, in no particular order."""
    if isinstance(values, Bricks):
        yield from values.each(values.brick, values.all())
    else:
        yield from slabs(values)


def sampled(values: Values) -> NDArray[Any]:
    """Some of the values of a volume, evenly spread; see `step_of`."""
    if isinstance(values, Bricks):
        return values.glance.some
    step = step_of(values.size)
    return values[::step, ::step, ::step]
