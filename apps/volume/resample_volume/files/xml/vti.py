"""Read VTK image data (`.vti`) and rectilinear grids by VTK, which is an extra."""

import math
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from resample.reading.limits import check_unpacked
from resample.reading.native import plain, suppressed_output
from resample.reading.texts import check_xml_file
from resample_volume.data.memory import require_memory
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.parsing.headers import Check, VolumeHeader, accept_any, header, recording
from resample_volume.files.parsing.sections import (
    ArrayQuery,
    Named,
    cells_between,
    check_single,
    choose,
    middles,
    of_parts,
    part_of,
)
from resample_volume.files.xml.validity import check_blocks, check_offsets
from resample_volume.types import Recording, Volume

UNSTRUCTURED = "vtkXMLUnstructuredGridReader"
BASE64 = re.compile(rb"[A-Za-z0-9+/=\s]*")


def read_vti(path: Path, wanted: ArrayQuery, name: str, check: Check = accept_any) -> Recording:
    """Read one array at points or cells; components are channels, or a color."""
    image = grid_of(path, "vtkXMLImageDataReader")
    chosen, every, values = _values(image, wanted, path.name)
    known = image_header(image, values.dtype, _spacing(path), name, is_of_cells=chosen.is_of_cells)
    known = of_parts(known, chosen, every, wanted)
    check(known)
    return recording(part_of(values, chosen, wanted, name), known)


def read_vtr(path: Path, wanted: ArrayQuery, name: str) -> Volume:
    """Read one array of a rectilinear grid; parameters as of `read_vti`."""
    grid = grid_of(path, "vtkXMLRectilinearGridReader")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    chosen, every, values = _values(grid, wanted, path.name)
    points = grid.GetDimensions()
    shape = cells_between(points) if chosen.is_of_cells else points
    known = of_parts(header(shape, values.dtype, name), chosen, every, wanted)
    check_single(known, path.name)
    axes = (grid.GetXCoordinates(), grid.GetYCoordinates(), grid.GetZCoordinates())
    x, y, z = (middles(vtk_to_numpy(axis), of_cells=chosen.is_of_cells) for axis in axes)
    values = part_of(values, chosen, wanted, name)
    made = rectilinear(values.reshape(known.shape[::-1]), x, y, z, name)
    return made._replace(length=known.length)


def points_along(data: Any) -> tuple[int, ...]:
    """Return points along x, y, z of a structured grid, in a way that all VTK versions support."""
    first, last = np.reshape(data.GetExtent(), (3, 2)).T.tolist()
    return tuple(b - a + 1 for a, b in zip(first, last, strict=True))


def grid_of(path: Path, reader_name: str) -> Any:
    """Read a file by a reader of VTK's."""
    try:
        forms = import_module("vtkmodules.vtkIOXML")
    except ImportError:
        raise ValueError(
            f"{path.name}: {path.suffix} is read by VTK; pip install 'hybrid-resample[vtk]'"
        ) from None
    _check_end(path)
    check_xml_file(path, "AppendedData")
    check_blocks(path)
    if reader_name == UNSTRUCTURED:
        check_offsets(path)
    failures: list[str] = []
    reader = getattr(forms, reader_name)()
    reader.AddObserver("ErrorEvent", lambda _, event: failures.append(event))
    reader.SetFileName(plain(path))
    with suppressed_output():
        reader.UpdateInformation()
        _refuse(failures, path.name)
        _require_memory(reader, path)
        reader.Update()
        _refuse(failures, path.name)
    return reader.GetOutput()


def _values(grid: Any, wanted: ArrayQuery, name: str) -> tuple[Named, list[Named], Any]:
    """Return the chosen array, all arrays, and the values (N,), or (N, C) with components."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    every = arrays_of(grid)
    names = [named for named, _ in every]
    chosen = choose(names, wanted, name)
    return (
        chosen,
        names,
        vtk_to_numpy(every[names.index(chosen)][1]),
    )  # holds a reference to VTK's memory


def arrays_of(grid: Any) -> list[tuple[Named, Any]]:
    """Return the numeric arrays at the points and cells of a data set of VTK's."""
    return [
        (
            Named(
                str(held.GetArrayName(n)),
                held.GetArray(n).GetNumberOfComponents(),
                of_cells,
                held.GetArray(n) is held.GetScalars(),
            ),
            held.GetArray(n),
        )
        for of_cells, held in ((False, grid.GetPointData()), (True, grid.GetCellData()))
        for n in range(held.GetNumberOfArrays())
        if held.GetArray(n)  # texts are none
    ]


def image_header(
    image: Any, dtype: Any, spacing: Any, name: str, *, is_of_cells: bool
) -> VolumeHeader:
    """Return the header of image data, whose first voxel may have any index.

    `spacing`: replaces the image's; None: the image's. `is_of_cells`: whether voxels are its cells.
    """
    points = image.GetDimensions()
    known = header(
        cells_between(points) if is_of_cells else points,
        dtype,
        name,
        spacing=image.GetSpacing() if spacing is None else spacing,
        origin=image.GetOrigin(),
        direction=np.reshape(image.GetDirectionMatrix().GetData(), (3, 3)),
    )
    first = known.spacing * (np.array(image.GetExtent()[::2]) + is_of_cells / 2)
    return known._replace(origin=known.origin + known.direction @ first)


def _spacing(path: Path) -> list[float] | None:
    """Return the spacing as written; VTK makes it (1, 1, 1) if it is not a number."""
    with path.open("rb") as file:
        found = re.search(rb"<ImageData[^>]*\bSpacing=\"([^\"]*)\"", file.read(1 << 16))
    return [float(text) for text in found[1].split()] if found else None


def _require_memory(reader: Any, path: Path) -> None:
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    attributes = reader.GetOutputInformation(0)
    if not attributes.Has(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT()):
        return  # not a grid; the caller rejects it
    extent = attributes.Get(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT())
    first, last = np.reshape(extent, (3, 2)).T.tolist()
    count = math.prod(b - a + 1 for a, b in zip(first, last, strict=True))
    require_memory(count, path.name)  # at least a byte per voxel
    check_unpacked(path.name, path.stat().st_size, count)


def _check_end(path: Path) -> None:
    """Reject truncated files and invalid base64, which VTK would read forever."""
    with path.open("rb") as file:
        head = re.search(rb'<AppendedData\s+encoding="base64"\s*>\s*_', file.read(1 << 16))
        file.seek(max(0, path.stat().st_size - 1024))
        last = file.read()
        if b"</VTKFile" not in last:
            _refuse(["its end is missing"], path.name)
        if head is None:
            return
        file.seek(head.end())
        while block := file.read(1 << 20):
            content, end, _ = block.partition(b"<")
            if not BASE64.fullmatch(content):
                _refuse(["letters that are none of base64"], path.name)
            if end:
                return


def _refuse(failures: list[str], name: str) -> None:
    if failures:
        raise ValueError(f"{name} is damaged or not what its suffix says; get the file again")
