"""Encode JPEG files in memory: libjpeg ends the process if a write fails."""

import errno
import os
import shutil
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

import numpy as np

from resample.reading.native import plain

MOST = 4  # upper bound on bytes per encoded value: no code of libjpeg's exceeds 26 bits
HEAD = 1 << 16  # bytes besides values and attributes
STEP = 1 << 20  # bytes moved from memory to disk at once


class BufferedJpeg:
    """OpenImageIO output for a JPEG, written to disk by Python.

    If the system has no in-memory files (other than Linux) or limits the size of files, it is
    rejected beforehand if it might not fit.

    Parameters
    ----------
    path
        Existing file to write to.
    spec
        OpenImageIO header of the picture.
    """

    def __init__(self, path: Path, spec: Any) -> None:
        import OpenImageIO

        self._held, self._done = ExitStack(), 0
        self._memory = memory = _memory()
        if memory is not None:
            self._held.callback(os.close, memory)
        _check_space(path, _most(spec), is_on_disk=memory is None)
        self._file = self._held.enter_context(path.open("wb"))
        jpeg: Any = OpenImageIO.ImageOutput.create("jpeg")
        self._target = jpeg
        if not jpeg.open(plain(path) if memory is None else _name(memory), spec):
            raise OSError(f"{path} cannot be written: {jpeg.geterror()}")

    def __del__(self) -> None:
        self._held.close()

    def write_image(self, pixels: Any) -> bool:
        """Write all rows; returns whether it succeeded."""
        return self._drained(is_done=self._target.write_image(pixels))

    def write_scanlines(self, first: int, last: int, z: int, pixels: Any) -> bool:
        """Write some rows; returns whether it succeeded."""
        return self._drained(is_done=self._target.write_scanlines(first, last, z, pixels))

    def close(self) -> bool:
        """Finish the file; returns whether it succeeded."""
        with self._held:
            return self._drained(is_done=self._target.close())

    @property
    def has_error(self) -> bool:
        """Whether OpenImageIO reports an error."""
        return bool(self._target.has_error)

    def geterror(self) -> str:
        """The error message."""
        return str(self._target.geterror())

    def _drained(self, *, is_done: bool) -> bool:
        """Move the data in memory to the file."""
        if self._memory is None:
            return is_done
        end = os.fstat(self._memory).st_size
        while self._done < end:
            data = os.pread(self._memory, min(STEP, end - self._done), self._done)
            self._file.write(data)
            self._done += len(data)
        os.ftruncate(self._memory, 0)  # later writes follow a hole, which takes no space
        return is_done


def _memory() -> int | None:
    """Descriptor of a new in-memory file; None if there is no such thing."""
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
    """Upper bound on the size of the JPEG in bytes."""
    told = sum(np.asarray(attribute.value).nbytes for attribute in spec.extra_attribs)
    return MOST * int(spec.width) * int(spec.height) * int(spec.nchannels) + told + HEAD


def _check_space(path: Path, most: int, *, is_on_disk: bool) -> None:
    """Reject a file that might not fit."""
    limit = _limit()
    if limit is not None and most > limit:
        raise OSError(errno.EFBIG, os.strerror(errno.EFBIG), str(path))
    if is_on_disk and shutil.disk_usage(path.parent).free < most:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(path))


def _limit() -> int | None:
    """Limit on the size of files of this process, in memory too; None if there is none."""
    try:
        import resource
    except ImportError:  # Windows
        return None
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    return None if limit == resource.RLIM_INFINITY else limit
