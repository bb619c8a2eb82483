"""Where cells end in VTK's XML, looked at before VTK makes room for the corners up to there.

An array may be text, base64 or raw, packed in one of several ways; VTK itself reads it here, from a
file made of that array alone as a column of a table, which has as many rows as are told.
"""

import re
import tempfile
from collections.abc import Iterator
from importlib import import_module
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import Any, NamedTuple

from resample.reading.limits import check_unpacked
from resample.reading.silence import suppressed_output

TAG = re.compile(rb"<(?:Piece|DataArray)\b[^<>]*>")
ATTRIBUTE = re.compile(rb'(\w+)\s*=\s*["\']([^"\']*)["\']')
APPENDED = re.compile(rb"<AppendedData([^>]*)>\s*_")
FILE = re.compile(rb"<VTKFile\b([^<>]*)>")
KEPT = (b"version", b"byte_order", b"header_type", b"compressor")
NAME = b"offsets"
POLYHEDRA = (b"faceoffsets", b"face_offsets", b"polyhedron_offsets", b"faces")
BYTES = 8  # of a corner's number in memory


class _Ends(NamedTuple):
    """An array of where cells end."""

    cells: int
    told: dict[bytes, bytes]  # of the array
    data: bytes  # within its element, or appended


def check_offsets(path: Path) -> None:
    """Refuse a file of an unstructured grid whose cells have far more corners than it can hold.

    Raises
    ------
    ValueError
        They have; or ends of cells cannot be read, or cells are polyhedra, which have others.
    """
    with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as content:
        head = FILE.search(content[: 1 << 16])
        if head is None:
            raise ValueError(f"{path.name} is damaged: it has no element VTKFile")
        told = dict(ATTRIBUTE.findall(head[1]))
        about = b" ".join(b'%s="%s"' % (key, told[key]) for key in KEPT if key in told)
        appended = APPENDED.search(content)
        form = appended[1] if appended else b""
        for ends in _ends(path.name, content, appended):
            corners = _last(path.name, _table(about, form, ends))
            check_unpacked(path.name, len(content), BYTES * corners)


def _ends(name: str, content: mmap, appended: re.Match[bytes] | None) -> Iterator[_Ends]:
    """All arrays of ends, one for each piece."""
    size = appended.start() if appended else len(content)
    tags = [(found, dict(ATTRIBUTE.findall(found[0]))) for found in TAG.finditer(content, 0, size)]
    starts = sorted({_whole(told.get(b"offset", b"")) for _, told in tags})
    cells = 0
    for found, told in tags:
        if found[0].startswith(b"<Piece"):
            cells = _whole(told.get(b"NumberOfCells", b""))
        elif told.get(b"Name", b"").lower() in POLYHEDRA:
            raise ValueError(
                f"{name} has polyhedra, which are not read from files; cut their cells "
                "(ParaView's Tetrahedralize), or give the grid to as_volume in Python"
            )
        elif told.get(b"Name", b"").lower() == NAME and cells:
            if told.get(b"format") != b"appended":
                end = content.find(b"</DataArray", found.end())
                yield _Ends(cells, told, content[found.end() : max(end, found.end())])
            elif appended:
                start = _whole(told.get(b"offset", b""))
                following = [each for each in starts if each > start]
                end = appended.end() + following[0] if following else len(content)
                yield _Ends(cells, told, content[appended.end() + start : end])


def _table(about: bytes, form: bytes, ends: _Ends) -> bytes:
    """File of a table with that column alone."""
    is_apart = ends.told.get(b"format") == b"appended"
    kinds = b'type="%s" format="%s"' % (
        ends.told.get(b"type", b"Int64"),
        ends.told.get(b"format", b"ascii"),
    )
    column = b'<DataArray Name="%s" %s' % (NAME, kinds)
    column += b' offset="0"/>' if is_apart else b">%s</DataArray>" % ends.data
    end = b"</AppendedData></VTKFile>"
    data, rest = ends.data.partition(end)[:2] if is_apart else (b"", b"")
    rest = b"<AppendedData%s>_%s%s" % (form, data, end) if is_apart else b"</VTKFile>"
    return (
        b'<?xml version="1.0"?><VTKFile type="Table" %s><Table><Piece NumberOfCols="1" '
        b'NumberOfRows="%d"><RowData>%s</RowData></Piece></Table>%s'
        % (about, ends.cells, column, rest)
    )


def _last(name: str, table: bytes) -> int:
    """Largest end of a cell."""
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
    column = reader.GetOutput().GetRowData().GetArray(NAME.decode())
    if failures or column is None or not column.GetNumberOfTuples():
        raise ValueError(f"{name} is damaged: where its cells end cannot be read")
    found = vtk_to_numpy(column)
    if found.min() < 0:
        raise ValueError(f"{name} is damaged: cells end before they begin")
    return int(found.max())


def _whole(text: bytes) -> int:
    """Count, of as many digits as one has that was let in; 0 of what is none."""
    return int(text) if text.isdigit() and len(text) < 19 else 0
