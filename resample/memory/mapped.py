"""Arrays larger than memory, mapped to files with some pages in memory.

Readers and writers use them as ordinary arrays. A thread releases pages when more than the budget
are in memory: their contents are in the file. The file has no name and disappears with the array,
however the process ends.
"""

import logging
import mmap
import os
import sys
import tempfile
import time
from contextlib import suppress
from math import prod
from pathlib import Path
from threading import Lock, Thread
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from resample.memory import ALLOWED, amount, available_memory, mapped_memory

LOG = logging.getLogger("resample")
FOLDER_VARIABLE = "HYBRID_RESAMPLE_CACHE"
OFTEN = 0.01  # seconds between two checks of the pages in memory
SPARE = 1 << 26  # bytes to leave free on the disk
Number = TypeVar("Number", bound=np.generic)


# Of each file: the bytes in memory allowed for all files, and the bytes of other files.
_held: "WeakKeyDictionary[mmap.mmap, tuple[int, int]]" = WeakKeyDictionary()
_lock = Lock()
_thread: Thread | None = None


def folder() -> Path:
    """Folder for the files: the user's cache, or the one named by HYBRID_RESAMPLE_CACHE."""
    from platformdirs import user_cache_dir

    return Path(os.environ.get(FOLDER_VARIABLE) or user_cache_dir("hybrid-resample"))


def array_in_file(shape: tuple[int, ...], kind: DTypeLike, most: int, what: str) -> NDArray[Any]:
    """Create an array of zeros in a file.

    `most`: budget in bytes for the pages in memory of all arrays in files.

    Examples
    --------
    >>> from resample.memory.mapped import array_in_file, is_in_file
    >>> values = array_in_file((4, 4, 4), "u1", 1 << 20, "a volume")
    >>> values[0, 0, 0], values.shape, is_in_file(values[1:])
    (np.uint8(0), (4, 4, 4), True)
    """
    dtype = np.dtype(kind)
    size = prod(shape) * dtype.itemsize
    mapping = _mapping_of(max(1, size), what)
    with _lock:
        _held[mapping] = most, mapped_memory()
        _watch()
    return np.ndarray(shape, dtype, buffer=mapping)


def array_where_it_fits(shape: tuple[int, ...], kind: DTypeLike, what: str) -> NDArray[Any]:
    """Create an array in memory or, if it exceeds half of the memory limit, in a file."""
    dtype = np.dtype(kind)
    most = pages_of(prod(shape) * dtype.itemsize)
    if most is None:
        return np.empty(shape, dtype)
    LOG.info(
        "%s is larger than memory should hold: it is in a file of %s meanwhile", what, folder()
    )
    return array_in_file(shape, dtype, most, what)


def pages_of(size: int) -> int | None:
    """Bytes in memory of an array of this size, if it would be in a file; else None."""
    allowed = ALLOWED.get() or available_memory()
    return None if allowed is None or 2 * size <= allowed else allowed // 4


def array_like(
    values: NDArray[Any], shape: tuple[int, ...], kind: DTypeLike, what: str
) -> NDArray[Any]:
    """Create an array for results of arrays: in a file if one of them is in a file."""
    held = _of(values)
    return np.empty(shape, kind) if held is None else array_in_file(shape, kind, held[0], what)


def is_in_file(values: NDArray[Any]) -> bool:
    """Whether an array, or the array it is a view of, is mapped to a file here."""
    return _of(values) is not None


def most_of(values: NDArray[Any]) -> int | None:
    """Budget in bytes for the pages of an array in a file; None for any other array."""
    held = _of(values)
    return None if held is None else held[0]


def _of(values: Any) -> tuple[int, int] | None:
    while values is not None and not isinstance(values, mmap.mmap):
        values = getattr(values, "base", None)
    with _lock:
        return None if values is None else _held.get(values)


def _mapping_of(size: int, what: str) -> mmap.mmap:
    """Map an unnamed file with reserved disk space."""
    place = folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place) as file:
            claim(file.fileno(), size, place)
            return mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise ValueError(
            f"{what} is {amount(size)}, more than memory may hold, and cannot be kept in a file of "
            f"{place}: {error.strerror or error}; give more memory, or {FOLDER_VARIABLE} the name "
            "of a folder on a larger disk"
        ) from None


def claim(file: int, size: int, place: Path) -> None:
    """Resize a file and reserve its disk space."""
    import shutil

    free = shutil.disk_usage(place).free
    if free < size + SPARE:
        raise OSError(f"{amount(free)} are free")
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.truncate(file, size)


def _watch() -> None:
    """Start the thread that releases pages, if the platform supports it."""
    global _thread  # noqa: PLW0603 - one for all arrays of the process
    if not hasattr(mmap.mmap, "madvise") or not mapped_memory():
        return
    if _thread is None or not _thread.is_alive():
        _thread = Thread(target=_let_go, name="pages", daemon=True)
        _thread.start()


def _let_go() -> None:
    """Release pages as long as arrays exist."""
    global _thread  # noqa: PLW0603
    while True:
        time.sleep(OFTEN)
        with _lock:
            known = list(_held.values())
            if not known:
                _thread = None
                return
            most = sum(map(min, zip(*known, strict=True)))
            if mapped_memory() > most:
                for file in list(_held):
                    with suppress(ValueError):  # the mapping was closed
                        file.madvise(mmap.MADV_DONTNEED)


def _after_fork() -> None:
    """Restart in a child process, which has no threads."""
    global _lock, _thread
    _lock, _thread = Lock(), None
    _watch()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)


def contiguous(given: ArrayLike, kind: type[Number]) -> NDArray[Number]:
    """Writable C-ordered array of a type; a copy unless it already is one.

    The result is a plain ndarray. Masked elements become NaN.

    Examples
    --------
    >>> import numpy as np
    >>> from resample.memory.mapped import contiguous
    >>> frozen = np.broadcast_to(np.float32(1), (2, 3))
    >>> contiguous(frozen, np.float32).flags.writeable
    True
    """
    if "numpy.ma" in sys.modules and np.ma.is_masked(given):  # its import takes 9 ms
        given = np.ma.filled(np.ma.asarray(given, np.float64), np.nan)
    return np.require(given, kind, ["C", "A", "W", "E"])
