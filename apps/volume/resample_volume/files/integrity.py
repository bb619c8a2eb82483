"""Is all of the data there? ITK 5.4 reads on where it is not, and leaves zeros or noise.

Found by trying (`tests/volume/test_readers.py` keeps it so): a truncated or corrupt `.nii` or
`.nii.gz` is read without a word; so is a compressed MetaImage whose stream ends early, and any
detached file that is longer than its header says. NRRD's own library finds all but the last.
"""

import gzip
import math
import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, NamedTuple

from resample.reading.headers import (
    check_meta_numbers,
    check_nrrd_numbers,
    whole,
)
from resample.reading.limits import check_items, check_unpacked
from resample.reading.neighbours import neighbour
from resample_volume.files.headers import Header

PATTERN = re.compile(r"[^%]*%0?\d{0,2}d[^%]*")  # of names with a number in them
BLOCK = 1 << 20  # bytes unpacked at a time
SLACK = 16 * BLOCK  # bytes beyond what is wanted that are still counted


def wrong_size(name: str, given: int, wanted: int, *, more: str = "") -> ValueError:
    """Make the error for data of the wrong size, both in bytes."""
    return ValueError(
        f"{name} holds {given}{more} bytes, {wanted} are wanted; correct the shape and "
        "type, or get the file again"
    )


@contextmanager
def unpacking(name: str) -> Iterator[None]:
    """Turn the three ways in which damaged gzip shows into one."""
    try:
        yield
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise ValueError(f"{name} is damaged: {error}; get the file again") from None


class Fields(NamedTuple):
    """A text header's `key: value` or `key = value` lines."""

    value: dict[str, str]  # keys in lower case
    end: int  # bytes; where the data begins if it is in the same file


def text_fields(path: Path, separator: str, last: str = "") -> Fields:
    """Read a text header until an empty line or the key that ends it."""
    value: dict[str, str] = {}
    with path.open("rb") as file:
        while file.tell() < BLOCK:  # no header is longer
            text = file.readline(4096).decode("utf-8", "surrogateescape").strip()
            if not text:
                break
            key, found, rest = text.partition(separator)
            if found and not text.startswith("#"):
                value[key.strip().lower()] = rest.strip()
            if last and key.strip().lower() == last:
                break
        return Fields(value, file.tell())


def check_nrrd(path: Path) -> tuple[Path, str] | None:
    """Find the one file that a detached header points to, and how it is packed.

    None where the data is attached, in many files, or begins somewhere inside.

    Raises
    ------
    FileNotFoundError
        It is not there.
    """
    value = text_fields(path, ":").value
    check_nrrd_numbers(path, value)
    data = value.get("data file", value.get("datafile", ""))
    if not data or _check_many(path, data):
        return None
    file = _beside(path, data)
    skips = {"byte skip", "line skip", "byteskip", "lineskip"} & value.keys()
    return None if skips else (file, value.get("encoding", ""))


def check_nrrd_size(detached: tuple[Path, str], known: Header) -> None:
    """Compare a detached file with its header.

    Gzip is unpacked for it only where its last bytes state another size; that it is short or cut
    off, or in several pieces, is left to NRRD's library.
    """
    file, packing = detached
    given = known.size
    if packing == "raw":
        given = file.stat().st_size
    elif packing in ("gzip", "gz"):
        check_unpacked(file.name, file.stat().st_size, known.size)
        if _gzip_claim(file) != known.size:
            given = max(known.size, _inflated(file, 0, known.size))
    if given != known.size:
        raise wrong_size(file.name, given, known.size, more=_or_more(given, known.size))


def check_metaimage(path: Path, known: Header | None = None) -> None:
    """Find a MetaImage's data, and compare it with the header once that is known.

    Raises
    ------
    FileNotFoundError
        The data's file is not there.
    ValueError
        Too few bytes, too many in a file of their own, or a damaged compressed stream.
    """
    value, end = text_fields(path, "=", "elementdatafile")
    check_meta_numbers(path, value)
    data = value.get("elementdatafile", "")
    if not data:
        raise ValueError(f"{path.name} is not a MetaImage: its header names no ElementDataFile")
    if _check_many(path, data):
        return
    local = data.upper() == "LOCAL"
    file = path if local else _beside(path, data)
    skipped = whole(path, value.get("headersize", "0"))
    start = (end if local else 0) + max(0, skipped)
    if known is None or value.get("binarydata", "true").lower() == "false":
        return
    if value.get("compresseddata", "false").lower() == "true":
        check_unpacked(file.name, file.stat().st_size, known.size)
        given = _inflated(file, start, known.size)
    else:
        given = file.stat().st_size - start
    is_loose = local or skipped != 0
    if given < known.size or (given > known.size and not is_loose):
        raise wrong_size(file.name, given, known.size, more=_or_more(given, known.size))


def _or_more(given: int, wanted: int) -> str:
    """Words for a count that was given up."""
    return " or more" if given > wanted + SLACK else ""


def copied(source: gzip.GzipFile, target: IO[bytes], most: int) -> int:
    """Copy bytes, at most so many, and count them."""
    count = 0
    while count < most and (block := source.read(min(BLOCK, most - count))):
        count += target.write(block)
    return count


def nifti_size(start: bytes, name: str) -> int:
    """Bytes that a NIfTI file has according to its header, the first 348.

    Raises
    ------
    ValueError
        It is not NIfTI-1, has an empty dimension, or a pixdim that ITK would quietly make 1.
    """
    order = {struct.pack("<i", 348): "<", struct.pack(">i", 348): ">"}.get(start[:4])
    if start[4:7] == b"n+2":
        raise ValueError(f"{name} is NIfTI-2, which ITK does not read; convert it to NIfTI-1")
    if order is None or start[344:347] != b"n+1":
        raise ValueError(f"{name} is not a NIfTI file of one piece, or its header is cut off")
    shape = struct.unpack_from(order + "8h", start, 40)
    step = struct.unpack_from(order + "8f", start, 76)
    (bits,) = struct.unpack_from(order + "h", start, 72)
    (offset,) = struct.unpack_from(order + "f", start, 108)
    used = shape[1 : 1 + max(0, shape[0])]
    if not used or min(used) < 1:
        raise ValueError(f"{name} is empty: {used} voxels; every dimension must be over 0")
    if not all(0 < size < math.inf for size in step[1 : 1 + min(3, len(used))]):
        raise ValueError(f"{name}: spacing {step[1:4]} must be positive and finite; correct pixdim")
    count: int = math.prod(used)
    return int(offset) + count * int(bits) // 8


def _check_many(path: Path, data: str) -> bool:
    """Whether a header names many files of data, in a list or by a pattern; refuses too many.

    ITK looks for each of them, one after the other.
    """
    if data.startswith("LIST"):
        with path.open("rb") as file:
            lines = file.read(BLOCK).decode("utf-8", "surrogateescape").splitlines()
        heads = [n for n, line in enumerate(lines) if "LIST" in line]
        names = [line.strip() for line in lines[heads[0] + 1 :]] if heads else []
    elif "%" in data:
        pattern, *numbers = data.split()
        if not PATTERN.fullmatch(pattern) or not numbers:  # ITK hands it to printf
            raise ValueError(
                f"{path.name}: {data!r:.60} is no pattern of names; give one such as "
                "a%03d.raw 1 99 1"
            )
        first, last, step = (whole(path, word) for word in [*numbers, *"111"][:3])
        check_items(path.name, abs(last - first) // max(1, abs(step)) + 1, "files named")
        names = [pattern.partition("%")[0] or "."]
    else:
        return False
    named = [name for name in names if name and ":" not in name[2:]]
    check_items(path.name, len(named), "files named")
    for name in named:
        neighbour(path, name)
    return True


def _beside(path: Path, name: str) -> Path:
    file = neighbour(path, name)
    if not file.is_file():
        raise FileNotFoundError(f"{path.name} wants its data in {name}, which is not beside it")
    return file


def _gzip_claim(file: Path) -> int:
    """Unpacked size that the last four bytes state, modulo 4 GiB; of the last member if many."""
    with file.open("rb") as packed:
        packed.seek(max(0, file.stat().st_size - 4))
        return int.from_bytes(packed.read(4), "little")


def _inflated(file: Path, start: int, wanted: int) -> int:
    """Bytes that a zlib or gzip stream unpacks to, counted until they are far more than wanted."""
    count, unpacker = 0, zlib.decompressobj(wbits=47)
    with file.open("rb") as packed, unpacking(file.name):
        packed.seek(start)
        for block in iter(lambda: packed.read(BLOCK), b""):
            piece = unpacker.decompress(block, BLOCK)
            while piece:
                count += len(piece)
                if count > wanted + SLACK:
                    return count
                piece = unpacker.decompress(unpacker.unconsumed_tail, BLOCK)
        if not unpacker.eof:
            raise EOFError("the compressed data ends early")
    return count
