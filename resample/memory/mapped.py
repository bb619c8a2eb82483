"""Arrays that memory does not hold, in files of which the machine has some pages in memory.

Who reads or writes such an array need not know. A thread beside lets pages go when more of them are
in memory than may be: what was written to them is in the file, which has no name and ends with the
array, however the process ends.
"""

import logging
import mmap
import os
import tempfile
import time
from contextlib import suppress
from math import prod
from pathlib import Path
from threading import Lock, Thread
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import DTypeLike, NDArray

from resample.memory import ALLOWED, amount, available_memory, held_of_files

LOG = logging.getLogger("resample")
FOLDER_VARIABLE = "HYBRID_RESAMPLE_CACHE"
OFTEN = 0.01  # seconds between two looks at how much is in memory
SPARE = 1 << 26  # bytes that a disk is left with


class _Held(NamedTuple):
    """What is known of a file."""

    most: int  # bytes of pages of all files, that may be in memory
    others: int  # bytes of pages of other files, libraries above all


_held: "WeakKeyDictionary[mmap.mmap, _Held]" = WeakKeyDictionary()
_lock = Lock()
_thread: Thread | None = None


def folder() -> Path:
    """Where files are: the user's cache, or the folder that HYBRID_RESAMPLE_CACHE names."""
    from platformdirs import user_cache_dir

    return Path(os.environ.get(FOLDER_VARIABLE) or user_cache_dir("hybrid-resample"))


def array_in_file(shape: tuple[int, ...], kind: DTypeLike, most: int, what: str) -> NDArray[Any]:
    """Array of zeros in a file.

    Parameters
    ----------
    shape, kind
        Of the array.
    most
        Bytes of it, and of all others in files, that may be in memory.
    what
        Name of it for the message.

    Raises
    ------
    ValueError
        The disk has no room for it, or nothing may be written there.

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
        _held[mapping] = _Held(most, held_of_files())
        _watch()
    return np.ndarray(shape, dtype, buffer=mapping)


def array_where_it_fits(shape: tuple[int, ...], kind: DTypeLike, what: str) -> NDArray[Any]:
    """Array in memory or, where it would take more than half of what may be taken, in a file.

    Raises
    ------
    ValueError
        As of `array_in_file`.
    """
    dtype = np.dtype(kind)
    most = pages_of(prod(shape) * dtype.itemsize)
    if most is None:
        return np.empty(shape, dtype)
    LOG.info(
        "%s is larger than memory should hold: it is in a file of %s meanwhile", what, folder()
    )
    return array_in_file(shape, dtype, most, what)


def pages_of(size: int) -> int | None:
    """Bytes of pages of so large an array that memory takes, if it is in a file; else None."""
    allowed = ALLOWED.get() or available_memory()
    return None if allowed is None or 2 * size <= allowed else allowed // 4


def array_like(
    values: NDArray[Any], shape: tuple[int, ...], kind: DTypeLike, what: str
) -> NDArray[Any]:
    """Array for what is made of values: in memory, or in a file if these are in one.

    Raises
    ------
    ValueError
        As of `array_in_file`.
    """
    held = _of(values)
    return np.empty(shape, kind) if held is None else array_in_file(shape, kind, held.most, what)


def is_in_file(values: NDArray[Any]) -> bool:
    """Whether an array, or what it is a part of, is one from here."""
    return _of(values) is not None


def most_of(values: NDArray[Any]) -> int | None:
    """Bytes of pages that may be in memory, of an array in a file; None of any other."""
    held = _of(values)
    return None if held is None else held.most


def _of(values: Any) -> _Held | None:
    while values is not None and not isinstance(values, mmap.mmap):
        values = getattr(values, "base", None)
    with _lock:
        return None if values is None else _held.get(values)


def _mapping_of(size: int, what: str) -> mmap.mmap:
    """So many bytes of a file without a name, which a full disk cannot take back."""
    place = folder()
    try:
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=place) as file:
            _claim(file.fileno(), size, place)
            return mmap.mmap(file.fileno(), size)
    except OSError as error:
        raise ValueError(
            f"{what} is {amount(size)}, more than memory may hold, and cannot be kept in a file of "
            f"{place}: {error.strerror or error}; give more memory, or {FOLDER_VARIABLE} the name "
            "of a folder on a larger disk"
        ) from None


def _claim(file: int, size: int, place: Path) -> None:
    """Give a file its size, and the disk's room for it.

    Raises
    ------
    OSError
        There is none.
    """
    import shutil

    free = shutil.disk_usage(place).free
    if free < size + SPARE:
        raise OSError(f"{amount(free)} are free")
    if hasattr(os, "posix_fallocate"):
        os.posix_fallocate(file, 0, size)
    else:
        os.truncate(file, size)


def _watch() -> None:
    """Begin to let pages go, if the platform can and nothing does so yet."""
    global _thread  # noqa: PLW0603 - one for all arrays of the process
    if not hasattr(mmap.mmap, "madvise") or not held_of_files():
        return
    if _thread is None or not _thread.is_alive():
        _thread = Thread(target=_let_go, name="pages", daemon=True)
        _thread.start()


def _let_go() -> None:
    """Let go of pages as long as there are arrays."""
    global _thread  # noqa: PLW0603
    while True:
        time.sleep(OFTEN)
        with _lock:
            known = list(_held.values())
            if not known:
                _thread = None
                return
            most = min(held.most for held in known) + min(held.others for held in known)
            if held_of_files() > most:
                _drop_pages()


def _drop_pages() -> None:
    for file in list(_held):
        with suppress(ValueError):  # it was closed
            file.madvise(mmap.MADV_DONTNEED)


def _after_fork() -> None:
    """Begin anew in a child, whose threads are gone."""
    global _lock, _thread
    _lock, _thread = Lock(), None
    _watch()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_after_fork)
