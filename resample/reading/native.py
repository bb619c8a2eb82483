"""C and C++ libraries: names of files that they can open, and their messages suppressed.

Such libraries expect names in UTF-8. Linux allows any bytes in names; Python represents undecodable
ones as lone surrogates, which such libraries reject.
"""

import atexit
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from threading import Lock

from resample.messages import one_line


def plain(path: str | Path) -> str:
    """Name of a file for any library; a link, removed at exit, if the name is not UTF-8."""
    name = str(path)
    try:
        name.encode()
    except UnicodeEncodeError:
        # Link to a file, the same for repeated calls.
        target = os.path.abspath(name)
        ending = "".join(Path(target).suffixes[-2:])
        name = sha256(os.fsencode(target)).hexdigest()[:16] + (ending if ending.isascii() else "")
        link = os.path.join(_folder(os.getpid()), name)
        with suppress(FileExistsError):
            os.symlink(target, link)
        return link
    return name


@cache
def _folder(process: int) -> str:
    """Folder of a process's links, removed with it but not with its forks."""
    made = tempfile.mkdtemp(prefix="resample-names-")

    def remove() -> None:
        if os.getpid() == process:
            shutil.rmtree(made, ignore_errors=True)

    atexit.register(remove)
    return made


class _Silence:
    """Standard error of the process, suppressed while any block needs it."""

    def __init__(self) -> None:
        self._turn, self._blocks, self._kept = Lock(), 0, -1

    def begin(self) -> None:
        """Redirect the descriptor, unless another block has done so."""
        with self._turn:
            self._blocks += 1
            if self._blocks > 1:
                return
            try:
                self._kept = os.dup(2)
            except OSError:  # a daemon without standard error
                self._kept = -1
                return
            nowhere = os.open(os.devnull, os.O_WRONLY)
            os.dup2(nowhere, 2)
            os.close(nowhere)

    def end(self) -> None:
        """Restore the descriptor, unless another block still needs it redirected."""
        with self._turn:
            self._blocks -= 1
            if self._blocks or self._kept < 0:
                return
            os.dup2(self._kept, 2)
            os.close(self._kept)


_SILENCE = _Silence()


@contextmanager
def suppressed_output() -> Iterator[None]:
    """Discard what the process writes to standard error in this block.

    VTK, libpng and others write to file descriptor 2 directly; only the descriptor itself can be
    redirected. Other threads' messages are lost as well.
    """
    _SILENCE.begin()
    try:
        yield
    finally:
        _SILENCE.end()


def lacking(name: str, reader: str, error: ImportError, extra: str) -> ValueError:
    """Return the error for a file without an installed reader."""
    return ValueError(
        f"{name} is read by {reader}, and {error.name} is not installed: "
        f"pip install 'hybrid-resample[{extra}]'"
    )


@contextmanager
def damage(path: Path) -> Iterator[None]:
    """Turn the many errors that damaged files raise into one kind."""
    try:
        yield
    except MemoryError:
        raise
    except Exception as error:
        message = one_line(error).partition(" ****")[0]  # libE57 appends its sources' lines
        raise OSError(f"{path} is damaged: {message:.200}") from None
    except BaseException as error:
        if type(error).__name__ != "PanicException":  # of Rust
            raise
        raise OSError(f"{path} is damaged: it cannot be unpacked") from None
