"""Readers of VTK files of unstructured and multiblock grids, resampled onto a lattice.

The form is that of "VTK File Formats" (docs.vtk.org), in its versions up to 5.1.

They are read here, not by VTK, which would open whatever they name.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from resample.reading.limits import check_items, check_size, neighbour
from resample.reading.texts import check_xml_file
from resample_cells.corners import check_corners
from resample_cells.resampling import pieces_of, resampled
from resample_volume.data.values import require_memory
from resample_volume.files.headers import Check, OneOfAll, accept_any, existing_file, stem
from resample_volume.files.sections import (
    Array,
    ArrayQuery,
    Sections,
    cells_between,
    check_part,
)
from resample_volume.files.texts import Numbers, steps_of
from resample_volume.files.vtk import grid_of
from resample_volume.types import Recording

Cells = tuple[NDArray[Any], NDArray[Any]]  # where each begins, and its corners
READERS = {  # class of VTK's, by suffix
    ".vti": "vtkXMLImageDataReader",
    ".vtr": "vtkXMLRectilinearGridReader",
    ".vts": "vtkXMLStructuredGridReader",
    ".vtu": "vtkXMLUnstructuredGridReader",
}
KIB = 1024


def legacy_grid(found: Sections) -> Any:
    """Read a file to a data set of VTK's."""
    is_structured = found.dataset == "structured_grid"
    grid, cells = (_structured if is_structured else _unstructured)(found)
    points = grid.GetNumberOfPoints()
    for array in found.arrays(points, cells):
        held = _vtk_array(found.values(array).reshape(-1, array.named.parts), array)
        where = grid.GetCellData() if array.named.is_of_cells else grid.GetPointData()
        where.AddArray(held)
        if array.named.is_active:
            where.SetActiveScalars(array.named.name)
    return grid


def _vtk_array(values: NDArray[Any], array: Array) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk

    made = numpy_to_vtk(values, deep=True)
    made.SetName(array.named.name)
    return made


def _points(values: NDArray[Any]) -> Any:
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkPoints

    kind = np.float64 if values.dtype.itemsize > 4 else np.float32
    made = vtkPoints()
    made.SetData(numpy_to_vtk(values.astype(kind).reshape(-1, 3), deep=True))
    return made


def _structured(found: Sections) -> tuple[Any, int]:
    """Grid with cells in rows, without its arrays, and its number of cells."""
    from vtkmodules.vtkCommonDataModel import vtkStructuredGrid

    shape, points = [], None
    while (words := found.line()) and not _begins_arrays(words):
        key = words[0].lower()
        if key == "dimensions":
            shape = [found.whole(words, place) for place in (1, 2, 3)]
        elif key == "points":
            points = found.block(words, 1, found.word(words, 2), 3)
        elif key == "field":
            found.skip_field(words)
        else:
            raise ValueError(f"{found.name}: {words[0]!r:.40} is not part of a structured grid")
    found.back()
    if points is None or len(points) != 3 * math.prod(shape) or not shape:
        raise ValueError(f"{found.name} is damaged: its points are not as many as its DIMENSIONS")
    grid = vtkStructuredGrid()
    grid.SetDimensions(shape)
    grid.SetPoints(_points(points))
    return grid, math.prod(cells_between(shape))


def _unstructured(found: Sections) -> tuple[Any, int]:
    """Grid of cells of any shape, without its arrays, and how many cells it has."""
    from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
    from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkUnstructuredGrid

    points, cells, kinds = np.empty(0), None, np.empty(0)
    while (words := found.line()) and not _begins_arrays(words):
        key = words[0].lower()
        if key == "points":
            points = found.block(words, 1, found.word(words, 2), 3)
        elif key == "cells":
            cells = _cells(found, words)
        elif key == "cell_types":
            kinds = found.block(words, 1, "int")
        elif key == "field":
            found.skip_field(words)
        else:
            raise ValueError(f"{found.name}: {words[0]!r:.40} is not part of an unstructured grid")
    found.back()
    if cells is None or len(cells[0]) != len(kinds) + 1 or not len(points):
        raise ValueError(f"{found.name} is damaged: its points, cells or their kinds are missing")
    if kinds.size and not (kinds.min() >= 0 and kinds.max() <= 255 and 42 not in kinds):
        raise ValueError(
            f"{found.name} has cells of kinds that are not read from legacy files; write it as .vtu"
        )
    grid, held = vtkUnstructuredGrid(), vtkCellArray()
    first, corners = (numpy_to_vtkIdTypeArray(each, deep=True) for each in cells)
    held.SetData(first, corners)
    grid.SetPoints(_points(points))
    grid.SetCells(numpy_to_vtk(kinds.astype(np.uint8), deep=True), held)
    return grid, len(kinds)


def _cells(found: Sections, words: list[str]) -> Cells:
    """Where each cell's corners begin, and the corners; in the new form, or the old."""
    here = found.file.tell()
    following = found.line()
    if following[:1] == ["OFFSETS"]:
        first = found.block(words, 1, found.word(following, 1))
        following = found.line()
        corner = found.block(words, 2, found.word(following, 1))
        if following[0] != "CONNECTIVITY" or not first.size:
            raise ValueError(f"{found.name} is damaged: its OFFSETS have no CONNECTIVITY")
        return first.astype(np.int64), corner.astype(np.int64)
    found.file.seek(here)
    count, stored = found.whole(words, 1), found.block(words, 2, "int")
    return _unlisted(stored.astype(np.int64), count, found.name)


def _unlisted(stored: NDArray[np.int64], count: int, name: str) -> Cells:
    """Cells of the old form, in which each tells first how many corners it has."""
    heads, place, every = [], 0, stored.tolist()
    while place < len(every) and every[place] >= 0:
        heads.append(place)
        place += every[place] + 1
    if place != len(every) or len(heads) != count:
        raise ValueError(f"{name} is damaged: its cells do not fill the numbers that they have")
    head = np.array(heads, np.int64)
    counts = stored[head] if count else head
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64), np.delete(stored, head)


def _begins_arrays(words: list[str]) -> bool:
    return words[0].lower() in ("point_data", "cell_data")


def read_grid(path: Path) -> Any:
    """Read the grid of one piece, by its file's suffix; errors as in `grid_of`."""
    suffix = path.suffix.lower()
    check = check_corners if suffix == ".vtu" else None
    return grid_of(existing_file(path), READERS[suffix], check)


def read_pieces(path: Path) -> list[Any]:
    """Read all volumetric pieces that a file lists; surfaces are left out."""
    names = list(_names(path))
    check_items(path.name, len(names), "pieces")
    pieces, held = [], 0
    for name in names:
        file = neighbour(path, name)
        if file.suffix.lower() not in READERS:
            if file.suffix.lower() == ".vtp":
                continue
            known = ", ".join(READERS)
            raise ValueError(f"{path.name} names {name!r:.100}; pieces are {known} and .vtp")
        if not file.is_file():
            raise FileNotFoundError(f"{path.name} wants {name!r:.100}, which is not beside it")
        pieces.append(read_grid(file))
        held += KIB * pieces[-1].GetActualMemorySize()
        require_memory(held, path.name)
    if not pieces:
        raise ValueError(f"{path.name} names no grid that fills space: {', '.join(READERS)}")
    return pieces


def _names(path: Path) -> Iterator[str]:
    """Return the listed file names."""
    check_size(path.name, path.stat().st_size, "tree")
    check_xml_file(path)
    try:
        tree = ElementTree.parse(path)  # noqa: S314 - defines nothing, as was checked
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise ValueError(f"{path.name} is damaged: {str(error)[:80]}; get the file again") from None
    for element in tree.iter("DataSet"):
        if "file" in element.attrib:
            yield element.attrib["file"]


@dataclass(frozen=True)
class _Cells(OneOfAll):
    """Base of readers that resample cells; values are at points or cells."""

    array: str = ""  # name of the array; empty: the active one, or the only one of scalars
    part: str = ""  # magnitude: lengths of the array's vectors
    spacing: Numbers = ""  # of the lattice, as 0.5 or 1x1x2; empty: the mean size of finest cells

    kind: ClassVar[str]  # by which messages name the reader

    def __post_init__(self) -> None:
        check_part(self.part)
        steps_of(self.spacing)

    def recorded(self, path: Path, check: Check = accept_any) -> Recording:
        wanted, steps = ArrayQuery(self.array, self.part, self.kind), steps_of(self.spacing)
        pieces = self._pieces(existing_file(path))
        return resampled(pieces, wanted, steps, stem(path, self.suffixes), check)

    def _pieces(self, path: Path) -> list[Any]:
        """Return VTK's data sets in a file."""
        return [read_grid(path)]


@dataclass(frozen=True)
class Vts(_Cells):
    """VTK structured grid, with cells in curved rows; values at points or cells."""

    suffixes = (".vts",)
    kind = "vts"


@dataclass(frozen=True)
class Vtu(_Cells):
    """VTK unstructured grid, of cells of any shape; values at points or cells."""

    suffixes = (".vtu",)
    kind = "vtu"

    @staticmethod
    def of_sections(
        found: Sections, wanted: ArrayQuery, spacing: tuple[float, ...], name: str, check: Check
    ) -> Recording:
        """Read a legacy file, which is open, of structured or unstructured cells."""
        return resampled([legacy_grid(found)], wanted, spacing, name, check)

    @staticmethod
    def of_dataset(given: Any, wanted: ArrayQuery, name: str, check: Check) -> Recording:
        """Convert a data set of VTK's, or blocks of them."""
        return resampled(pieces_of(given), wanted, (), name, check)


@dataclass(frozen=True)
class Vtm(_Cells):
    """VTK multiblock and AMR files, with pieces in or under their folder.

    Where pieces overlap, those with the smallest cells win.
    """

    suffixes = (".vtm", ".vthb")
    kind = "vtm"

    def _pieces(self, path: Path) -> list[Any]:
        return read_pieces(path)
