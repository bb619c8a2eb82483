"""Convert volumes of other libraries: VTK, PyVista, SimpleITK, nibabel, xarray, yt."""

from collections.abc import Callable
from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.lengths import unit_of_length
from resample.memory.mapped import contiguous
from resample.messages import one_line
from resample.painting.scenes import check_lattice, check_places
from resample.registry import load, missing
from resample.types import Doubles
from resample_volume.classification.scales import LINEAR, scaled
from resample_volume.data.recordings import alone, check_whole, in_color, is_color
from resample_volume.data.rectilinear import rectilinear
from resample_volume.data.values import is_streamed
from resample_volume.files.headers import KEPT, check_alone, check_shape
from resample_volume.files.nifti import TO_LPS
from resample_volume.files.sections import ArrayQuery, cells_between, choose, middles
from resample_volume.files.source import open_volume
from resample_volume.files.texts import is_hounsfield
from resample_volume.files.vtk import arrays_of, image_header, points_along
from resample_volume.types import Part, Volume

AXES = ("z", "y", "x")


def of_simple_itk(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of SimpleITK's with its geometry."""
    import SimpleITK

    check_whole(part, "an image of SimpleITK's")
    if image.GetDimension() != 3:
        raise ValueError(f"an image of {image.GetDimension()} dimensions; a volume has 3")
    given = (image.GetSpacing(), image.GetOrigin(), image.GetDirection())
    spacing, origin, direction = (np.array(each, np.float64) for each in given)
    values = SimpleITK.GetArrayFromImage(image)
    return Volume(values, spacing, origin, direction.reshape(3, 3), name)


def of_nibabel(image: Any, part: Any, name: str) -> Volume:
    """Convert an image of nibabel's, of values or colors, to LPS, scaled as its header says."""
    check_whole(part, "an image of nibabel's")
    if not (hasattr(image, "dataobj") and hasattr(image, "affine")):
        raise TypeError(f"a volume of nibabel's {type(image).__name__}; give an image of voxels")
    values = np.asanyarray(image.dataobj)
    if (parts := values.dtype.names) is not None:  # components R, G, B become a last axis
        values = np.stack([values[each] for each in parts], axis=-1)
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
    planes = []
    for dim, count in zip(order, values.shape, strict=True):
        along = np.asarray(turned.coords[dim].values) if dim in turned.coords else np.arange(count)
        if along.dtype.kind not in "iuf" or not np.isfinite(along).all():
            raise ValueError(
                f"coordinates along {dim} of {along.dtype}; they must be finite numbers"
            )
        planes.append(along.astype(np.float64))
    z, y, x = planes
    if 0 in values.shape:
        raise ValueError(f"a volume has voxels in it; got {values.shape}")
    return rectilinear(values, x, y, z, str(given.name or name))


def of_grid(given: Any, part: Any, name: str) -> Volume:
    """Convert a field of yt's, of values at the centers of cells."""
    if not part:
        raise ValueError(
            f"{name}: name a field of the grid: part='density', or the pair (grid, 'density')"
        )
    try:
        values = np.asarray(given[part])
    except Exception as error:  # yt's own types, which are unknown before yt is imported
        raise ValueError(f"{name}: no field {part!r:.60}: {one_line(error)}") from None
    shape = tuple(int(count) for count in np.asarray(given.ActiveDimensions))
    if values.shape != shape or len(shape) != 3:
        raise ValueError(f"{name}: field {part!r:.60} is {values.shape}, the grid is {shape}")
    low, high = (np.asarray(edge, np.float64) for edge in (given.left_edge, given.right_edge))
    spacing = (high - low) / shape
    return Volume(values.transpose(2, 1, 0), spacing, low + spacing / 2, np.eye(3), name)


def of_dataset(given: Any, part: Any, name: str) -> Volume:
    """Convert a data set of VTK's; grids other than images and rectilinear are resampled."""
    if not (given.IsA("vtkDataSet") or given.IsA("vtkCompositeDataSet")):
        raise TypeError(f"a volume of {type(given).__name__}; give a data set of VTK's with cells")
    wanted = ArrayQuery(str(part), "", "")
    if not (given.IsA("vtkImageData") or given.IsA("vtkRectilinearGrid")):
        if absent := missing("readers", "vtu"):
            raise ValueError(f"{name} is a grid of cells; {absent}")
        return alone(load("readers", "vtu").of_dataset(given, wanted, name, check_alone))
    from vtkmodules.util.numpy_support import vtk_to_numpy

    arrays = arrays_of(given)
    names = [named for named, _ in arrays]
    chosen, points = choose(names, wanted, name), points_along(given)
    shape = cells_between(points) if chosen.is_of_cells else points
    check_shape(shape, name)
    values = vtk_to_numpy(arrays[names.index(chosen)][1])  # holds a reference to VTK's memory
    values = values.reshape(*shape[::-1], *values.shape[1:])
    if given.IsA("vtkImageData"):
        known = image_header(given, np.uint8, None, name, is_of_cells=chosen.is_of_cells)
        return Volume(values, known.spacing, known.origin, known.direction, name)
    axes = (given.GetXCoordinates(), given.GetYCoordinates(), given.GetZCoordinates())
    x, y, z = (middles(vtk_to_numpy(axis), of_cells=chosen.is_of_cells) for axis in axes)
    return rectilinear(values, x, y, z, name)


TAKEN = (
    "an array (Z, Y, X), nested lists, a path, a Volume, or one of xarray, SimpleITK, nibabel, "
    "VTK, PyVista or yt"
)
WIDE = np.iinfo(np.int32)


def as_volume(given: Any, name: str = "array", *, part: Part = "", scale: str = LINEAR) -> Volume:
    """Convert an array, a path or another library's image to a volume.

    Parameters
    ----------
    given
        A `Volume` as it is; the path of a file, a folder of slices or a generated volume's name;
        an array (Z, Y, X), or (Z, Y, X, 3 or 4) of colors, of any real type and layout, masked,
        mapped from a file, of dask or as nested lists, with spacing 1 around no origin in
        particular; an `xarray.DataArray`: its coordinates along z, y and x give spacing and
        origin; an image of SimpleITK's or nibabel's; a data set of VTK's or PyVista's (unstructured
        grids are resampled onto a lattice, as from files); or a covering or arbitrary grid of yt's.
        A pair `(grid, "density")` is the same as a grid with `part`.
    name
        For titles and messages.
    part
        Name of the array, field or variable, where there are several: in a data set of VTK's, a
        grid of yt's, a `Dataset` of xarray's.
    scale
        `log` or `symlog:linear=0.01`: the field is replaced by its logarithms, which are
        interpolated, classified and shaded. Looks given as text still refer to the original values.

    Returns
    -------
    The volume. Values are not copied unless they are converted. Masked values become NaN.

    Raises
    ------
    TypeError
        Its type is another, or its values are not real numbers.
    ValueError
        It has another shape, no voxels, or no value that has a logarithm.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> from resample_volume import as_volume
    >>> as_volume([[[0, 1], [2, 3]], [[4, 5], [6, 7]]]).values.shape
    (2, 2, 2)
    >>> as_volume([[[1e-30, 1e-24]]], scale="log").values.tolist()
    [[[-30.0, -24.0]]]
    >>> as_volume("checker-box:size=16,block=4").values.dtype
    dtype('uint8')
    """
    if isinstance(given, Volume | str | PathLike):
        check_whole(part, "a file" if not isinstance(given, Volume) else given.name)
        made = _checked(given) if isinstance(given, Volume) else open_volume(str(given))
        return scaled(made, scale)
    if isinstance(given, tuple) and len(given) == 2:  # a grid and a part, in one word or several
        grid, words = given
        several = words if isinstance(words, tuple) else (words,)
        if several and all(isinstance(word, str) for word in several):
            return as_volume(grid, name, part=words, scale=scale)
    # Find the converter of an object of a known library
    every = type(given).__mro__
    homes = {kind.__module__.partition(".")[0] for kind in every}
    taker: Callable[[Any, Any, str], Volume] | None = None
    if "vtkObjectBase" in {kind.__name__ for kind in every}:  # PyVista's, too
        taker = of_dataset
    elif "SimpleITK" in homes or "nibabel" in homes:
        taker = of_simple_itk if "SimpleITK" in homes else of_nibabel
    elif hasattr(given, "dims") and hasattr(given, "coords"):
        taker = of_labeled
    elif hasattr(given, "left_edge") and hasattr(given, "ActiveDimensions"):
        taker = of_grid
    if taker is None:
        check_whole(part, "an array")
        return scaled(_placed(_array(given), name), scale)
    made = taker(given, part, name)
    placed = _placed(_array(made.values), made.name, *made[1:4])
    kept = {name: getattr(made, name) for name in ("units", "note", "space", "length")}
    return scaled(placed._replace(**kept), scale)


def _checked(given: Volume) -> Volume:
    """Check a volume's values and geometry, and return it with a supported type."""
    if any(type(part) is not np.ndarray for part in given[1:4]):
        spacing, origin, direction = (contiguous(part, np.float64) for part in given[1:4])
        given = given._replace(spacing=spacing, origin=origin, direction=direction)
    made = given
    if not is_streamed(given):
        values = _array(given.values)
        if values.ndim != 3 or 0 in values.shape:
            raise ValueError(
                f"a volume is an array (Z, Y, X) with voxels in it, not {values.shape}"
            )
        made = given if values is given.values else given._replace(values=values)
    # Reject an invalid or absurd spacing, origin or direction
    spacing, origin, direction = (np.asarray(part) for part in given[1:4])
    shapes = (spacing.shape, origin.shape, direction.shape)
    kinds = {part.dtype.kind for part in (spacing, origin, direction)}
    if shapes != ((3,), (3,), (3, 3)) or not kinds <= set("iuf"):
        raise ValueError(
            f"{given.name}: spacing, origin and direction are numbers (3,), (3,) and (3, 3), not "
            f"{', '.join(map(str, shapes))}"
        )
    if not (spacing > 0).all():
        raise ValueError(f"{given.name}: spacing {spacing.tolist()} must be above 0")
    check_lattice(direction * spacing, f"{given.name}: its lattice")
    check_places(origin, f"{given.name}: its origin")
    return made


def _array(given: Any) -> NDArray[Any]:
    """Convert an array or nested lists to values of a supported type."""
    if not (isinstance(given, list | tuple) or hasattr(given, "__array__")):
        raise TypeError(f"a volume of {type(given).__name__}; give {TAKEN}")
    try:
        values = np.asanyarray(given)
    except (ValueError, TypeError, RuntimeError) as error:
        if isinstance(given, list | tuple):
            raise ValueError("lists of different lengths are not a volume; give " + TAKEN) from None
        raise TypeError(f"a volume of {type(given).__name__}: {one_line(error)}") from None
    if values.dtype.kind not in "biuf":
        raise TypeError(f"a volume of {values.dtype}; its values must be real numbers")
    if type(values) is np.ndarray and values.dtype.isnative and values.dtype.name in KEPT:
        return values
    if isinstance(values, np.ma.MaskedArray):
        wide = np.asarray(values.data, np.result_type(values.dtype, np.float32))
        values = np.where(np.ma.getmaskarray(values), np.nan, wide)
    values = np.asarray(values)
    # Convert values to the nearest supported type
    kind, size = values.dtype.kind, values.dtype.itemsize
    if kind == "b":
        return values.view(np.uint8) if values.flags.c_contiguous else values.astype(np.uint8)
    if kind == "f":
        known = np.float32 if size < 4 else np.float64 if size > 8 else values.dtype
        return values.astype(np.dtype(known).newbyteorder("="), copy=False)
    if size == 8 or (kind == "u" and size == 4):
        low, high = (int(values.min()), int(values.max())) if values.size else (0, 0)
        fits = WIDE.min <= low and high <= WIDE.max
        return values.astype(np.int32 if fits else np.float64)
    return values.astype(values.dtype.newbyteorder("="), copy=False)


def _placed(
    values: NDArray[Any],
    name: str,
    spacing: Doubles = np.ones(3),  # noqa: B008 - never changed
    origin: Doubles = np.zeros(3),  # noqa: B008
    direction: Doubles = np.eye(3),  # noqa: B008
) -> Volume:
    """Make a volume of an array (Z, Y, X), or of colors."""
    colored = values.ndim == 4 and is_color(values.shape, values.dtype)
    if (values.ndim != 3 and not colored) or 0 in values.shape:
        turned = values.shape[1:] + values.shape[:1]
        remedy = "of several give one"
        if values.ndim == 4 and is_color(turned, values.dtype):
            remedy = "if channels come first, give numpy.moveaxis(values, 0, -1)"
        raise ValueError(
            f"a volume is an array (Z, Y, X) with voxels in it, not {values.shape}; {remedy}"
        )
    first = values[..., 0] if colored else values
    volume = Volume(first, spacing, origin, direction, name)
    return in_color(values, volume) if colored else volume
