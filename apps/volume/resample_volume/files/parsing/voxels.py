"""Read voxels: raw, compressed or as text, in one file or several."""

import bz2
import gzip
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_size, check_unpacked
from resample_volume.data.memory import require_memory
from resample_volume.files.parsing.headers import VolumeHeader, check_not_empty

BLOCK = 1 << 20  # bytes decompressed at a time
TEXTS = ("text", "hex")
SLACK = 16 * BLOCK  # excess bytes that are still counted


class VoxelData(NamedTuple):
    """Location and encoding of a file's voxels."""

    paths: list[Path]  # one, or several with equal parts of them
    start: int = 0  # bytes before them; where negative they are the last of the file
    packing: str = "raw"  # raw, gzip (zlib's form, too), bzip2, text or hex
    skip: int = 0  # bytes before them that are compressed as well
    is_exact: bool = True  # nothing may follow them


def voxels(stored: VoxelData, known: VolumeHeader) -> NDArray[Any]:
    """Read all numbers (N,) of a volume, in the file's type; raw ones are memory mapped.

    Raises ValueError: their number differs from the header, compressed data are damaged, or they do
    not fit in memory.
    """
    check_not_empty(known)
    require_memory(known.size, known.name)
    if len(stored.paths) == 1 and stored.packing == "raw":
        return _bare(stored.paths[0], stored, known.dtype, known.size)
    if stored.packing not in TEXTS:
        packed = sum(path.stat().st_size for path in set(stored.paths))
        check_unpacked(known.name, packed, known.size)  # files may be named several times
    values = np.empty(known.size // known.dtype.itemsize, known.dtype)
    target = values.view(np.uint8).data
    count, rest = divmod(known.size, len(stored.paths))
    if rest:
        raise ValueError(
            f"{known.name}: its voxels are no equal parts of {len(stored.paths)} files"
        )
    for n, path in enumerate(stored.paths):
        _fill(target[n * count : (n + 1) * count], path, stored, known.dtype)
    return values


def first_bytes(path: Path, count: int) -> bytes:
    """Read the first bytes of a file, decompressed if `.gz`; fewer if it is shorter."""
    if path.name.lower().endswith(".gz"):
        with unpacking(path.name), gzip.open(path) as packed:
            return packed.read(count)
    with path.open("rb") as file:
        return file.read(count)


def wrong_size(name: str, given: int, wanted: int, *, more: str = "") -> ValueError:
    """Make the error for data of the wrong size, both in bytes."""
    return ValueError(
        f"{name} holds {given}{more} bytes, {wanted} are wanted; correct the shape and "
        "type, or get the file again"
    )


@contextmanager
def unpacking(name: str) -> Iterator[None]:
    """Convert all errors of damaged compression to one."""
    try:
        yield
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(f"{name} is damaged: {error}; get the file again") from None


def _bare(path: Path, stored: VoxelData, dtype: np.dtype[Any], size: int) -> NDArray[Any]:
    whole = path.stat().st_size
    start = stored.start if stored.start >= 0 else max(0, whole - size)
    given = max(0, whole - start)
    if given < size or (given > size and stored.is_exact):
        raise wrong_size(path.name, given, size)
    count = size // dtype.itemsize
    if start % dtype.itemsize:  # kernels need aligned numbers
        return np.fromfile(path, dtype, count, offset=start)
    return np.memmap(path, dtype, "r", start, (count,))


def _fill(target: memoryview, path: Path, stored: VoxelData, dtype: np.dtype[Any]) -> None:
    if stored.packing in TEXTS:
        numbers = _of_text(path, stored, dtype)
        if len(numbers) != len(target):
            raise wrong_size(path.name, len(numbers), len(target))
        target[:] = numbers
    elif stored.packing == "raw":
        target[:] = _bare(path, stored, np.dtype(np.uint8), len(target)).data
    else:
        # Decompress a file into memory, and verify its checksums
        wanted, packed = len(target) + stored.skip, path.stat().st_size
        check_unpacked(path.name, packed, wanted)
        count = 0
        with path.open("rb") as file, unpacking(path.name):
            file.seek(max(0, stored.start))
            for piece in _pieces(file, stored.packing):
                first = max(0, count - stored.skip)
                begin = max(0, stored.skip - count)
                kept = piece[begin : begin + max(0, len(target) - first)]
                target[first : first + len(kept)] = kept
                count += len(piece)
                if count > wanted + SLACK:
                    raise wrong_size(path.name, count - stored.skip, len(target), more=" or more")
        if count < wanted or (count > wanted and stored.is_exact):
            raise wrong_size(path.name, max(0, count - stored.skip), len(target))


def _of_text(path: Path, stored: VoxelData, dtype: np.dtype[Any]) -> bytes:
    check_size(path.name, path.stat().st_size)
    words = path.read_bytes()[stored.start :].split()
    try:
        if stored.packing == "hex":
            return bytes.fromhex(b"".join(words).decode("ascii"))
        return np.array(words, dtype).tobytes()
    except (ValueError, OverflowError) as error:
        raise ValueError(f"{path.name} is damaged: {error}; get the file again") from None


def _pieces(file: BinaryIO, packing: str) -> Iterator[bytes]:
    """Yield decompressed bytes of one or more concatenated streams."""
    new = bz2.BZ2Decompressor if packing == "bzip2" else lambda: zlib.decompressobj(wbits=47)
    unpacker: Any = new()
    rest = b""
    while block := rest or file.read(BLOCK // 4):
        if unpacker.eof:
            if not block.startswith((b"\x1f\x8b", b"BZh")):  # padding
                return
            unpacker = new()
        try:
            yield unpacker.decompress(block, 4 * BLOCK)
            while not unpacker.eof and not getattr(unpacker, "needs_input", True):
                yield unpacker.decompress(b"", 4 * BLOCK)
        except OSError as error:  # so bzip2 says it
            raise EOFError(error) from None
        rest = getattr(unpacker, "unconsumed_tail", b"") or unpacker.unused_data
    if not unpacker.eof:
        raise EOFError("the compressed data ends early")
