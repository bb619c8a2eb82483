"""Checks of unstructured grids in XML: VTK allocates as many corners as the file claims."""

import tempfile
from collections.abc import Iterator
from importlib import import_module
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, NamedTuple

from resample.reading.limits import check_unpacked
from resample.reading.native import suppressed_output
from resample_volume.files.vtk import APPENDED, Element, count_of, data_start, elements_of

KEPT = ("version", "byte_order", "header_type", "compressor")  # of the whole file
NAME = "offsets"
POLYHEDRA = ("faceoffsets", "face_offsets", "polyhedron_offsets", "faces")
BYTES = 8  # of a corner's number in memory


def check_corners(path: Path) -> None:
    """Reject cells with far more corners than the file can hold."""
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        every = elements_of(content)
        about = {key: told for key, told in every[0].attributes.items() if key in KEPT}
        form = every[-1].attributes.get("encoding", "") if every[-1].name == APPENDED else ""
        for ends in _ends(path.name, content, every):
            corners = _last(path.name, _table(about, form, ends))
            check_unpacked(path.name, len(content), BYTES * corners)


class _Ends(NamedTuple):
    """An array of cell offsets."""

    cells: int
    attributes: dict[str, str]  # of the array
    data: bytes  # within its element, or appended


def _ends(name: str, content: mmap, every: list[Element]) -> Iterator[_Ends]:
    """Return all arrays of offsets, one per piece."""
    first = data_start(content, every[-1]) if every[-1].name == APPENDED else -1
    starts = sorted({count_of(each.attributes.get("offset", "")) for each in every})
    cells = 0
    for element in every:
        attributes, label = element.attributes, element.attributes.get("Name", "").lower()
        if element.name == "Piece":
            cells = count_of(attributes.get("NumberOfCells", "0"))
        elif label in POLYHEDRA:
            raise ValueError(
                f"{name} has polyhedra, which are not read from files; cut their cells "
                "(ParaView's Tetrahedralize), or give the grid to as_volume in Python"
            )
        elif label == NAME and cells:
            if attributes.get("format") != "appended":
                yield _Ends(cells, attributes, content[element.data : element.end] or b" ")
            elif first >= 0:
                start = count_of(attributes.get("offset", ""))
                following = [each for each in starts if each > start]
                end = first + min(following[0] if following else len(content), len(content))
                yield _Ends(cells, attributes, content[first + start : end])


def _table(about: dict[str, str], form: str, ends: _Ends) -> bytes:
    """Return the file of a table with only that column."""
    is_apart = ends.attributes.get("format") == "appended"
    attributes = {key: ends.attributes.get(key, "") for key in ("type", "format")}
    about, rows = {"type": "Table", **about}, {"NumberOfCols": "1", "NumberOfRows": str(ends.cells)}
    column = f"<DataArray{_attributes({'Name': NAME, **attributes})}"
    head = f'<?xml version="1.0"?><VTKFile{_attributes(about)}><Table><Piece{_attributes(rows)}>'
    head += f"<RowData>{column}"
    foot = "</RowData></Piece></Table>"
    if not is_apart:
        return f"{head}>".encode() + ends.data + f"</DataArray>{foot}</VTKFile>".encode()
    head += f' offset="0"/>{foot}<AppendedData{_attributes({"encoding": form})}>_'
    end = b"</AppendedData></VTKFile>"
    return head.encode() + ends.data.partition(b"</AppendedData")[0] + end


def _attributes(attributes: dict[str, str]) -> str:
    from xml.sax.saxutils import quoteattr

    return "".join(f" {key}={quoteattr(text)}" for key, text in attributes.items())


def _last(name: str, table: bytes) -> int:
    """Return the largest offset."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    failures: list[str] = []
    reader: Any = import_module("vtkmodules.vtkIOXML").vtkXMLTableReader()
    reader.AddObserver("ErrorEvent", lambda _, event: failures.append(event))
    with tempfile.TemporaryDirectory(prefix="resample-offsets-") as folder:
        place = Path(folder, "a.vtt")
        place.write_bytes(table)
        reader.SetFileName(str(place))
        with suppressed_output():
            reader.Update()
    column = reader.GetOutput().GetRowData().GetArray(NAME)
    if failures or column is None or not column.GetNumberOfTuples():
        raise ValueError(f"{name} is damaged: where its cells end cannot be read")
    found = vtk_to_numpy(column)
    if found.min() < 0:
        raise ValueError(f"{name} is damaged: cells end before they begin")
    return int(found.max())
