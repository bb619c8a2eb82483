"""Write files atomically.

Temporary files are beside their target. While a process writes them it holds a lock on a file
beside them, which the system releases however the process ends. What a killed process leaves
behind is removed by the next one on this machine that writes into the folder.

C and C++ libraries may silently lose data on a full disk: so Python writes the file where it can,
and elsewhere the end of the file is checked.
"""

import errno
import io
import json
import os
import re
import secrets
import shutil
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from hashlib import sha256
from importlib.util import find_spec
from pathlib import Path
from platform import node
from typing import TYPE_CHECKING, Any

from resample.messages import one_line
from resample.reading.limits import BY_OTHERS, NotOwnError, check_own, tell_unused

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LOCK = re.compile(r"(?s)(\..*)\.lock-([0-9a-f]{6})(-[0-9a-f]{8})")  # files that are locked
MOST = 40  # characters of a target's name, as file systems limit names
NO_SPACE = (errno.ENOSPC, errno.EFBIG, getattr(errno, "EDQUOT", errno.ENOSPC))
PROBE = 1 << 16  # bytes to write as a test for a full disk after a library failed
INCOMPLETE = "the file is incomplete; is the disk full?"
PNG_END = b"\0\0\0\0IEND\xaeB`\x82"
_tidied: set[Path] = set()  # folders, once per process


@contextmanager
def replacing(path: str | Path) -> Iterator[Path]:
    """Write to a temporary file and move it to its target on success.

    Yields: an empty file in the same folder, with the same suffix, to write to. Removed on error.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise OSError(errno.EISDIR, "is not a regular file, so it is not replaced", str(path))
    with ExitStack() as held:
        try:
            temporary = held.enter_context(beside(target))
            temporary.open("xb").close()
        except OSError as error:
            raise OSError(error.errno, f"cannot be written: {error.strerror}", str(path)) from None
        try:
            yield temporary
            with temporary.open("r+b") as file:
                try:  # a full disk may be reported only then
                    os.fsync(file.fileno())
                except OSError as error:
                    if error.errno in (*NO_SPACE, errno.EIO):  # others: not supported
                        raise
            temporary.replace(target)
        except OSError as error:
            is_own = error.filename is None or str(error.filename) == str(temporary)
            if error.errno not in NO_SPACE or not is_own:
                raise
            raise unwritten(path, error) from None


def unwritten(path: str | Path, error: OSError) -> OSError:
    """Error for a file that cannot be written, with its own name instead of the temporary one."""
    if error.errno is None or error.errno not in NO_SPACE:
        return OSError(f"{path} cannot be written: {one_line(error)}")
    return OSError(error.errno, f"cannot be written: {os.strerror(error.errno)}", str(path))


def refused(path: str | Path, temporary: Path, why: str) -> OSError:
    """Error for a file that a library could not write."""
    try:
        with temporary.open("ab", buffering=0) as file:
            left = PROBE
            while left:
                left -= file.write(bytes(left)) or 0
            os.fsync(file.fileno())
    except OSError as error:
        if error.errno in NO_SPACE:
            return unwritten(path, error)
    return OSError(f"{path} cannot be written: {why}")


def check_end(path: str | Path, temporary: Path) -> None:
    """Reject a truncated PNG or MP4 file from a library."""
    kind, size = temporary.suffix.lower(), temporary.stat().st_size
    with temporary.open("rb") as file:
        if kind == ".png":
            file.seek(max(0, size - len(PNG_END)))
            is_whole = file.read() == PNG_END
        else:
            place = 0 if kind in (".mp4", ".mov") else size
            while place < size:  # from box to box
                file.seek(place)
                head = file.read(16)
                length = int.from_bytes(head[:4], "big")
                length = int.from_bytes(head[8:], "big") if length == 1 else length
                if length < 8:
                    break
                place += length
            is_whole = place == size
    if not is_whole:
        raise refused(path, temporary, INCOMPLETE)


class _Plain(io.FileIO):
    """File without a descriptor, so that all writes go through Python."""

    def fileno(self) -> int:
        raise io.UnsupportedOperation("bytes are written through Python")


def save_array(path: Path, values: "ArrayLike") -> None:
    """Write an array as NPY; NumPy does not notice a full disk."""
    import numpy as np

    with io.BufferedWriter(_Plain(path, "wb")) as file:
        np.save(file, values)


@contextmanager
def beside(target: Path) -> Iterator[Path]:
    """Unused name beside a target, for a temporary file or folder.

    Yields: the name: hidden, with the same suffix. Whatever has it at the end is removed.
    """
    if target.parent not in _tidied:
        _tidied.add(target.parent)
        remove_left(target.parent)
    with ExitStack() as held:
        while True:
            owner = f"{_machine()}-{secrets.token_hex(4)}"
            lock = target.with_name(f".{target.stem[:MOST]}.lock-{owner}")
            held.callback(_remove, lock)  # first, as a signal may come as soon as there is the file
            opened = os.open(lock, os.O_CREAT | os.O_EXCL | os.O_RDWR, 0o666)
            held.callback(os.close, opened)
            try:
                take_lock(opened, lock)
            except BlockingIOError:  # a process that tidies up has just found it
                continue
            except OSError:  # a file system without locks, where nothing is tidied up
                pass
            break
        temporary = target.with_name(_start_of(lock) + target.suffix)
        held.callback(_remove, temporary)
        yield temporary


def _start_of(lock: Path) -> str:
    """Beginning of the names of temporary files that belong to a lock."""
    return LOCK.sub(r"\1.tmp-\2\3", lock.name)


def take_lock(opened: int, path: Path) -> None:
    """Lock an open file or folder until it is closed or the process ends; Windows has no locks.

    A BlockingIOError says that another process has it, or has removed it.
    """
    if fcntl is None:
        return
    fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    with suppress(FileNotFoundError):
        if os.path.samestat(os.fstat(opened), os.stat(path)):
            return
    raise BlockingIOError(errno.EAGAIN, "has just been removed", str(path))


def remove_left(folder: Path) -> None:
    """Remove leftovers of dead processes of this machine from a folder.

    Files of living processes and of other machines stay, as do those that cannot be removed.
    """
    names: list[str] = []
    with suppress(OSError):
        names = os.listdir(folder)
    for name in names:
        found, lock = LOCK.fullmatch(name), folder / name
        if fcntl is None or found is None or found[2] != _machine():
            continue
        with suppress(OSError), ExitStack() as held:
            how = os.O_RDWR if os.access(lock, os.W_OK) else os.O_RDONLY
            opened = os.open(lock, how | os.O_NONBLOCK)
            held.callback(os.close, opened)
            take_lock(opened, lock)
            for one in names:
                if f"{one}.".startswith(f"{_start_of(lock)}."):
                    _remove(folder / one)
            lock.unlink()


def _remove(path: Path) -> None:
    with suppress(OSError):
        if path.is_dir():
            shutil.rmtree(path)
        else:
            path.unlink(missing_ok=True)


@cache
def _machine() -> str:
    return sha256(node().encode()).hexdigest()[:6]


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write a mapping to a JSON file."""
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")


def check_targets(*paths: Path | None) -> None:
    """Reject files that could not be written, before any work is done; None is skipped."""
    given = [path for path in paths if path is not None]
    if len({path.resolve() for path in given}) < len(given):
        raise ValueError(f"{given[0]} cannot be written twice; give each output its own name")
    for path in given:
        with suppress(_Abandoned), replacing(path):
            raise _Abandoned


class _Abandoned(Exception):  # noqa: N818 - no error: the file was only tried
    """Raised to leave the target of `replacing` unchanged."""


def load_arrays(
    file: Path, *names: str, is_beside: bool = False
) -> "dict[str, NDArray[Any]] | None":
    """Load the arrays of a cache file and mark it as used; None if it is missing or damaged.

    `is_beside`: it is beside the data, and as trusted as these; any other file must be the user's.
    """
    from resample.memory.mapped import FOLDER_VARIABLE
    from resample.reading.arrays import read_npz

    try:
        if not is_beside:
            check_own(file.parent)
            check_own(file)
        held = read_npz(file, *names)  # checks its checksums
    except NotOwnError as error:
        tell_unused(error, FOLDER_VARIABLE)
        return None
    except (ValueError, OSError, LookupError):
        return None
    with suppress(OSError):
        os.utime(file)
    return held


def store_arrays(file: Path, arrays: Mapping[str, Any], most: int | None = None) -> bool:
    """Write arrays to a cache file, and return whether that succeeded.

    `most`: limit on the bytes of all files in its folder; the least recently used make room. None:
    the folder is not ours, so none are removed.
    """
    import numpy as np

    size = sum(np.asarray(array).nbytes for array in arrays.values())
    if most is not None and size > most:
        return False
    with suppress(OSError):
        file.parent.mkdir(0o755, parents=True, exist_ok=True)
        if most is not None:
            check_own(file.parent)
            files = [(entry.stat(), entry) for entry in file.parent.glob("*.np[yz]")]
            total = size + sum(stat.st_size for stat, _ in files)
            for stat, entry in sorted(files, key=lambda pair: pair[0].st_mtime):
                if total > most:
                    entry.unlink(missing_ok=True)
                    total -= stat.st_size
        with replacing(file) as temporary, temporary.open("wb") as stream:
            temporary.chmod(temporary.stat().st_mode & ~BY_OTHERS)
            np.savez(stream, **arrays)
        return True
    return False


@cache
def source_fingerprint(*names: str) -> str:
    """Fingerprint of the source code of modules and packages, and of the engine, for caches."""
    digest = sha256()
    for name in ("resample.types", "resample.engine", *names):
        spec = find_spec(name)
        if spec is None or spec.origin is None:
            raise ModuleNotFoundError(f"no source code of {name}", name=name)
        folders = spec.submodule_search_locations or ()
        files = [file for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
        for file in files or [Path(spec.origin)]:
            digest.update(file.read_bytes())
    return digest.hexdigest()
