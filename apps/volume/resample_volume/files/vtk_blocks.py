"""Sizes of packed data within VTK's XML files, looked at before VTK makes room for them."""

import base64
import re
import struct
from collections.abc import Iterator
from math import prod
from mmap import ACCESS_READ, mmap
from pathlib import Path

from resample.reading.limits import check_ratio, check_unpacked
from resample_volume.files.memory import require_memory

TAG = re.compile(rb"<(Piece|DataArray|Array|ImageData|RectilinearGrid|StructuredGrid)\b([^<>]*)>")
ATTRIBUTE = re.compile(rb'(\w+)="([^"]*)"')
NUMBER = re.compile(rb"-?\d{1,12}")
LARGEST = 1 << 40  # of a count that is believed
WIDEST = 32  # bytes of a text that is empty
WIDTHS = {b"8": 1, b"6": 2, b"2": 4, b"4": 8}  # bytes of a number, by the last digit of its type
LETTERS = 32  # of base64, in which there are three numbers of 64 bits
APPENDED = re.compile(rb"<AppendedData([^>]*)>\s*_")
LETTER = re.compile(rb"[A-Za-z0-9+/]*")
INLINE = re.compile(rb'format="binary"[^>]*>\s*([^<\s]{1,32})')


def check_blocks(path: Path) -> None:
    """Refuse data whose sizes are not those of what the file can hold: VTK ends the process.

    Raises
    ------
    ValueError
        There are more blocks, or bytes, than the file has, or they unpack to far too much.
    """
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        _check(path, content)


def check_counts(path: Path) -> None:
    """Refuse arrays for which VTK would make far more room than the file can fill.

    Raises
    ------
    ValueError
        Points, cells or numbers at each take more than the file can honestly hold, or memory has;
        or pieces do not fill the whole.
    """
    needed = places = whole = filled = 0
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        appended = content.find(b"<AppendedData")
        for found in TAG.finditer(content, 0, appended if appended >= 0 else len(content)):
            told = dict(ATTRIBUTE.findall(found[2]))
            if found[1] == b"Piece":
                places = _places(told)
                filled += places
                needed += places
            elif not found[1].endswith(b"Array"):
                whole = _inside(told.get(b"WholeExtent", b""))
            else:
                rows = max(places, _count(told.get(b"NumberOfTuples", b"0")))
                width = WIDTHS.get(told.get(b"type", b"")[-1:], WIDEST)
                needed += rows * _count(told.get(b"NumberOfComponents", b"1")) * width
            check_ratio(path.name, len(content), needed)
    if whole > filled:
        raise ValueError(f"{path.name} is damaged: its pieces hold {filled} of {whole} points")
    require_memory(needed, path.name)


def _places(told: dict[bytes, bytes]) -> int:
    """Points of a piece, or its cells where these are more; at least one."""
    counts = [_count(told.get(key, b"1")) for key in (b"NumberOfPoints", b"NumberOfCells")]
    return max(1, _inside(told.get(b"Extent", b"")), *counts)


def _inside(extent: bytes) -> int:
    """Points within an extent; none of what is no extent."""
    ends = [_number(end) for end in extent.split()]
    if len(ends) != 6:
        return 0
    return prod(max(0, b - a + 1) for a, b in zip(ends[::2], ends[1::2], strict=True))


def _count(text: bytes) -> int:
    """Count as a number; what is none counts as many."""
    number = _number(text)
    return LARGEST if number < 0 else number


def _number(text: bytes) -> int:
    """Whole number; what is none is a large one."""
    known = NUMBER.fullmatch(text.strip())
    return int(text) if known else LARGEST


def _check(path: Path, content: mmap) -> None:
    size = len(content)
    number = "<Q" if b'header_type="UInt64"' in content[:1000] else "<I"
    if b'byte_order="BigEndian"' in content[:1000]:
        number = number.replace("<", ">")
    is_packed = b"compressor=" in content[:1000]
    if content.find(b"<AppendedData") >= 0 and not APPENDED.search(content):
        raise ValueError(f"{path.name} is damaged: its data do not begin with an underscore")
    unpacked = 0
    for begin in _begins(content):
        numbers = [one for (one,) in struct.iter_unpack(number, _whole(begin, number))]
        if not numbers or (is_packed and numbers[0] and len(numbers) < 2):
            raise ValueError(f"{path.name} is damaged: data do not begin with their size")
        if numbers[0] > size:
            raise ValueError(f"{path.name} is damaged: {numbers[0]} bytes or blocks are not there")
        if is_packed and len(numbers) > 1:
            if numbers[0] and not numbers[1]:  # VTK divides by it
                raise ValueError(f"{path.name} is damaged: blocks of data have no size")
            unpacked += numbers[0] * numbers[1]
            check_unpacked(path.name, size, unpacked)


def _begins(content: mmap) -> Iterator[bytes]:
    """First bytes of each array's data."""
    for found in INLINE.finditer(content):
        yield _decoded(found[1])
    appended = APPENDED.search(content)
    if appended is None:
        return
    is_text = b"base64" in appended[1]
    for found in re.finditer(rb'\soffset="(\d{1,18})"', content[: appended.start()]):
        place = appended.end() + int(found[1])
        begin = content[place : place + LETTERS]
        yield _decoded(begin) if is_text else begin


def _decoded(letters: bytes) -> bytes:
    """Bytes of the letters before the first that is none of base64, or that fills a group up."""
    known = LETTER.match(letters)
    found = known[0] if known else b""
    found = found[: len(found) - (len(found) % 4 == 1)]
    return base64.b64decode(found + b"=" * (-len(found) % 4))


def _whole(begin: bytes, number: str) -> bytes:
    """Bytes of two numbers, or of as many as there are."""
    width = struct.calcsize(number)
    return begin[: min(2, len(begin) // width) * width]
