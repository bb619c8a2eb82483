"""Files of compiled kernels in the user's cache: one for each kernel and types of its arguments.

A file's name is a fingerprint of everything its code depends on, so a file is never out of
date: a clone, a copy and a wheel of the same sources share it, and an edit makes other names.
"""

import hashlib
import json
import logging
import os
import tempfile
import time
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import NamedTuple

from resample.reading.limits import NotOwnError, check_own, own_bytes

LOG = logging.getLogger("resample")
FIRST = b"resample kernel 2\n"  # bytes that files begin with
SUFFIX = ".kernel"
SIZE = hashlib.blake2b().digest_size
DAY = 86400.0  # seconds
OLD = 60 * DAY  # files that were not used for so long are removed
MOST = 1 << 30  # bytes of all files; beyond them those go that were not used for longest


class Entry(NamedTuple):
    """A compiled kernel."""

    kernel: str  # module and name
    key: str  # types of the arguments
    parts: list[str]  # names of its sources
    seconds: float  # of CPU time that this took
    payload: bytes  # pickled by numba


def read(path: Path) -> Entry | None:
    """Entry in a file; None if it is missing, or damaged: then it is removed."""
    try:
        data = own_bytes(path)
    except NotOwnError as error:
        say_that_nothing_is_kept(str(error))
        return None
    except OSError:
        return None
    start = len(FIRST) + SIZE
    if not data.startswith(FIRST) or _checksum(data[start:]) != data[len(FIRST) : start]:
        LOG.warning("a kernel in the cache is damaged and compiled anew: %s", path)
        with suppress(OSError):
            path.unlink()
        return None
    with suppress(OSError):
        if time.time() - path.stat().st_mtime > DAY:
            os.utime(path)  # when it was last used
    head, _, payload = data[start:].partition(b"\n")
    kernel, key, parts, seconds = json.loads(head)
    return Entry(kernel, key, parts, seconds, payload)


def write(path: Path, entry: Entry) -> None:
    """Store an entry. A disk that is full or read-only is reported once.

    The file appears whole, or not at all.
    """
    data = json.dumps(entry[:-1]).encode() + b"\n" + entry.payload
    try:
        path.parent.mkdir(0o755, parents=True, exist_ok=True)
        check_own(path.parent)
        _prune_once(path.parent)
        with tempfile.NamedTemporaryFile(dir=path.parent, suffix=".new", delete=False) as file:
            try:
                file.write(FIRST + _checksum(data) + data)
                file.close()
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise
    except OSError as error:
        say_that_nothing_is_kept(str(error))


def _checksum(data: bytes) -> bytes:
    return hashlib.blake2b(data).digest()


@cache
def say_that_nothing_is_kept(reason: str) -> None:
    """Report once that kernels are compiled for this process alone."""
    LOG.info(
        "kernels cannot be kept on disk (%s): every process compiles them; set NUMBA_CACHE_DIR",
        reason,
    )


@cache
def _prune_once(folder: Path) -> None:
    prune(folder)


def prune(folder: Path, most: int = MOST) -> None:
    """Remove files unused for long, and the oldest above a number of bytes."""
    now, kept = time.time(), 0
    used = []
    for file in folder.iterdir():
        with suppress(OSError):
            used.append((file.stat().st_mtime, file.stat().st_size, file))
    for last, size, file in sorted(used, reverse=True):
        is_left_behind = file.suffix == ".new" and now - last > DAY
        kept += size
        if kept > most or now - last > OLD or is_left_behind:
            with suppress(OSError):
                file.unlink()
