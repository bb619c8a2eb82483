"""Read the vertices of PLY files.

Elements before them, and properties that are lists, are skipped.
"""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from resample_points.data.cloud import Cloud
from resample_points.data.fields import Fields, cloud_of
from resample_points.data.parts import STEP
from resample_points.files.parsing import (
    binary_cloud,
    check_count,
    text_fields,
    text_lines,
    within,
)
from resample_points.files.ply_headers import PlyElement, PlyProperty, ply_header

GAUSSIANS = (  # columns of 3D Gaussians; each set is sufficient
    {"f_dc_0", "opacity", "scale_0", "rot_0"},
    {"packed_position", "packed_rotation", "packed_scale"},
)


def read_ply(path: Path) -> Cloud:
    """Read a PLY file: ASCII, or binary of either byte order."""
    header = ply_header(path)
    before, vertex = header.split_at("vertex")
    _refuse_gaussians({each.name for each in vertex.properties})
    with path.open("rb") as file:
        file.seek(header.start)
        if header.encoding == "ascii":
            lines = sum(element.records for element in before)
            for _ in islice(file, min(lines, path.stat().st_size)):
                pass
            if vertex.has_lists:
                return cloud_of(_ragged_text(path, file, vertex))
            return cloud_of(text_fields(path, file, vertex.records, vertex.scalars()))
        for element in before:
            _skip(path, file, element)
        if vertex.has_lists:
            return cloud_of(_ragged(path, file, vertex))
        return binary_cloud(path, file, vertex.records, vertex.scalars())


def _refuse_gaussians(names: set[str]) -> None:
    if any(own <= names for own in GAUSSIANS):
        raise ValueError(
            "holds 3D Gaussians (f_dc_*, opacity, scale_*, rot_*), which `read_gaussians` reads "
            "and `resample-points render` paints; a cloud of points has x y z red green blue"
        )


def _skip(path: Path, file: BinaryIO, element: PlyElement) -> None:
    """Move past the binary records of an element."""
    if not element.has_lists:
        file.seek(element.records * element.scalars().itemsize, 1)
        if file.tell() > path.stat().st_size:
            raise OSError(f"{path} is cut off in its element {element.name}")
        return
    for _ in _runs(path, file, element):
        pass


def _ragged(path: Path, file: BinaryIO, vertex: PlyElement) -> Fields:
    """Read the numbers of binary vertices that also have lists."""
    names = vertex.scalars().names or ()
    parts = [{name: run[name].copy() for name in names} for run in _runs(path, file, vertex)]
    if not parts:
        return {name: np.zeros(0) for name in names}
    return {name: np.concatenate([part[name] for part in parts]) for name in names}


def _runs(path: Path, file: BinaryIO, element: PlyElement) -> Iterator[NDArray[Any]]:
    """Yield binary records, as many at a time as have lists of the same lengths."""
    begin, size = file.tell(), path.stat().st_size
    data = np.memmap(path, np.uint8, "r") if size else np.zeros(0, np.uint8)
    done, likely = 0, 1
    while done < element.records:
        kind = _kind_at(data, begin, element)
        some = (
            0
            if kind is None
            else min(likely, element.records - done, (size - begin) // kind.itemsize)
        )
        if kind is None or some < 1:
            raise OSError(f"{path} is cut off in its element {element.name}")
        run = data[begin : begin + some * kind.itemsize].view(kind)
        same = np.ones(some, np.bool_)
        for n, each in enumerate(element.properties):
            if each.length:
                same &= run[f"length {n}"] == run[f"length {n}"][0]
        alike = some if same.all() else int(np.argmin(same))
        yield run[:alike]
        begin, done = begin + alike * kind.itemsize, done + alike
        likely = min(2 * likely, STEP) if alike == some else 1
    file.seek(begin)


def _kind_at(data: NDArray[np.uint8], begin: int, element: PlyElement) -> np.dtype[Any] | None:
    """Return the type of the record at an offset; None if it does not fit into the file."""
    lengths, place = list[int](), begin
    for each in element.properties:
        if each.length:
            count = np.dtype(each.length)
            if place + count.itemsize > len(data):
                return None
            lengths.append(int(data[place : place + count.itemsize].view(count)[0]))
            place += count.itemsize
        else:
            lengths.append(1)
        if lengths[-1] < 0:
            raise ValueError(f"has a list of {lengths[-1]} numbers")
        place += lengths[-1] * np.dtype(each.kind).itemsize
        if place > len(data):
            return None
    return _kind(element.properties, tuple(lengths))


@cache
def _kind(properties: Sequence[PlyProperty], lengths: Sequence[int]) -> np.dtype[Any]:
    """Return the type of a record whose lists have these lengths."""
    fields: list[Any] = []
    for n, (each, count) in enumerate(zip(properties, lengths, strict=True)):
        if each.length:
            fields += [(f"length {n}", each.length), (f"list {n}", each.kind, (count,))]
        else:
            fields.append((each.name, each.kind))
    return np.dtype(fields)


def _ragged_text(path: Path, file: BinaryIO, vertex: PlyElement) -> Fields:
    """Read the numbers of vertices in lines that also hold lists."""
    lines = [line for line in text_lines(path, file, vertex.records) if line.strip()]
    check_count(path, len(lines), vertex.records)
    rows = [_numbers(line.split(), vertex) for line in lines]
    kind = vertex.scalars()
    table = np.array(rows, np.float64).reshape(len(rows), len(kind.names or ()))
    return {name: within(table[:, n], kind[name], name) for n, name in enumerate(kind.names or ())}


def _numbers(words: list[str], vertex: PlyElement) -> list[float]:
    """Return the numbers of a line that are not in lists."""
    numbers, place = list[float](), 0
    try:
        for each in vertex.properties:
            if each.length:
                place += 1 + max(0, int(words[place]))
            else:
                numbers.append(float(words[place]))
                place += 1
    except (ValueError, IndexError):
        raise ValueError(f"has a vertex '{' '.join(words):.60}', which lacks a number") from None
    return numbers
