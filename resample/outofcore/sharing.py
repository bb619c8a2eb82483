"""Bricks that processes of one machine share, in a nameless file of the user's cache."""

import mmap
import os
import tempfile
import weakref
from contextlib import suppress
from math import prod
from pathlib import Path
from typing import Any, Self
from uuid import uuid4
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import claim, folder

TOKEN = 16  # bytes that tell the file of a command from any other
ALIGNED = 64  # bytes


class SharedBricks:
    """Bricks by number, as many as fit in some bytes.

    Each has a place of its own, so that no process waits for another. Two may write the same values
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
        """Make a file of at most so many bytes for bricks; None where that is impossible."""
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
        """Return a brick if a process has kept it."""
        if number >= self.count or not self._sums[number]:
            return None
        held = self._place(number, prod(shape) * dtype.itemsize)
        if number not in self._whole:
            if _sum_of(held) != self._sums[number]:
                return None
            self._whole.add(number)
        return held.view(dtype).reshape(shape)

    def keep(self, number: int, values: NDArray[Any]) -> bool:
        """Keep a brick, if it has a place; whether it has."""
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
    """Open a file of another process; None on another machine, or when that has ended."""
    with suppress(OSError), Path(path).open("r+b") as file:
        if file.read(TOKEN) == token:
            return SharedBricks(file.fileno(), path, token, form)
    return None
