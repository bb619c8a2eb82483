"""Read PLY files: points and 3D Gaussians. Lists, and elements before them, are skipped."""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.console import say_of
from resample.reading.limits import check_size
from resample_points.data.cloud import Cloud, cloud_of
from resample_points.data.parts import STEP
from resample_points.files.plain import binary_cloud, check_count, text_fields, text_lines, within

LONGEST_HEADER = 1000  # lines
LONGEST_LINE = 1 << 12  # bytes of a line of the header
MOST_DIGITS = 30  # digits of a count
TYPES = {"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4"}
TYPES |= {"float": "f4", "double": "f8", "float32": "f4", "float64": "f8"}
TYPES |= {"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
GAUSSIANS = (  # columns of 3D Gaussians; each set is sufficient
    {"f_dc_0", "opacity", "scale_0", "rot_0"},
    {"packed_position", "packed_rotation", "packed_scale"},
)
SCALING = re.compile(r"\b(scale|units?|offset|shift|epsg|crs)\b")  # words of comments
ANTIALIASED = {"splatrendermode: mip": True, "antialiased 1": True}  # comments of trainers
ANTIALIASED |= {"splatrendermode: default": False, "antialiased 0": False}


class Property(NamedTuple):
    """A number of an element; a list if `length`, the NumPy type of its length, is given."""

    name: str
    kind: str
    length: str


@dataclass(frozen=True)
class Element:
    """Records of one kind in a file."""

    name: str
    records: int
    properties: list[Property]

    @property
    def has_lists(self) -> bool:
        """Whether records may differ in size."""
        return any(each.length for each in self.properties)

    def scalars(self) -> np.dtype[Any]:
        """Return the type of the scalar properties."""
        return np.dtype([(each.name, each.kind) for each in self.properties if not each.length])


@dataclass(frozen=True)
class PlyFile:
    """A PLY file after its header was read; records are read by the element."""

    path: Path
    encoding: str
    elements: list[Element]
    comments: list[str]  # in lower case
    start: int  # bytes of the header

    def names(self, element: str = "vertex") -> set[str]:
        """Return the names of an element's properties."""
        same = (one for one in self.elements if one.name == element and not one.has_lists)
        return {each.name for one in same for each in one.properties}

    @property
    def is_antialiased(self) -> bool:
        """Whether the last comment about it says so."""
        return [False, *(ANTIALIASED[c] for c in self.comments if c in ANTIALIASED)][-1]

    @property
    def up(self) -> str | None:
        """The vertical axis, if a comment names it."""
        prefix = "vertical axis: "
        told = [c.removeprefix(prefix) for c in self.comments if c.startswith(prefix)]
        return told[-1] if told and told[-1] in {"x", "y", "z"} else None

    def tell_scales(self) -> None:
        """Report comments that change positions, on which programs disagree."""
        for comment in filter(SCALING.search, self.comments):
            say_of(self.path, f"its comment {comment!r:.80} is not applied")

    def split_at(self, name: str) -> tuple[list[Element], Element]:
        """Return the elements before one, and that one."""
        for n, each in enumerate(self.elements):
            if each.name == name:
                return self.elements[:n], each
        raise ValueError(f"has no element {name}")

    def records(self, name: str) -> NDArray[Any]:
        """Return the records (N,) of an element without lists; binary ones are mapped, not read."""
        before, wanted = self.split_at(name)
        if wanted.has_lists or any(one.has_lists and one.records for one in before):
            raise ValueError(f"has lists in or before its element {name}, which Gaussians have not")
        kind, count, size = wanted.scalars(), wanted.records, self.path.stat().st_size
        if self.encoding != "ascii":
            at = self.start + sum(one.records * one.scalars().itemsize for one in before)
            needed, given = count * kind.itemsize, size - at
            if needed > given:
                raise OSError(
                    f"{self.path} is cut off: {max(0, given)} of {needed} bytes are there"
                )
            return np.memmap(self.path, kind, "r", at, (count,)) if needed else np.zeros(0, kind)
        check_size(str(self.path), size)
        with self.path.open("rb") as file:
            file.seek(self.start)
            skipped = min(sum(one.records for one in before), size)
            given_lines = islice(file, skipped, skipped + min(count, size))
            lines = [line.decode("latin-1") for line in given_lines if line.strip()]
        if len(lines) < count:
            raise OSError(f"{self.path} is cut off: {len(lines)} of {count} lines are there")
        try:
            table: NDArray[Any] = np.loadtxt(lines, kind, comments=None, ndmin=1)
        except ValueError as error:
            raise ValueError(f"is not a table of numbers: {error!s:.100}") from None
        if table.shape != (count,):
            raise ValueError(f"has {len(table)} records of {name}, not {count}")
        return table


def ply_header(path: Path) -> PlyFile:
    """Read the header of a PLY file."""
    encoding, comments, elements = "", list[str](), list[Element]()
    with path.open("rb") as file:
        if file.readline(LONGEST_LINE).strip() != b"ply":
            raise ValueError(
                "is not a PLY file: it does not begin with ply and end_header after it"
            )
        lines = list[list[str]]()
        while len(lines) < LONGEST_HEADER and lines[-1:] != [["end_header"]]:
            lines.append(file.readline(LONGEST_LINE).decode("latin-1").split())
        start = file.tell()
    if lines[-1] != ["end_header"]:
        raise ValueError("is not a PLY file: its header has no end, a line end_header")
    encoding = ([" ".join(words[1:2]) for words in lines if words[:1] == ["format"]] or [""])[-1]
    if encoding not in BYTE_ORDERS:
        raise ValueError(f"has the PLY format {encoding!r:.40}; known: {', '.join(BYTE_ORDERS)}")
    for words in lines:
        line = f"{' '.join(words)!r:.60}"
        match words:
            case ["comment" | "obj_info", *rest]:
                comments.append(" ".join(rest).lower())
            case ["element", name, count] if count.isdecimal() and len(count) <= MOST_DIGITS:
                elements.append(Element(name, int(count), []))
            case ["element", *_]:
                raise ValueError(f"has a PLY header with {line}; it needs a whole number")
            case ["property", *kinds, name] if elements:
                elements[-1].properties.append(_property(name, kinds, BYTE_ORDERS[encoding], line))
            case ["property"] if elements:
                raise ValueError(f"has {line}, which is neither a number nor a list of numbers")
    names = [[e.name for e in elements], *([p.name for p in e.properties] for e in elements)]
    for n, each in enumerate(names):
        if len(set(each)) < len(each):
            what = "a property" if n else "an element"
            raise ValueError(f"has {what} twice: {max(each, key=each.count)!r:.60}")
    return PlyFile(path, encoding, elements, comments, start)


def _property(name: str, words: list[str], order: str, line: str) -> Property:
    is_list = words[:1] == ["list"]
    kinds = [TYPES.get(word, "") for word in words[is_list:]]
    if len(kinds) != 1 + is_list or not all(kinds):
        raise ValueError(f"has {line}, which is neither a number nor a list of numbers")
    if is_list and kinds[0][0] == "f":
        raise ValueError(f"has {line}: a list's length must be a whole number")
    return Property(name, order + kinds[-1], order + kinds[0] if is_list else "")


def read_ply(path: Path) -> Cloud:
    """Read a PLY file of points: ASCII, or binary of either byte order."""
    header = ply_header(path)
    header.tell_scales()
    before, vertex = header.split_at("vertex")
    if any(own <= {each.name for each in vertex.properties} for own in GAUSSIANS):
        raise ValueError(
            "holds 3D Gaussians (f_dc_*, opacity, scale_*, rot_*), which `read_gaussians` reads "
            "and `resample-points render` paints; a cloud of points has x y z red green blue"
        )
    size, kind = path.stat().st_size, vertex.scalars()
    with path.open("rb") as file:
        file.seek(header.start)
        if header.encoding == "ascii":
            for _ in islice(file, min(sum(element.records for element in before), size)):
                pass
            if not vertex.has_lists:
                return cloud_of(text_fields(path, file, vertex.records, kind))
            lines = [line for line in text_lines(path, file, vertex.records) if line.strip()]
            check_count(path, len(lines), vertex.records)
            rows = [_numbers(line.split(), vertex) for line in lines]
            table = np.array(rows, np.float64).reshape(len(rows), len(kind.names or ()))
            return cloud_of(
                {
                    name: within(table[:, n], kind[name], name)
                    for n, name in enumerate(kind.names or ())
                }
            )
        for element in before:
            if element.has_lists:
                for _ in _runs(path, file, element):
                    pass
            else:
                file.seek(element.records * element.scalars().itemsize, 1)
                if file.tell() > size:
                    raise OSError(f"{path} is cut off in its element {element.name}")
        if not vertex.has_lists:
            return binary_cloud(path, file, vertex.records, kind)
        runs = [
            {name: run[name].copy() for name in kind.names or ()}
            for run in _runs(path, file, vertex)
        ]
        empty = [{name: np.zeros(0) for name in kind.names or ()}]
        return cloud_of(
            {
                name: np.concatenate([run[name] for run in runs or empty])
                for name in kind.names or ()
            }
        )


def _runs(path: Path, file: BinaryIO, element: Element) -> Iterator[NDArray[Any]]:
    """Yield binary records, as many at a time as have lists of the same lengths."""
    begin, size = file.tell(), path.stat().st_size
    data = np.memmap(path, np.uint8, "r") if size else np.zeros(0, np.uint8)
    done, likely = 0, 1
    while done < element.records:
        kind = _kind_at(data, begin, element)
        some = min(likely, element.records - done, (size - begin) // kind.itemsize) if kind else 0
        if kind is None or some < 1:
            raise OSError(f"{path} is cut off in its element {element.name}")
        run = data[begin : begin + some * kind.itemsize].view(kind)
        same = np.ones(some, np.bool_)
        for each in element.properties:
            if each.length:
                same &= run[f"length of {each.name}"] == run[f"length of {each.name}"][0]
        alike = some if same.all() else int(np.argmin(same))
        yield run[:alike]
        begin, done = begin + alike * kind.itemsize, done + alike
        likely = min(2 * likely, STEP) if alike == some else 1
    file.seek(begin)


def _kind_at(data: NDArray[np.uint8], begin: int, element: Element) -> np.dtype[Any] | None:
    """Return the type of the record at an offset; None if it exceeds the file."""
    fields, place = list[Any](), begin
    for each in element.properties:
        if each.length:
            step = np.dtype(each.length).itemsize
            if place + step > len(data):
                return None
            count = int(data[place : place + step].view(each.length)[0])
            if count < 0:
                raise ValueError(f"has a list of {count} numbers")
            fields += [(f"length of {each.name}", each.length), (each.name, each.kind, (count,))]
            place += step + count * np.dtype(each.kind).itemsize
        else:
            fields.append((each.name, each.kind))
            place += np.dtype(each.kind).itemsize
        if place > len(data):
            return None
    return np.dtype(fields)


def _numbers(words: list[str], vertex: Element) -> list[float]:
    """Return the numbers of a line that are not in lists."""
    numbers, place = list[float](), 0
    try:
        for each in vertex.properties:
            if not each.length:
                numbers.append(float(words[place]))
            place += 1 + (max(0, int(words[place])) if each.length else 0)
    except (ValueError, IndexError):
        raise ValueError(f"has a vertex '{' '.join(words):.60}', which lacks a number") from None
    return numbers


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
    return float(np.abs(values[np.isfinite(values)]).max(initial=0))
