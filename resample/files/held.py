"""JPEG files, which are encoded in memory: libjpeg ends the process if it cannot write."""

import errno
import os
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from resample.reading.names import plain

MOST = 4  # bytes of a value that is encoded: no code of libjpeg's takes more than 26 bits
HEAD = 1 << 16  # bytes of what is written besides values and attributes
STEP = 1 << 20  # bytes that are taken from memory at once


class HeldJpeg:
    """File of OpenImageIO for a JPEG, with its methods, which gets to the disk through Python.

    Where the system has no files in memory (others than Linux), or limits how large files may be,
    it is refused beforehand if there might be no room for it.

    Parameters
    ----------
    path
        What is written, which is there.
    spec
        Of OpenImageIO: what is told of the picture.

    Raises
    ------
    OSError
        There is no room, which methods that write may raise as well; or it cannot be begun.
    """

    def __init__(self, path: Path, spec: Any) -> None:
        import OpenImageIO

        self._held, self._done = ExitStack(), 0
        self._memory = memory = _memory()
        if memory is not None:
            self._held.callback(os.close, memory)
        _check_room(path, _most(spec), is_on_disk=memory is None)
        self._file = self._held.enter_context(path.open("wb"))
        jpeg: Any = OpenImageIO.ImageOutput.create("jpeg")
        self._target = jpeg
        if not jpeg.open(plain(path) if memory is None else _name(memory), spec):
            raise OSError(f"{path} cannot be written: {jpeg.geterror()}")

    def __del__(self) -> None:
        self._held.close()

    def write_image(self, pixels: Any) -> bool:
        """Write all rows; whether that went well."""
        return self._drained(is_done=self._target.write_image(pixels))

    def write_scanlines(self, first: int, last: int, z: int, pixels: Any) -> bool:
        """Write some rows; whether that went well."""
        return self._drained(is_done=self._target.write_scanlines(first, last, z, pixels))

    def close(self) -> bool:
        """Write what is left; whether that went well."""
        with self._held:
            return self._drained(is_done=self._target.close())

    @property
    def has_error(self) -> bool:
        """Whether OpenImageIO complains."""
        return bool(self._target.has_error)

    def geterror(self) -> str:
        """What it complains about."""
        return str(self._target.geterror())

    def _drained(self, *, is_done: bool) -> bool:
        """Put what is in memory by now into the file."""
        if self._memory is None:
            return is_done
        end = os.fstat(self._memory).st_size
        while self._done < end:
            data = os.pread(self._memory, min(STEP, end - self._done), self._done)
            self._file.write(data)
            self._done += len(data)
        os.ftruncate(self._memory, 0)  # what follows is written behind a hole, which takes no room
        return is_done


def _memory() -> int | None:
    """File in memory that has a name, by its number; None where there is none."""
    if hasattr(os, "memfd_create"):
        with suppress(OSError):
            memory = os.memfd_create("jpeg")
            if os.path.exists(_name(memory)):
                return memory
            os.close(memory)
    return None


def _name(memory: int) -> str:
    return f"/proc/self/fd/{memory}"


def _most(spec: Any) -> int:
    """Bytes that a JPEG cannot be larger than."""
    told = sum(np.asarray(attribute.value).nbytes for attribute in spec.extra_attribs)
    return MOST * int(spec.width) * int(spec.height) * int(spec.nchannels) + told + HEAD


def _check_room(path: Path, most: int, *, is_on_disk: bool) -> None:
    """Refuse what might not be written as a whole."""
    limit = _limit()
    if limit is not None and most > limit:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    if is_on_disk and shutil.disk_usage(path.parent).free < most:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _limit() -> int | None:
    """Bytes that the system lets a file of this process have, in memory as well."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit
