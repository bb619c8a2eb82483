"""Parts that readers of clouds share: headers, binary records, tables of numbers."""

import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample.progress import report
from resample.reading.limits import check_size
from resample.types import Doubles
from resample_points.data.cloud import Cloud
from resample_points.data.fields import COLORS, Fields, cloud_of, most_of, white_of
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
    """Return the level of white in all records, which are then to be read anew; None: known."""
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
