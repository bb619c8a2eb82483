"""Read the headers and elements of PLY files that hold Gaussians."""

import math
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_size
from resample_points.files.parsing import LONGEST_HEADER
from resample_points.files.ply import MOST_DIGITS, PLY_FORMATS, PLY_TYPES

LONGEST_LINE = 1 << 12  # bytes of a line of the header
ANTIALIASED = {"splatrendermode: mip": True, "antialiased 1": True}  # comments of trainers
ANTIALIASED |= {"splatrendermode: default": False, "antialiased 0": False}
VERTICAL = "vertical axis: "


@dataclass(frozen=True)
class GaussianElement:
    """A PLY element: a number of records of a type."""

    name: str
    count: int
    kind: np.dtype[Any] | None  # None: it has lists, whose lengths vary


@dataclass(frozen=True)
class PlyFile:
    """The header of a PLY file."""

    path: Path
    encoding: str  # one of PLY_FORMATS
    elements: list[GaussianElement]
    comments: list[str]  # in lower case
    start: int  # bytes of the header

    def names(self, element: str = "vertex") -> set[str]:
        """Return the names of an element's properties."""
        kinds = [one.kind for one in self.elements if one.name == element and one.kind is not None]
        return {name for kind in kinds for name in kind.names or ()}

    @property
    def is_antialiased(self) -> bool:
        """Whether a comment says so; the last one holds."""
        told = [ANTIALIASED[line] for line in self.comments if line in ANTIALIASED]
        return told[-1] if told else False

    @property
    def up(self) -> str | None:
        """The vertical axis, if a comment names it."""
        told = [line.removeprefix(VERTICAL) for line in self.comments if line.startswith(VERTICAL)]
        return told[-1] if told and told[-1] in {"x", "y", "z"} else None

    def records(self, name: str) -> NDArray[Any]:
        """Return the records (N,) of an element; binary ones are mapped, not read."""
        place = next(n for n, one in enumerate(self.elements) if one.name == name)
        before, wanted = self.elements[:place], self.elements[place]
        if wanted.kind is None or any(one.kind is None and one.count for one in before):
            raise ValueError(f"has lists in or before its element {name}, which Gaussians have not")
        if self.encoding == "ascii":
            return self._parsed(sum(one.count for one in before), wanted)
        at = self.start + sum(one.count * one.kind.itemsize for one in before if one.kind)
        needed, given = wanted.count * wanted.kind.itemsize, self.path.stat().st_size - at
        if needed > given:
            raise OSError(f"{self.path} is cut off: {max(0, given)} of {needed} bytes are there")
        if not needed:
            return np.zeros(0, wanted.kind)
        return np.memmap(self.path, wanted.kind, "r", at, (wanted.count,))

    def _parsed(self, before: int, wanted: GaussianElement) -> NDArray[Any]:
        """Parse the records of a text."""
        size = self.path.stat().st_size
        check_size(str(self.path), size)
        with self.path.open("rb") as file:
            file.seek(self.start)
            for _ in islice(file, min(before, size)):
                pass
            given = islice(file, min(wanted.count, size))
            lines = [line.decode("latin-1") for line in given if line.strip()]
        if len(lines) < wanted.count:
            raise OSError(f"{self.path} is cut off: {len(lines)} of {wanted.count} lines are there")
        try:
            table: NDArray[Any] = np.loadtxt(lines, wanted.kind, comments=None, ndmin=1)
        except ValueError as error:
            raise ValueError(f"is not a table of numbers: {error!s:.100}") from None
        if table.shape != (wanted.count,):
            raise ValueError(f"has {len(table)} records of {wanted.name}, not {wanted.count}")
        return table


def ply_header(path: Path) -> PlyFile:
    """Read the header of a PLY file."""
    with path.open("rb") as file:
        lines = _lines(file)
        start = file.tell()
    encoding, comments = "", []
    described: list[tuple[str, int, list[tuple[str, str]]]] = []
    with_lists = set()
    for words in lines:
        if words[0] == "format":
            encoding = " ".join(words[1:2])
        elif words[0] == "comment":
            comments.append(" ".join(words[1:]).lower())
        elif words[0] == "element":
            described.append((*_named_count(words), []))
        elif words[0] == "property" and described:
            if words[1:2] == ["list"]:
                with_lists.add(len(described) - 1)
            else:
                described[-1][2].append(_property(words))
    if encoding not in PLY_FORMATS:
        raise ValueError(f"has the PLY format {encoding!r:.40}; known: {', '.join(PLY_FORMATS)}")
    _check_unique([name for name, _, _ in described], "an element")
    elements = [
        GaussianElement(name, count, None if n in with_lists else _kind(fields, encoding))
        for n, (name, count, fields) in enumerate(described)
    ]
    return PlyFile(path, encoding, elements, comments, start)


def _lines(file: BinaryIO) -> list[list[str]]:
    """Read the words of the header's lines after the first."""
    if file.readline(LONGEST_LINE).strip() != b"ply":
        raise ValueError("is not a PLY file: it does not begin with ply")
    lines: list[list[str]] = []
    for _ in range(LONGEST_HEADER):
        words = file.readline(LONGEST_LINE).decode("latin-1").split()
        if words == ["end_header"]:
            return lines
        if words:
            lines.append(words)
    raise ValueError("is not a PLY file: its header has no end")


def _named_count(words: list[str]) -> tuple[str, int]:
    """Return the name and number of an element."""
    if len(words) != 3 or not words[2].isdecimal() or len(words[2]) > MOST_DIGITS:
        raise ValueError(f"has a PLY header with {' '.join(words)!r:.60}; it needs a whole number")
    return words[1], int(words[2])


def _property(words: list[str]) -> tuple[str, str]:
    """Return the name and type of a property."""
    if len(words) != 3 or words[1] not in PLY_TYPES:
        raise ValueError(f"has a property {' '.join(words[1:])!r:.60}, which is no number")
    return words[2], PLY_TYPES[words[1]]


def _kind(fields: list[tuple[str, str]], encoding: str) -> np.dtype[Any]:
    """Return the type of a record."""
    _check_unique([name for name, _ in fields], "a property")
    return np.dtype([(name, PLY_FORMATS[encoding] + kind) for name, kind in fields])


def _check_unique(names: list[str], what: str) -> None:
    if len(set(names)) < len(names):
        raise ValueError(f"has {what} twice: {max(names, key=names.count)!r:.60}")


def stacked(records: NDArray[Any], names: list[str]) -> NDArray[np.float32]:
    """Return properties of records in float32 (N, names)."""
    values = np.empty((len(records), len(names)), np.float32)
    with np.errstate(over="ignore"):  # of float64
        for n, name in enumerate(names):
            values[:, n] = records[name]
    return values


def largest_of(values: NDArray[Any]) -> float:
    """Return the largest size among finite numbers."""
    low, high = float(values.min(initial=0)), float(values.max(initial=0))
    if math.isfinite(low) and math.isfinite(high):
        return max(-low, high)
    finite = values[np.isfinite(values)]
    return float(np.abs(finite).max(initial=0))
