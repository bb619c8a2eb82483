"""Files that appear whole or not at all.

What is written beside a target says in its name which process of which machine does so. A process
that is killed leaves it there; the next one that writes into the folder removes it.

Libraries in C and C++ may lose what a full disk does not take, and say nothing: so what Python can
write itself, it does, and of what they have written the end is looked at.
"""

import errno
import io
import json
import math
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from hashlib import sha256
from pathlib import Path
from platform import node
from typing import TYPE_CHECKING, Any, BinaryIO

from resample.words import one_line

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

LEFT = re.compile(r"\..+\.tmp-([0-9a-f]{6})-([0-9]{1,10})-[0-9a-f]{8}(?:\..*)?")
MOST = 40  # letters of a target's name, as file systems take few
NO_ROOM = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
PROBE = 1 << 16  # bytes that a disk is asked to take where a library could not write
INCOMPLETE = "the file came out incomplete; is the disk full?"
PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
_being_written: set[str] = set()  # names, without folders
_tidied: set[Path] = set()  # folders, once per process


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write beside a file and put the result in its place when all went well.

    Parameters
    ----------
    path
        Target. It is created or replaced at the end of the block; a link is followed.

    Yields
    ------
    An empty file of the same folder and suffix, to be written to. It is removed after an error.

    Raises
    ------
    OSError
        The target cannot be created: its folder is missing or may not be written to, or it is a
        folder or device. Or the disk is full: its number says so, and its name is the target's.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EISDIR, "is not a regular file, so it is not replaced", str(path))
    with beside(target) as temporary:
        try:
            temporary.open("xb").close()
        except OSError as error:
            raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from None
        try:
            yield temporary
            _on_disk(temporary)
            temporary.replace(target)
        except OSError as error:
            is_own = error.filename is None or str(error.filename) == str(temporary)
            if error.errno not in NO_ROOM or not is_own:
                raise
            raise unwritten(path, error) from None


def unwritten(path: str | Path, error: OSError) -> OSError:
    """Error of a file that cannot be written, by its own name, not that of what lies beside."""
    if error.errno is None or error.errno not in NO_ROOM:
        return OSError(f"{path} cannot be written: {one_line(error)}")
    return OSError(error.errno, f"cannot be written: {os.strerror(error.errno)}", str(path))


def _on_disk(path: Path) -> None:
    """Wait until a file is on the disk; what that has no room for may show only then."""
    with path.open("r+b") as file:
        try:
            os.fsync(file.fileno())
        except OSError as error:
            if error.errno in (*NO_ROOM, errno.EIO):  # others: the file system knows no such wish
                raise


def refused(path: str | Path, temporary: Path, why: str) -> OSError:
    """Error of a file that a library could not write.

    Parameters
    ----------
    path
        Name of it for the message.
    temporary
        What the library has written. If the disk takes no more of it, that is the reason.
    why
        What the library says.
    """
    try:
        with temporary.open("ab", buffering=0) as file:
            left = PROBE
            while left:
                left -= file.write(bytes(left)) or 0
            os.fsync(file.fileno())
    except OSError as error:
        if error.errno in NO_ROOM:
            return unwritten(path, error)
    return OSError(f"{path} cannot be written: {why}")


def check_end(path: str | Path, temporary: Path) -> None:
    """Refuse a PNG or MP4 file that a library has written and that is cut off.

    Raises
    ------
    OSError
        It is.
    """
    kind, size = temporary.suffix.lower(), temporary.stat().st_size
    with temporary.open("rb") as file:
        if kind == ".png":
            file.seek(max(0, size - len(PNG_END)))
            is_whole = file.read() == PNG_END
        else:
            is_whole = kind != ".mp4" or _end_of_boxes(file, size) == size
    if not is_whole:
        raise refused(path, temporary, INCOMPLETE)


def _end_of_boxes(file: BinaryIO, size: int) -> int:
    """Where the last box of an MP4 file says that it ends; 0 if there is none."""
    place = 0
    while place < size:
        file.seek(place)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        length = int.from_bytes(head[8:], "big") if length == 1 else length
        if length < 8:
            return 0
        place += length
    return place


class _Plain(io.FileIO):
    """File without a number, so that nobody writes to it past Python."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation("what is written goes through Python")


def save_array(path: Path, values: "ArrayLike") -> None:
    """Write an array as NPY; NumPy by itself does not notice that a disk is full.

    Raises
    ------
    OSError
        It cannot be written.
    """
    import numpy as np

    with io.BufferedWriter(_Plain(path, "wb")) as file:
        np.save(file, values)


@contextmanager
def beside(target: Path) -> Iterator[Path]:
    """Name beside a target that nothing has, for what is to take the target's place.

    Parameters
    ----------
    target
        File or folder. What killed processes left in the folder that it lies in is removed.

    Yields
    ------
    The name, which hides a file, and keeps the suffix. What still has it in the end, is removed.
    """
    if target.parent not in _tidied:
        _tidied.add(target.parent)
        remove_left(target.parent)
    temporary = _named(target)
    _being_written.add(temporary.name)
    try:
        yield temporary
    finally:
        _remove(temporary)
        _being_written.discard(temporary.name)


@contextmanager
def inheriting(target: Path) -> Iterator[list[Path]]:
    """Folders that killed processes of this machine left beside a target, in its place.

    They are this process's from now on, to go on with what is in them.

    Parameters
    ----------
    target
        As of `beside`, before anything else is written there.

    Yields
    ------
    The folders. Those that still are there in the end are removed.
    """
    start, found = f".{target.stem[:MOST]}.tmp-", []
    with suppress(OSError):
        for name in sorted(os.listdir(target.parent)):
            path = target.parent / name
            if name.startswith(start) and path.suffix == target.suffix and _is_left(name):
                with suppress(OSError):  # another command has been quicker
                    found.append(_taken_over(path, target))
    try:
        yield found
    finally:
        for path in found:
            _remove(path)
            _being_written.discard(path.name)


def _taken_over(path: Path, target: Path) -> Path:
    """Folder that a dead process has left, under a name of this one.

    Raises
    ------
    OSError
        It is no folder, or gone.
    """
    if not path.is_dir():
        raise NotADirectoryError(path)
    own = _named(target)
    _being_written.add(own.name)
    try:
        return path.rename(own)
    except OSError:
        _being_written.discard(own.name)
        raise


def _named(target: Path) -> Path:
    """Name beside a target that says which process writes there."""
    owner = f"{_machine()}-{os.getpid()}-{secrets.token_hex(4)}"
    return target.with_name(f".{target.stem[:MOST]}.tmp-{owner}{target.suffix}")


def leave_to_others(folder: Path) -> None:
    """Do not remove what is left in a folder: another process sees to that."""
    _tidied.add(folder)


def remove_left(folder: Path) -> None:
    """Remove what processes of this machine that are no more were writing into a folder.

    What another machine's, or any living process writes stays, as does what must not be removed.
    """
    with suppress(OSError):
        for name in os.listdir(folder):
            if _is_left(name):
                _remove(folder / name)


def _is_left(name: str) -> bool:
    """Whether a process of this machine that is no more was writing under a name."""
    left = LEFT.fullmatch(name)
    return bool(left and left[1] == _machine() and not _is_at_work(int(left[2]), name))


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


def _is_at_work(process: int, name: str) -> bool:
    """Whether the process lives; one of this number may have died before this one began."""
    if process == os.getpid():
        return name in _being_written
    if os.name == "nt":  # where asking would end it
        return True
    try:
        os.kill(process, 0)
    except PermissionError:  # it is another user's
        return True
    except (ProcessLookupError, OverflowError):
        return False
    return True


@cache
def _machine() -> str:
    return sha256(node().encode()).hexdigest()[:6]


def rows_as_json(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as JSON, which cannot say infinity."""
    finite = [
        {key: None if value == math.inf else value for key, value in row.items()} for row in rows
    ]
    return json.dumps(finite, indent=2) + "\n"


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write facts to a file."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def check_targets(*paths: Path | None) -> None:
    """Refuse files that could not be written in the end, before any work is done; None is none.

    Raises
    ------
    ValueError
        Two are the same.
    OSError
        A folder is missing or must not be written to, or a target is no file.
    """
    given = [path for path in paths if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise ValueError(f"{given[0]} cannot be written twice; give each output its own name")
    for path in given:
        with suppress(_Abandoned), replacing(path):
            raise _Abandoned


class _Abandoned(Exception):  # noqa: N818 - no error: the file was only tried
    """Leaves a file that is being replaced as it was."""
