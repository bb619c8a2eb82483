"""Validate the data sizes of VTK's XML files before VTK allocates memory by them."""

import base64
import re
import struct
from collections.abc import Iterator
from math import prod
from mmap import ACCESS_READ, mmap
from pathlib import Path

from resample.reading.limits import check_ratio, check_unpacked
from resample_volume.data.memory import require_memory
from resample_volume.files.xml.vtk_elements import APPENDED, Element, data_start, elements_of

WHOLE = ("ImageData", "RectilinearGrid", "StructuredGrid")  # elements that pieces fill
ARRAYS = ("DataArray", "Array")
NUMBER = re.compile(r"-?\d{1,12}", re.ASCII)
LARGEST = 1 << 40  # largest plausible count
WIDEST = 32  # bytes of an empty text
WIDTHS = {"8": 1, "6": 2, "2": 4, "4": 8}  # bytes of a number, by the last digit of its type
LETTERS = 32  # of base64, in which there are three numbers of 64 bits
LETTER = re.compile(rb"[A-Za-z0-9+/]*")


def check_blocks(path: Path) -> None:
    """Reject data whose sizes exceed what the file can hold: VTK would end the process."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        every = elements_of(content)
        if not every:
            raise ValueError(f"{path.name} is damaged: it is no XML")
        _check_packed(path.name, content, every)
        _check_counts(path.name, len(content), every)


def count_of(text: str) -> int:
    """Parse a count; an invalid one counts as large."""
    number = _number(text)
    return LARGEST if number < 0 else number


def _check_counts(name: str, size: int, every: list[Element]) -> None:
    """Reject arrays for which VTK would allocate far more than the file can fill."""
    needed = places = whole = filled = 0
    for element in every:
        attributes = element.attributes
        if element.name == "Piece":
            places = _places(attributes)
            filled += places
            needed += places
        elif element.name in WHOLE:
            whole = _inside(attributes.get("WholeExtent", ""))
        elif element.name in ARRAYS:
            rows = max(places, count_of(attributes.get("NumberOfTuples", "0")))
            width = WIDTHS.get(attributes.get("type", "")[-1:], WIDEST)
            needed += rows * count_of(attributes.get("NumberOfComponents", "1")) * width
        check_ratio(name, size, needed)
    if whole > filled:
        raise ValueError(f"{name} is damaged: its pieces hold {filled} of {whole} points")
    require_memory(needed, name)


def _places(attributes: dict[str, str]) -> int:
    """Return a piece's number of points, or of cells if larger; at least one."""
    counts = [count_of(attributes.get(key, "1")) for key in ("NumberOfPoints", "NumberOfCells")]
    return max(1, _inside(attributes.get("Extent", "")), *counts)


def _inside(extent: str) -> int:
    """Return the points within an extent; 0 for an invalid one."""
    ends = [_number(end) for end in extent.split()]
    if len(ends) != 6:
        return 0
    return prod(max(0, b - a + 1) for a, b in zip(ends[::2], ends[1::2], strict=True))


def _number(text: str) -> int:
    """Parse an integer; an invalid one counts as large."""
    known = NUMBER.fullmatch(text.strip())
    return int(text) if known else LARGEST


def _check_packed(name: str, content: mmap, every: list[Element]) -> None:
    size, attributes = len(content), every[0].attributes
    number = "<Q" if attributes.get("header_type") == "UInt64" else "<I"
    if attributes.get("byte_order") == "BigEndian":
        number = number.replace("<", ">")
    is_packed = "compressor" in attributes
    if every[-1].name == APPENDED and data_start(content, every[-1]) < 0:
        raise ValueError(f"{name} is damaged: its data do not begin with an underscore")
    unpacked = 0
    for begin in _begins(content, every):
        numbers = [one for (one,) in struct.iter_unpack(number, _whole(begin, number))]
        if not numbers or (is_packed and numbers[0] and len(numbers) < 2):
            raise ValueError(f"{name} is damaged: data do not begin with their size")
        if numbers[0] > size:
            raise ValueError(f"{name} is damaged: {numbers[0]} bytes or blocks are not there")
        if is_packed and len(numbers) > 1:
            if numbers[0] and not numbers[1]:  # VTK divides by it
                raise ValueError(f"{name} is damaged: blocks of data have no size")
            unpacked += numbers[0] * numbers[1]
            check_unpacked(name, size, unpacked)


def _begins(content: mmap, every: list[Element]) -> Iterator[bytes]:
    """Return the first bytes of each array's data."""
    appended = every[-1] if every[-1].name == APPENDED else None
    start = -1 if appended is None else data_start(content, appended)
    for element in every:
        attributes = element.attributes
        if attributes.get("format") == "binary" and element.data >= 0:
            yield _decoded(content[element.data : element.data + LETTERS])
        elif appended is not None and (attributes.get("offset") or "-").strip().isdecimal():
            place = start + count_of(attributes["offset"])
            begin = content[place : place + LETTERS]
            yield _decoded(begin) if appended.attributes.get("encoding") == "base64" else begin


def _decoded(letters: bytes) -> bytes:
    """Decode base64 up to the first invalid character or padding."""
    known = LETTER.match(letters)
    found = known[0] if known else b""
    found = found[: len(found) - (len(found) % 4 == 1)]
    return base64.b64decode(found + b"=" * (-len(found) % 4))


def _whole(begin: bytes, number: str) -> bytes:
    """Return the bytes of two numbers, or of fewer at the end."""
    width = struct.calcsize(number)
    return begin[: min(2, len(begin) // width) * width]
