"""Read NumPy files, `.npy` and `.npz`, after checking their headers and sizes."""

import math
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from resample.messages import one_line
from resample.reading.limits import check_members, check_unpacked

MAGIC = b"\x93NUMPY"  # first bytes of an array's file


class DamageError(OSError):
    """A file of arrays is damaged, truncated or of another kind."""

    def __init__(self, path: Path, reason: str) -> None:
        what = "holds no arrays that can be read" if path.suffix == ".npy" else "is damaged"
        super().__init__(f"{path} {what}: {reason}")
        self.reason = reason


@contextmanager
def _damage(path: Path) -> Iterator[None]:
    """Convert the dozen error types of damaged arrays to one."""
    try:
        yield
    except MemoryError:
        raise
    except (FileNotFoundError, PermissionError, IsADirectoryError):
        raise
    except Exception as error:  # of tokenize, zipfile, zlib, struct, numpy
        raise DamageError(path, f"{one_line(error):.200}") from None


def is_npy(path: Path) -> bool:
    """Whether a file begins like a `.npy` file."""
    with path.open("rb") as file:
        return file.read(len(MAGIC)) == MAGIC


def read_npy(path: Path, *, mapped: bool = False) -> NDArray[Any]:
    """Read a `.npy` file, or map it to memory."""
    with _damage(path), path.open("rb") as file:
        needed = _declared_bytes(file)
        given = path.stat().st_size - file.tell()
        if needed > given:
            raise ValueError(f"it is cut off: {given} of {needed} bytes are there")
        if mapped and needed:
            found: NDArray[Any] = np.lib.format.open_memmap(path, mode="r")
            return found
        file.seek(0)
        values: NDArray[Any] = np.lib.format.read_array(file, allow_pickle=False)
        return values


def npz_names(path: Path) -> list[str]:
    """Names of the arrays of a `.npz` file; errors as in `read_npz`."""
    with _damage(path), zipfile.ZipFile(path) as packed:
        return [_name(member) for member in packed.namelist()]


def read_npz(path: Path, *names: str) -> dict[str, NDArray[Any]]:
    """Read arrays of a `.npz` file by name: those requested, or all.

    Raises OSError: the file is missing, damaged or truncated, or contains objects. Raises
    ValueError: it unpacks to more than the limits allow. Raises LookupError: it has no such array.
    """
    found: dict[str, NDArray[Any]] = {}
    with _damage(path):
        packed = zipfile.ZipFile(path)
    with packed:
        members = {_name(info.filename): info for info in packed.infolist()}
        check_members(str(path), packed.infolist(), "arrays")
        wanted = names or tuple(members)
        missing = [name for name in wanted if name not in members]
        if missing:
            raise LookupError(f"{path} has no array {missing[0]!r}; it has {', '.join(members)}")
        unpacked = sum(members[name].file_size for name in wanted)
        check_unpacked(str(path), path.stat().st_size, unpacked)
        for name in wanted:
            with _damage(path), packed.open(members[name]) as file:
                needed, start = _declared_bytes(file), file.tell()
                if needed > members[name].file_size - start:
                    raise ValueError(f"{name} is cut off")
            with _damage(path), packed.open(members[name]) as file:
                found[name] = np.lib.format.read_array(file, allow_pickle=False)
                file.read(1)  # verifies the checksum
    return found


def _name(member: str) -> str:
    return member.removesuffix(".npy")


def _declared_bytes(file: IO[bytes]) -> int:
    """Bytes of the values declared in a header, which is read."""
    version = np.lib.format.read_magic(file)
    headers = {
        (1, 0): np.lib.format.read_array_header_1_0,
        (2, 0): np.lib.format.read_array_header_2_0,
    }
    if version not in headers:  # 3.0 is for non-Latin names of record fields
        raise ValueError(f"version {version} of the format is not supported")
    shape, _, kind = headers[version](file)
    if kind.hasobject:
        raise ValueError("it contains Python objects, which are not supported")
    if kind.itemsize < 1 or any(size < 0 or size >= 1 << 62 for size in shape):
        raise ValueError(f"{kind} of shape {shape} are not numbers")
    return math.prod(shape) * int(kind.itemsize)
