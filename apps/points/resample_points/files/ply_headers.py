"""Read the headers of PLY files: elements, their properties, and comments."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

LONGEST_HEADER = 1000  # lines
LONGEST_LINE = 1 << 12  # bytes of a line of the header
MOST_DIGITS = 30  # digits of a count
PLY_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1",
    "short": "i2", "int16": "i2", "ushort": "u2", "uint16": "u2",
    "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
PLY_FORMATS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
SCALAR, LIST = 3, 5  # words of a property's line


class PlyProperty(NamedTuple):
    """A number of an element, or a list of numbers."""

    name: str
    kind: str  # of NumPy
    length: str  # of NumPy: type of a list's length; empty for a number


@dataclass(frozen=True)
class PlyElement:
    """Records of one kind in a file."""

    name: str
    records: int
    properties: tuple[PlyProperty, ...]

    @property
    def has_lists(self) -> bool:
        """Whether records may differ in size."""
        return any(each.length for each in self.properties)

    def scalars(self) -> np.dtype[Any]:
        """Return the type of the properties that are no lists."""
        return np.dtype([(each.name, each.kind) for each in self.properties if not each.length])


@dataclass(frozen=True)
class PlyHeader:
    """The header of a PLY file."""

    path: Path
    encoding: str  # one of PLY_FORMATS
    elements: list[PlyElement]
    comments: list[str]  # in lower case
    start: int  # bytes of the header

    def split_at(self, name: str) -> tuple[list[PlyElement], PlyElement]:
        """Return the elements before one, and that one."""
        place = next((n for n, each in enumerate(self.elements) if each.name == name), None)
        if place is None:
            raise ValueError(f"has no element {name}")
        return self.elements[:place], self.elements[place]


def ply_header(path: Path) -> PlyHeader:
    """Read the header of a PLY file."""
    with path.open("rb") as file:
        lines = _lines(file)
        start = file.tell()
    encoding = [" ".join(words[1:2]) for words in lines if words[0] == "format"][-1:]
    if not encoding or encoding[0] not in PLY_FORMATS:
        known = ", ".join(PLY_FORMATS)
        raise ValueError(f"has the PLY format {' '.join(encoding)!r:.40}; known: {known}")
    comments, elements = [], list[tuple[str, int, list[PlyProperty]]]()
    for words in lines:
        if words[0] == "comment":
            comments.append(" ".join(words[1:]).lower())
        elif words[0] == "element":
            elements.append((*_named_count(words), []))
        elif words[0] == "property" and elements:
            elements[-1][2].append(_property(words, PLY_FORMATS[encoding[0]]))
    _check_unique([name for name, _, _ in elements], "an element")
    for _, _, properties in elements:
        _check_unique([each.name for each in properties], "a property")
    made = [PlyElement(name, count, tuple(properties)) for name, count, properties in elements]
    return PlyHeader(path, encoding[0], made, comments, start)


def _lines(file: BinaryIO) -> list[list[str]]:
    """Read the words of the header's lines after the first."""
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise ValueError("is not a PLY file: it does not begin with ply and end_header after it")
    lines: list[list[str]] = []
    for _ in range(LONGEST_HEADER):
        words = file.readline(LONGEST_LINE).decode("latin-1").split()
        if words == ["end_header"]:
            return lines
        if words:
            lines.append(words)
    raise ValueError("is not a PLY file: its header has no end, a line end_header")


def _named_count(words: list[str]) -> tuple[str, int]:
    """Return the name and number of an element."""
    if len(words) != SCALAR or not words[2].isdecimal() or len(words[2]) > MOST_DIGITS:
        raise ValueError(f"has a PLY header with {' '.join(words)!r:.60}; it needs a whole number")
    return words[1], int(words[2])


def _property(words: list[str], order: str) -> PlyProperty:
    """Read a property from a header's line; `order` is NumPy's letter of the byte order."""
    is_list = words[1:2] == ["list"]
    kinds = [PLY_TYPES.get(word, "") for word in words[1 + is_list : -1]]
    line = f"{' '.join(words)!r:.60}"
    if len(words) != (LIST if is_list else SCALAR) or not all(kinds):
        raise ValueError(f"has {line}, which is no number and no list of numbers")
    if is_list and kinds[0][0] == "f":
        raise ValueError(f"has {line}: a list's length must be a whole number")
    return PlyProperty(words[-1], order + kinds[-1], order + kinds[0] if is_list else "")


def _check_unique(names: Sequence[str], what: str) -> None:
    if len(set(names)) < len(names):
        raise ValueError(f"has {what} twice: {max(names, key=names.count)!r:.60}")
