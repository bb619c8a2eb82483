"""Convert volumes of other libraries: VTK, PyVista, SimpleITK, nibabel, xarray, yt."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.lengths import unit_of_length
from resample.messages import one_line
from resample.registry import load, missing
from resample.types import Doubles
from resample_volume.data.recordings import alone, check_whole
from resample_volume.data.rectilinear import rectilinear
from resample_volume.files.formats.nifti import TO_LPS
from resample_volume.files.parsing.headers import check_alone, check_shape
from resample_volume.files.parsing.sections import ArrayQuery, cells_between, choose, middles
from resample_volume.files.parsing.texts import is_hounsfield
from resample_volume.files.xml.vti import arrays_of, image_header, points_along
from resample_volume.types import Volume

AXES = ("z", "y", "x")


def of_simple_itk(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of SimpleITK's with its geometry; parameters as of `of_dataset`."""
    import SimpleITK

    check_whole(part, "an image of SimpleITK's")
    if image.GetDimension() != 3:
        raise ValueError(f"an image of {image.GetDimension()} dimensions; a volume has 3")
    return Volume(
        SimpleITK.GetArrayFromImage(image),
        np.array(image.GetSpacing(), np.float64),
        np.array(image.GetOrigin(), np.float64),
        np.array(image.GetDirection(), np.float64).reshape(3, 3),
        name,
    )


def of_nibabel(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of nibabel's, of values or colors, to LPS.

    Values are scaled if its header says so, and otherwise as stored.
    """
    check_whole(part, "an image of nibabel's")
    if not (hasattr(image, "dataobj") and hasattr(image, "affine")):
        raise TypeError(f"a volume of nibabel's {type(image).__name__}; give an image of voxels")
    values = _colors(np.asanyarray(image.dataobj))
    while values.ndim > 3 and values.shape[3] == 1:
        values = values[..., 0, :] if values.ndim > 4 else values[..., 0]
    is_colored = image.get_data_dtype().names is not None
    if values.ndim != 3 + is_colored:
        sizes = " x ".join(map(str, values.shape))
        raise ValueError(f"an image of {sizes} holds several volumes; give .slicer[..., 0] of it")
    affine = np.eye(4) if image.affine is None else np.asarray(image.affine, np.float64)
    spacing = np.linalg.norm(affine[:3, :3], axis=0)
    steps = affine[:3, :3] / np.where(spacing > 0, spacing, 1)
    axes = (2, 1, 0, 3) if is_colored else (2, 1, 0)
    place = (spacing, TO_LPS @ affine[:3, 3], TO_LPS @ steps)
    intent = getattr(image.header, "get_intent", lambda: ("", "", ""))()[2]  # NIfTI's
    units = "hu" if is_hounsfield(str(intent)) else ""
    found = Volume(values.transpose(axes), *place, name, units, space="lps")
    given = getattr(image.header, "get_xyzt_units", lambda: ("mm",))()[0]
    unit, by = unit_of_length(given)
    return found._replace(spacing=by * spacing, origin=by * place[1], length=unit)


def _colors(values: NDArray[Any]) -> NDArray[Any]:
    """Move components named R, G, B to a last axis."""
    if values.dtype.names is None:
        return values
    return np.stack([values[each] for each in values.dtype.names], axis=-1)


def of_labeled(given: Any, part: Any, name: str) -> Volume:
    """Convert an array of xarray's, or a variable of a data set, with its coordinates."""
    if hasattr(given, "data_vars"):
        names = [str(each) for each in given.data_vars]
        if part not in names and (part or len(names) != 1):
            listed = ", ".join(names) or "there is none"
            raise ValueError(f"name a variable by part=NAME ({part or 'none'} given): {listed}")
        given = given[part or names[0]]
    else:
        check_whole(part, "an array of xarray's")
    dims = tuple(map(str, given.dims))
    named = {dim.lower(): dim for dim in dims}
    if len(dims) != 3 or (set(AXES) & set(named) and set(named) != set(AXES)):
        raise ValueError(
            f"a volume has the dimensions z, y and x, or three of other names, not "
            f"{', '.join(dims)}; take one of the others, such as .isel(time=0)"
        )
    order = tuple(named[axis] for axis in AXES) if set(named) == set(AXES) else given.dims
    turned = given.transpose(*order)
    values = np.asanyarray(turned.values)
    z, y, x = (_planes(turned, dim, n) for dim, n in zip(order, values.shape, strict=True))
    if 0 in values.shape:
        raise ValueError(f"a volume has voxels in it; got {values.shape}")
    return rectilinear(values, x, y, z, str(given.name or name))


def _planes(given: Any, dim: str, count: int) -> Doubles:
    """Return coordinates along a dimension; indices if it has none."""
    if dim not in given.coords:
        return np.arange(count, dtype=np.float64)
    along = np.asarray(given.coords[dim].values)
    if along.dtype.kind not in "iuf" or not np.isfinite(along).all():
        raise ValueError(f"coordinates along {dim} of {along.dtype}; they must be finite numbers")
    return along.astype(np.float64)


def of_grid(given: Any, part: Any, name: str) -> Volume:
    """Convert a field, whose values are at the centers of cells.

    `given`: it has `left_edge` and `right_edge` (3,), `ActiveDimensions` (3,), and fields (X, Y, Z)
    by name.
    """
    if not part:
        raise ValueError(
            f"{name}: name a field of the grid: part='density', or the pair (grid, 'density')"
        )
    try:
        values = np.asarray(given[part])
    except Exception as error:  # yt's own, of which one would have to import yt to know
        raise ValueError(f"{name}: no field {part!r:.60}: {one_line(error)}") from None
    shape = tuple(int(count) for count in np.asarray(given.ActiveDimensions))
    if values.shape != shape or len(shape) != 3:
        raise ValueError(f"{name}: field {part!r:.60} is {values.shape}, the grid is {shape}")
    low, high = (np.asarray(edge, np.float64) for edge in (given.left_edge, given.right_edge))
    spacing = (high - low) / shape
    return Volume(values.transpose(2, 1, 0), spacing, low + spacing / 2, np.eye(3), name)


def of_dataset(given: Any, part: Any, name: str) -> Volume:
    """Convert a data set; errors are those of readers of such files.

    `given`: `vtkImageData`, `vtkRectilinearGrid`, or what is resampled: a structured or
    unstructured grid, or blocks of any of these.
    """
    if not (given.IsA("vtkDataSet") or given.IsA("vtkCompositeDataSet")):
        raise TypeError(f"a volume of {type(given).__name__}; give a data set of VTK's with cells")
    wanted = ArrayQuery(str(part), "", "")
    if given.IsA("vtkImageData"):
        values, is_of_cells = _values(given, wanted, name)
        known = image_header(given, np.uint8, None, name, is_of_cells=is_of_cells)
        return Volume(values, known.spacing, known.origin, known.direction, name)
    if given.IsA("vtkRectilinearGrid"):
        from vtkmodules.util.numpy_support import vtk_to_numpy

        values, is_of_cells = _values(given, wanted, name)
        axes = (given.GetXCoordinates(), given.GetYCoordinates(), given.GetZCoordinates())
        x, y, z = (middles(vtk_to_numpy(axis), of_cells=is_of_cells) for axis in axes)
        return rectilinear(values, x, y, z, name)
    if absent := missing("readers", "vtu"):
        raise ValueError(f"{name} is a grid of cells; {absent}")
    return alone(load("readers", "vtu").of_dataset(given, wanted, name, check_alone))


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
