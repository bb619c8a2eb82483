"""Arrays of any dimension in bricks, read on demand: indices, reads counted, caches."""

import mmap
import os
import tempfile
import weakref
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import pairwise, product
from math import prod
from pathlib import Path
from threading import Lock
from typing import Any, Self
from uuid import uuid4
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import claim, folder
from resample.outofcore.passes import in_order
from resample.progress import report

TOKEN = 16  # bytes that tell the file of a command from any other
ALIGNED = 64  # bytes


class SharedBricks:
    """Bricks by number, as many as fit in some bytes.

    Each has its own place, so that no process waits for another. Two may write the same values
    at once; a checksum says whether they are complete. The file disappears with its process.
    """

    def __init__(self, file: int, path: str, token: bytes, form: tuple[int, int]) -> None:
        self.path, self.token, (self.count, self.slot) = path, token, form
        self._bytes = np.frombuffer(mmap.mmap(file, 0), np.uint8)
        self._sums = self._bytes[TOKEN : TOKEN + 4 * self.count].view(np.uint32)
        self._first = _aligned(TOKEN + 4 * self.count)
        self._whole: set[int] = set()  # that were checked

    @classmethod
    def within(cls, most: int, bricks: int, slot: int) -> Self | None:
        """Make a file of at most so many bytes for bricks; None if impossible."""
        slot = _aligned(slot)
        count = max(0, min(bricks, (most - TOKEN - ALIGNED) // (slot + 4)))
        if not count or not Path("/proc/self/fd").exists():
            return None
        try:
            folder().mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder()) as made:
                claim(made.fileno(), _aligned(TOKEN + 4 * count) + slot * count, folder())
                file = os.dup(made.fileno())  # stays open for the other processes
        except OSError:
            return None
        path, token = f"/proc/{os.getpid()}/fd/{file}", uuid4().bytes
        os.pwrite(file, token, 0)
        shared = cls(file, path, token, (count, slot))
        weakref.finalize(shared, os.close, file)
        return shared

    def __reduce__(self) -> tuple[Any, ...]:
        return _opened, (self.path, self.token, (self.count, self.slot))

    def _place(self, number: int, size: int) -> NDArray[np.uint8]:
        first = self._first + number * self.slot
        return self._bytes[first : first + size]

    def found(
        self, number: int, shape: tuple[int, ...], dtype: np.dtype[Any]
    ) -> NDArray[Any] | None:
        """Return a brick if a process has stored it."""
        if number >= self.count or not self._sums[number]:
            return None
        held = self._place(number, prod(shape) * dtype.itemsize)
        if number not in self._whole:
            if _sum_of(held) != self._sums[number]:
                return None
            self._whole.add(number)
        return held.view(dtype).reshape(shape)

    def keep(self, number: int, values: NDArray[Any]) -> bool:
        """Store a brick if it has a place; return whether it has."""
        if number >= self.count or values.nbytes > self.slot:
            return False
        held = np.ascontiguousarray(values).reshape(-1).view(np.uint8)
        self._place(number, held.size)[:] = held
        self._sums[number] = _sum_of(held)
        return True


def _aligned(count: int) -> int:
    return -(-count // ALIGNED) * ALIGNED


def _sum_of(values: NDArray[np.uint8]) -> int:
    return crc32(values.data) or 1


def _opened(path: str, token: bytes, form: tuple[int, int]) -> SharedBricks | None:
    """Open a file of another process; None on another machine, or after its end."""
    with suppress(OSError), Path(path).open("r+b") as file:
        if file.read(TOKEN) == token:
            return SharedBricks(file.fileno(), path, token, form)
    return None


Step = tuple[int, ...]  # an index or a size along each axis, such as z, y, x
Box = tuple[slice, ...]  # likewise

SHARE = 8  # memory limit over the limit of the pinned bricks
OWN = uuid4().hex  # identifies caches of this process


def spans(count: int, parts: int) -> list[tuple[int, int]]:
    """Cut a range into about equal parts, none of them empty."""
    return list(pairwise(sorted({count * n // parts for n in range(parts + 1)})))


def boxes_of(shape: Step, side: Step) -> list[Box]:
    """Cut an array into boxes of a size, the last along each axis smaller; the first slowest."""
    starts = product(*(range(0, size, own) for size, own in zip(shape, side, strict=True)))
    return [
        tuple(slice(n, min(n + own, size)) for n, own, size in zip(at, side, shape, strict=True))
        for at in starts
    ]


class PinnedCache:
    """Cache that pins the bricks read first, up to a limit in bytes, for all later passes.

    All passes go over the bricks in the same order, so an LRU cache would be useless for the next
    one. It is pickled without its bricks: in another process, all parts of one command's work share
    a cache of that process. It ends with the process, or when it works for another command.
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
        """Cache a brick if there is room, unless it is constant, so never read."""
        if values.nbytes > self.most - self.size or (
            is_known_by_its_ends(values.dtype) and bool(values.min() == values.max())
        ):
            return
        with self._lock:
            if index not in self._kept and values.nbytes <= self.most - self.size:
                self._kept[index] = values
                self.size += values.nbytes

    def all(self) -> list[tuple[Step, NDArray[Any]]]:
        """Return all bricks, with their indices."""
        with self._lock:
            return list(self._kept.items())

    def limit(self, most: int) -> None:
        """Set the limit in bytes; 0 evicts all."""
        with self._lock:
            self.most = most
            while self.size > most:
                self.size -= self._kept.popitem()[1].nbytes


_CACHES: dict[tuple[str, str], PinnedCache] = {}  # of the command that this process works for
_CACHES_LOCK = Lock()


def _cache_here(most: int, name: tuple[str, str]) -> PinnedCache:
    """Return this process's cache of a command, and drop other commands' caches."""
    with _CACHES_LOCK:
        for other in [other for other in _CACHES if other[0] != name[0]]:
            del _CACHES[other]
        cache = _CACHES.setdefault(name, PinnedCache(most, name))
    cache.limit(most)
    return cache


def is_known_by_its_ends(dtype: np.dtype[Any]) -> bool:
    """Return whether equal minimum and maximum determine all values of a type."""
    return dtype.kind in "iu" and dtype.itemsize <= 4  # float64 holds them exactly, and none is NaN


@dataclass(eq=False)
class BrickArray:
    """An array in a file, with bricks that are read on demand."""

    read: Callable[[Box], NDArray[Any]]  # reads the values of a box from the file
    shape: Step
    dtype: np.dtype[Any]
    side: Step  # elements of a brick; the last along each axis may be smaller
    found: dict[Any, Any] = field(default_factory=dict)  # facts, see `resample.outofcore.passes`
    memory: int | None = None  # memory limit for all data made of them; None: the machine's
    reads: int = 0  # counts bricks read
    pinned: PinnedCache | None = None  # pinned bricks, as stored in the file
    shared: SharedBricks | None = None  # pinned bricks that other processes have, too
    period: int | None = None  # elements of the first axis at which bricks restart; None: none
    _lock: Lock = field(default_factory=Lock)

    @property
    def size(self) -> int:
        """Number of elements."""
        return prod(self.shape)

    @property
    def count(self) -> Step:
        """Bricks along each axis."""
        each = self.period or self.shape[0]
        sizes = zip((each, *self.shape[1:]), self.side, strict=True)
        first, *others = (-(-size // side) for size, side in sizes)
        return first * (self.shape[0] // each), *others

    def box(self, index: Step) -> Box:
        """Return the box of elements of a brick."""
        each = self.period or self.shape[0]
        period, n = divmod(index[0], -(-each // self.side[0]))
        sizes, start = (each, *self.shape[1:]), period * each
        first, *others = (
            slice(n * side, min((n + 1) * side, size))
            for n, side, size in zip((n, *index[1:]), self.side, sizes, strict=True)
        )
        return slice(start + first.start, start + first.stop), *others

    def all(self) -> list[Step]:
        """Indices of all bricks, the first axis slowest."""
        return list(product(*map(range, self.count)))

    def brick(self, index: Step) -> NDArray[Any]:
        """Return the values of a brick, from the cache or the file."""
        values = None if self.pinned is None else self.pinned.found(index)
        box, number = self.box(index), int(np.ravel_multi_index(index, self.count))
        if values is None and self.shared is not None:
            shape = tuple(side.stop - side.start for side in box)
            values = self.shared.found(number, shape, self.dtype)
        if values is None:
            values = self.read(box)
            with self._lock:
                self.reads += 1
            is_there = self.shared is not None and self.shared.keep(number, values)
            if self.pinned is not None and not is_there:
                self.pinned.keep(index, values)
        return self.decoded(values)

    def decoded(self, stored: NDArray[Any]) -> NDArray[Any]:
        """Convert stored values; here unchanged."""
        return stored

    def share_bricks(self) -> None:
        """Let processes of this machine share pinned bricks, so that each is read once."""
        if self.pinned is not None and self.shared is None:
            bricks = prod(self.count)
            shared = SharedBricks.within(self.pinned.most, bricks, self.bytes_each)
            if shared is not None:
                for index, values in self.pinned.all():
                    shared.keep(int(np.ravel_multi_index(index, self.count)), values)
            self.shared = shared

    def anew(self) -> Self:
        """Return a copy that counts its own reads."""
        return replace(self, reads=0, _lock=Lock())

    def __getstate__(self) -> dict[str, Any]:
        """Return the state that another process needs."""
        return self.__dict__ | {"found": {}, "_lock": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state, _lock=Lock())

    def pin_bricks(self, most: int) -> None:
        """Pin the bricks read first, up to a limit in bytes."""
        self.shared = self.shared if most else None
        if self.pinned is None:
            self.pinned = PinnedCache(most)
        else:
            self.pinned.limit(min(most, self.pinned.most))

    @property
    def bytes_each(self) -> int:
        """Bytes of a brick."""
        return prod(map(min, self.side, self.shape)) * self.dtype.itemsize

    @property
    def bytes_to_load(self) -> int:
        """Bytes of all values."""
        return self.size * self.dtype.itemsize

    def parts(self) -> Iterator[NDArray[Any]]:
        """Yield the values of all bricks."""
        return in_order(self.brick, self.all())

    def whole(self) -> NDArray[Any]:
        """Read all values into memory."""
        values = np.empty(self.shape, self.dtype)
        self.put_into(values)
        return values

    def put_into(self, values: NDArray[Any]) -> None:
        """Fill an array with all values."""

        def put(index: Step) -> None:
            values[self.box(index)] = self.brick(index)

        for n, _ in enumerate(in_order(put, self.all())):
            report(n + 1, prod(self.count))
