"""Convert arguments to pictures: arrays of any kind, files, images of other libraries."""

from os import PathLike
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.files.stores.addresses import Address, place_of

TAKEN = (
    "an array (H, W) or (H, W, C), nested lists, a path, an address of zarr, an image of Pillow's "
    "or SimpleITK's, or an xarray.DataArray"
)
ROWS, COLUMNS = ("y", "row", "rows", "lat", "latitude"), ("x", "column", "columns", "lon")
MODES = {"1": "L", "P": "RGBA", "PA": "RGBA", "CMYK": "RGB", "YCbCr": "RGB", "HSV": "RGB"}


def as_picture(given: Any, name: str = "picture") -> NDArray[Any]:
    """Convert an argument to an array, with its values unchanged.

    Parameters
    ----------
    given
        An array of real numbers of any layout and byte order, masked, memory-mapped or lazy; nested
        lists; the path or address of a picture; a Pillow image, whose palette becomes colors; a
        SimpleITK image; or an `xarray.DataArray` with rows along y and columns along x.

    Returns
    -------
    Masked arrays stay masked. Arrays that need no conversion are not copied.
    """
    return picture_and_encoding(given, name)[0]


def picture_and_encoding(given: Any, name: str = "picture") -> tuple[NDArray[Any], bool | None]:
    """Do as `as_picture`, and tell whether its levels are sRGB-encoded, if a file says so."""
    if isinstance(given, str | PathLike | Address):
        return _read(given)
    library = type(given).__module__.partition(".")[0]
    if library == "PIL":
        array = np.asarray(given.convert(MODES[given.mode]) if given.mode in MODES else given)
    elif library == "SimpleITK":
        array = _of_itk(given, name)
    elif hasattr(given, "dims") and hasattr(given, "coords"):
        array = _of_labeled(given, name)
    else:
        array = _array(given, name)
    if array.dtype.kind not in "biuf":
        raise TypeError(f"a {name} of {array.dtype}; its values must be real numbers")
    return array, None


def _read(path: str | PathLike[str] | Address) -> tuple[NDArray[Any], bool | None]:
    """Read levels of 8- and 16-bit pictures as stored; linear light of all others."""
    from resample.files.pictures import picture_at, read_picture

    found = picture_at(place_of(path))
    if found.is_plain:
        return found.load().data, found.is_encoded
    return read_picture(found.path).data, None


def _array(given: Any, name: str) -> NDArray[Any]:
    if not (isinstance(given, list | tuple) or hasattr(given, "__array__")):
        raise TypeError(f"a {name} of {type(given).__name__}; give {TAKEN}")
    try:
        return np.asanyarray(given)
    except ValueError:
        raise ValueError(f"lists of different lengths are not a {name}; give {TAKEN}") from None


def _of_itk(image: Any, name: str) -> NDArray[Any]:
    import SimpleITK

    if image.GetDimension() != 2:
        raise ValueError(f"an image of {image.GetDimension()} dimensions; a {name} has 2")
    return np.asarray(SimpleITK.GetArrayFromImage(image))


def _of_labeled(given: Any, name: str) -> NDArray[Any]:
    """Array of an xarray object, rows first, channels last."""
    dims = {str(dim).lower(): dim for dim in given.dims}
    rows = next((dims.pop(dim) for dim in ROWS if dim in dims), None)
    columns = next((dims.pop(dim) for dim in COLUMNS if dim in dims), None)
    if rows is None or columns is None or len(dims) > 1:
        raise ValueError(
            f"a {name} has the dimensions y and x, and one of channels if need be, not "
            f"{', '.join(map(str, given.dims))}"
        )
    return np.asarray(given.transpose(rows, columns, *dims.values()).values)
