"""VTK files that list the pieces of a grid: `.vtm` and `.vthb`.

They are read here, not by VTK, which would open whatever they name.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from resample.reading.limits import check_items, check_size, neighbour
from resample.reading.markup import check_xml_file
from resample_volume.data.memory import require_memory
from resample_volume.files.cells.needs import require_vtk
from resample_volume.files.parsing.headers import existing_file
from resample_volume.files.xml.vti import UNSTRUCTURED, grid_of

READERS = {  # class of VTK's, by suffix
    ".vti": "vtkXMLImageDataReader",
    ".vtr": "vtkXMLRectilinearGridReader",
    ".vts": "vtkXMLStructuredGridReader",
    ".vtu": UNSTRUCTURED,
}
KIB = 1024


def read_grid(path: Path) -> Any:
    """Read the grid of one piece, by its file's suffix; errors as of `vti.grid_of`."""
    return grid_of(existing_file(path), READERS[path.suffix.lower()])


def read_pieces(path: Path) -> list[Any]:
    """Read all volumetric pieces that a file lists; surfaces are left out."""
    require_vtk(path.name)
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
