"""VTK's image data (`.vti`) and rectilinear grids, by VTK's own readers, which are an extra."""

import math
import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from resample.reading.limits import check_unpacked
from resample.reading.markup import check_xml_file
from resample.reading.names import plain
from resample.reading.silence import suppressed_output
from resample_volume.files.headers import Check, Header, check_nothing, header, recording
from resample_volume.files.memory import require_memory
from resample_volume.files.vtk_blocks import check_blocks
from resample_volume.media.recordings import is_color
from resample_volume.media.rectilinear import rectilinear
from resample_volume.types import Recording, Volume

BASE64 = re.compile(rb"[A-Za-z0-9+/=\s]*")


def read_vti(path: Path, array: str, name: str, check: Check = check_nothing) -> Recording:
    """One array at points, whose numbers at each are its channels, or a color.

    Parameters
    ----------
    path
        A file that exists.
    array
        Name of the array; empty: the active one, or the only one.
    name
        Of the volume.
    check
        Of what the file says.
    """
    image = _grid(path, "vtkXMLImageDataReader")
    chosen, values = _values(image, array, path.name)
    known = _header(image, values.dtype, _spacing(path), name)
    parts = math.prod(values.shape[1:])
    colored = is_color((parts,), known.dtype)
    kind = f"vector of {known.dtype.name} ({chosen}; {_listed(image.GetPointData())})"
    known = known._replace(parts=parts, is_color=colored, pixel=kind)
    check(known)
    return recording(values, known)


def read_vtr(path: Path, array: str, name: str) -> Volume:
    """One array of values at points of a rectilinear grid; parameters as of `read_vti`."""
    grid = _grid(path, "vtkXMLRectilinearGridReader")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    chosen, values = _values(grid, array, path.name)
    if values.ndim != 1:
        raise ValueError(
            f"{path.name}: {chosen} has {values.shape[1]} numbers per voxel, a volume on an uneven "
            f"grid has one; choose another array ({_listed(grid.GetPointData())})"
        )
    known = header(grid.GetDimensions(), values.dtype, name)
    axes = (grid.GetXCoordinates(), grid.GetYCoordinates(), grid.GetZCoordinates())
    x, y, z = (vtk_to_numpy(axis) for axis in axes)
    return rectilinear(values.reshape(known.shape[::-1]), x, y, z, name)


def _grid(path: Path, reader_name: str) -> Any:
    """What a reader of VTK makes of a file."""
    try:
        forms = import_module("vtkmodules.vtkIOXML")
    except ImportError:
        raise ValueError(
            f"{path.name}: {path.suffix} is read by VTK; pip install 'hybrid-resample[vtk]'"
        ) from None
    _check_end(path)
    check_xml_file(path, "AppendedData")
    check_blocks(path)
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


def _values(grid: Any, array: str, name: str) -> tuple[str, Any]:
    """Name and values of one array: (N,), or (N, C) of several numbers at each point."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    chosen = _chosen(grid.GetPointData(), array, name)
    return str(chosen.GetName()), vtk_to_numpy(chosen)  # shares VTK's memory and keeps it alive


def _listed(points: Any) -> str:
    """Names of all arrays, with how many numbers each has at a point."""
    arrays = [points.GetArray(n) for n in range(points.GetNumberOfArrays())]
    told = [f"{each.GetName()}: {each.GetNumberOfComponents()}" for each in arrays if each]
    return f"arrays are {', '.join(told)}"


def _header(image: Any, dtype: Any, spacing: Any, name: str) -> Header:
    """Header of image data, whose first voxel need not have index 0."""
    known = header(
        image.GetDimensions(),
        dtype,
        name,
        spacing=image.GetSpacing() if spacing is None else spacing,
        origin=image.GetOrigin(),
        direction=np.reshape(image.GetDirectionMatrix().GetData(), (3, 3)),
    )
    first = known.spacing * image.GetExtent()[::2]
    return known._replace(origin=known.origin + known.direction @ first)


def _chosen(points: Any, array: str, name: str) -> Any:
    known = [points.GetArrayName(n) for n in range(points.GetNumberOfArrays())]
    if array:
        found = points.GetArray(array)
    else:
        found = points.GetScalars() or (points.GetArray(0) if len(known) == 1 else None)
    if found is None:
        listed = ", ".join(map(str, known)) or "none (cell data is not read: convert it)"
        raise ValueError(f"{name}: choose the array of points ({array or 'none'} given): {listed}")
    return found


def _spacing(path: Path) -> list[float] | None:
    """Spacing as it is written; VTK makes it (1, 1, 1) where it is no number."""
    with path.open("rb") as file:
        found = re.search(rb"<ImageData[^>]*\bSpacing=\"([^\"]*)\"", file.read(1 << 16))
    return [float(text) for text in found[1].split()] if found else None


def _require_memory(reader: Any, path: Path) -> None:
    from vtkmodules.vtkCommonExecutionModel import vtkStreamingDemandDrivenPipeline

    extent = reader.GetOutputInformation(0).Get(vtkStreamingDemandDrivenPipeline.WHOLE_EXTENT())
    first, last = np.reshape(extent, (3, 2)).T.tolist()
    count = math.prod(b - a + 1 for a, b in zip(first, last, strict=True))
    require_memory(count, path.name)  # a byte per voxel at the least
    check_unpacked(path.name, path.stat().st_size, count)


def _check_end(path: Path) -> None:
    """Refuse a file that is cut off, or whose base64 is none: VTK never stops to read those."""
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
        raise ValueError(f"{name} is damaged or not VTK image data; get the file again")
