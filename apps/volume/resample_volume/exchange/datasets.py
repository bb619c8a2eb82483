"""Convert data sets of VTK and PyVista; unstructured grids are resampled."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_volume.data.recordings import alone
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.cells.resampling import pieces_of, resampled
from resample_volume.files.cells.validity import points_along
from resample_volume.files.parsing.choosing import ArrayQuery, cells_between, choose, middles
from resample_volume.files.parsing.headers import check_alone, check_shape
from resample_volume.files.xml.vti import arrays_of, image_header
from resample_volume.types import Volume


def of_dataset(given: Any, part: Any, name: str) -> Volume:
    """Convert a data set; errors are those of readers of such files.

    Parameters
    ----------
    given
        `vtkImageData`, `vtkRectilinearGrid`, or what is resampled: a structured or unstructured
        grid, or blocks of any of these.
    """
    if not (given.IsA("vtkDataSet") or given.IsA("vtkCompositeDataSet")):
        raise TypeError(f"a volume of {type(given).__name__}; give a data set of VTK's with cells")
    wanted = ArrayQuery(str(part), "", "")
    if given.IsA("vtkImageData"):
        return _of_image(given, wanted, name)
    if given.IsA("vtkRectilinearGrid"):
        return _of_planes(given, wanted, name)
    return alone(resampled(pieces_of(given), wanted, (), name, check_alone))


def _of_image(image: Any, wanted: ArrayQuery, name: str) -> Volume:
    values, is_of_cells = _values(image, wanted, name)
    known = image_header(image, np.uint8, None, name, is_of_cells=is_of_cells)
    return Volume(values, known.spacing, known.origin, known.direction, name)


def _of_planes(grid: Any, wanted: ArrayQuery, name: str) -> Volume:
    from vtkmodules.util.numpy_support import vtk_to_numpy

    values, is_of_cells = _values(grid, wanted, name)
    axes = (grid.GetXCoordinates(), grid.GetYCoordinates(), grid.GetZCoordinates())
    x, y, z = (middles(vtk_to_numpy(axis), of_cells=is_of_cells) for axis in axes)
    return rectilinear(values, x, y, z, name)


def _values(grid: Any, wanted: ArrayQuery, name: str) -> tuple[NDArray[Any], bool]:
    """Return values (Z, Y, X) or (Z, Y, X, C) of an array, and whether they are of cells."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    arrays = arrays_of(grid)
    names = [named for named, _ in arrays]
    chosen = choose(names, wanted, name)
    points = points_along(grid)
    shape = cells_between(points) if chosen.is_of_cells else points
    check_shape(shape, name)
    values = vtk_to_numpy(arrays[names.index(chosen)][1])  # holds a reference to VTK's memory
    return values.reshape(*shape[::-1], *values.shape[1:]), chosen.is_of_cells
