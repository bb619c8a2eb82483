"""Read clouds from plain numbers: XYZ, PTS, CSV, KITTI; parts that other readers share."""

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample.progress import report
from resample.reading.limits import check_size
from resample.types import Doubles
from resample_points.data.cloud import (
    BITS_8,
    COLORS,
    NORMALS,
    PLACES,
    Cloud,
    Fields,
    cloud_of,
    most_of,
    white_of,
)
from resample_points.data.columns import colored_as_scanned
from resample_points.data.parts import STEP, CloudBuilder, storage_for

LONGEST_HEADER = 1000  # lines
NUMBER = re.compile(r"[-+]?\d*[.,]?\d+(?:[eE][-+]?\d+)?")  # its point may be a comma
COMMENTS = ("#", "//")  # beginnings of comment lines


def header_of(file: BinaryIO, last: str) -> list[list[str]]:
    """Read the words of a header's lines up to the one that begins with `last`."""
    lines = []
    for line in islice(file, LONGEST_HEADER):
        words = line.decode("latin-1").split()
        lines.append(words)
        if words and words[0] == last:
            return lines
    raise ValueError(f"is not of this format: it has no line {last}")


def within(column: NDArray[Any], kind: np.dtype[Any], name: str) -> NDArray[Any]:
    """Convert numbers to a type that must hold all of them."""
    if kind.kind in "iu" and column.size:
        ends = np.iinfo(kind)
        if not (ends.min <= column.min() and column.max() <= ends.max):  # nor NaN
            raise ValueError(f"holds numbers of {name} that do not fit into {kind}")
    with np.errstate(over="ignore"):  # infinite: such points are dropped
        return column.astype(kind)


def binary_cloud(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Cloud:
    """Read a cloud of `count` consecutive binary points."""
    wanted, given = count * kind.itemsize, path.stat().st_size - file.tell()
    if not 0 <= wanted <= given or count > given:  # points without fields have no bytes
        raise OSError(f"{path} is cut off: {given} of {wanted} bytes are there")
    gathering = CloudBuilder(storage_for(count, path.name))
    white, read = _white_in(file, count, kind), 0
    for points in _records(file, count, kind):
        fields = {name: points[name] for name in kind.names or () if points[name].ndim == 1}
        gathering.add(cloud_of(fields, white))
        read += len(points)
        report(read, count)
    return gathering.cloud()


def _records(file: BinaryIO, count: int, kind: np.dtype[Any]) -> Iterator[NDArray[Any]]:
    """Yield consecutive records, `STEP` at a time; at least once."""
    for first in range(0, max(count, 1), STEP):
        some = min(STEP, count - first)
        yield np.frombuffer(file.read(some * kind.itemsize), kind, some)


def _white_in(file: BinaryIO, count: int, kind: np.dtype[Any]) -> float | None:
    """Return the level of white in all records, for a second pass; None: known."""
    names = next((group for group in COLORS if set(group) <= set(kind.names or ())), ())
    if not names or all(kind[name] == np.uint8 for name in names) or not count:
        return None
    begin, most = file.tell(), 0.0
    for points in _records(file, count, kind):
        for name in names:
            most = max(most, most_of(points[name]))
    file.seek(begin)
    return white_of(np.result_type(*(kind[name] for name in names)), most)


def text_fields(path: Path, file: BinaryIO, count: int, kind: np.dtype[Any]) -> Fields:
    """Read columns from lines of numbers, in their types."""
    table = table_of(text_lines(path, file, count))
    check_count(path, len(table), count)
    fields, first = {}, 0
    for name in kind.names or ():
        if first >= table.shape[1]:
            raise ValueError(f"has {table.shape[1]} numbers in a line and no {name}")
        fields[name] = within(table[:, first], kind[name].base, name)
        first += int(np.prod(kind[name].shape))
    return fields


def text_lines(path: Path, file: BinaryIO, count: int) -> list[str]:
    """Read at most `count` lines."""
    check_size(str(path), path.stat().st_size)
    most = min(max(count, 0), path.stat().st_size)  # a point has a byte or more
    return [line.decode("latin-1") for line in islice(file, most)]


def check_count(path: Path, given: int, count: int) -> None:
    """Reject a file with fewer points than its header says."""
    if count < 0 or given < count:
        raise OSError(f"{path} is cut off: {given} of {count} points are there")


def table_of(lines: Sequence[str]) -> Doubles:
    """Parse lines of numbers separated by blanks, (N, columns)."""
    if not any(line.strip() for line in lines):
        return np.zeros((0, 3))
    try:
        table: Doubles = np.loadtxt(lines, np.float64, comments=COMMENTS, ndmin=2)
        return table
    except ValueError as error:
        raise ValueError(f"is not a table of numbers: {str(error).partition(';')[0]}") from None


NAMED = "columns named by the first line"
COLUMNS = {
    3: "x y z",
    4: "x y z value",
    6: "x y z r g b",
    7: "x y z intensity r g b",
    9: "x y z r g b nx ny nz",
    10: "x y z intensity r g b nx ny nz",
}
COLORS_FIRST = "x y z r g b value"
WITH_NORMALS = "x y z nx ny nz"
SEPARATORS = re.compile(r"[\s;,]+")
UNIT = 0.02  # most by which lengths of normals differ from 1


def read_columns(path: Path) -> Cloud:
    """Read a cloud from columns of numbers separated by commas, semicolons or blanks.

    Commas may be decimal points: between semicolons, or in numbers between blanks. The first line
    may name the columns, and the line before the points may hold their number.
    """
    try:
        check_size(str(path), path.stat().st_size)
        text = path.read_text("utf-8-sig")
    except UnicodeDecodeError:
        raise ValueError("is not a text file") from None
    comma = "." if _has_decimal_commas(text) else " "
    stripped = text.translate(str.maketrans(",;", f"{comma} ", '"'))
    lines = stripped.splitlines()
    first = next((n for n, line in enumerate(lines) if line.strip()), 0)
    names = _names(lines[first]) if lines else []
    is_comment = bool(names) and _is_comment(lines[first])
    table = table_of(_without_counts(path, lines[first + bool(names) :]))
    if names and not is_comment and len(names) != table.shape[1]:
        raise ValueError(f"names {len(names)} columns and has {table.shape[1]}")
    if len(names) != table.shape[1] or not set(names).issuperset("xyz"):
        names = _usual_names(table, path.suffix.lower())
    return cloud_of(dict(zip(names, table.T, strict=True)))


def read_pts(path: Path) -> Cloud:
    """Read columns of a laser scan; without colors, points are gray by their intensity."""
    return colored_as_scanned(read_columns(path))


def _has_decimal_commas(text: str) -> bool:
    """Whether commas are within numbers, by the first line of numbers."""
    for line in text.splitlines():
        parts = [part for part in SEPARATORS.split(line) if part]
        if len(parts) > 2 and all(NUMBER.fullmatch(part) for part in parts):
            words = line.split(";") if ";" in line else line.split()
            return len(words) > 2 and all(NUMBER.fullmatch(word.strip()) for word in words)
    return False


def _names(line: str) -> list[str]:
    """Return the column names of a line; empty if it holds a number."""
    words = line.strip().lstrip("#/").split()
    for word in words:
        with suppress(ValueError):
            float(word)
            return []
    known = {name for names in (*PLACES, *NORMALS, *COLORS) for name in names}
    return [word.lower() if word.lower() in known else word for word in words]


def _without_counts(path: Path, lines: list[str]) -> list[str]:
    """Leave out lines that hold the number of points of the scan after them."""
    first = next((line.split() for line in lines if line.strip() and not _is_comment(line)), [])
    if len(first) != 1 or not first[0].isdecimal():
        return lines
    rows = [line for line in lines if len(line.split(None, 1)) > 1 and not _is_comment(line)]
    if rows:
        check_count(path, len(rows), int(first[0][:30]))
    return rows or lines


def _is_comment(line: str) -> bool:
    return line.lstrip().startswith(COMMENTS)


def _usual_names(table: Doubles, suffix: str) -> list[str]:
    """Return the usual names of columns for a table without names."""
    width, rest = table.shape[1], table[:, 3:]
    usual = {6: WITH_NORMALS} if suffix == ".xyzn" else COLUMNS
    if width not in usual:
        raise ValueError(f"has {width} columns; known are {', '.join(usual.values())}, or {NAMED}")
    names = usual[width]
    # Vectors of length 1, one of which has a negative part, are normals: colors have none.
    if width == len(WITH_NORMALS.split()) and rest.min(initial=0) < 0:
        are_unit = np.all(np.abs(np.sqrt((rest * rest).sum(axis=1)) - 1) < UNIT)
        names = WITH_NORMALS if are_unit else names
    if width == len(COLORS_FIRST.split()) and _are_levels(rest[:, :3]) > _are_levels(rest[:, 1:]):
        names = COLORS_FIRST
    if suffix == ".pts":
        names = names.replace("value", "intensity")
    return names.split()


def _are_levels(values: Doubles) -> bool:
    """Whether all numbers are levels of 8 bits."""
    return bool(np.all((values >= 0) & (values <= BITS_8) & (values == np.floor(values))))


KITTI = ("x", "y", "z", "intensity")
NUSCENES = (*KITTI, "ring")
FARTHEST = 1e6  # greatest plausible number of a scan


def read_bin(path: Path) -> Cloud:
    """Read a `.bin` scan of KITTI, or a `.pcd.bin` scan of nuScenes; gray by intensity."""
    names = NUSCENES if path.name.lower().endswith(".pcd.bin") else KITTI
    kind, size = np.dtype([(name, "<f4") for name in names]), path.stat().st_size
    told = f"is not a KITTI scan: {len(names)} numbers ({' '.join(names)}) of float32 per point"
    if size % kind.itemsize or not size:
        raise ValueError(f"{told}, but its {size} bytes are not a multiple of {kind.itemsize}")
    with path.open("rb") as file:
        some = np.frombuffer(file.read(STEP * kind.itemsize), "<f4")
        if not bool(np.all(np.abs(some) <= FARTHEST)):  # nor NaN
            raise ValueError(f"{told}, but it holds numbers beyond {FARTHEST:g}, or NaN")
        file.seek(0)
        return colored_as_scanned(binary_cloud(path, file, size // kind.itemsize, kind))
