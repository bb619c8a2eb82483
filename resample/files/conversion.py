"""Convert arguments to pictures, and results to levels, Pillow images, PNG and summaries."""

from io import BytesIO
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray

from resample.colors import from_srgb, mapped, over
from resample.console import Color, linear_color
from resample.files.saving import screen_levels, tell_empty, write_frame
from resample.files.stores import Address, place_of
from resample.messages import check_kind, one_line, shortly
from resample.showable import Behind, ChannelOrder, Showable
from resample.types import Floats, Frame, Statistics

if TYPE_CHECKING:
    from PIL.Image import Image

BACKGROUNDS = "3 of linear light, #rrggbb or a color's name"
TAKEN = (
    "an array (H, W) or (H, W, C), nested lists, a path, an address of zarr, an image of Pillow's "
    "or SimpleITK's, an xarray.DataArray, or a result such as a Frame"
)
ROWS, COLUMNS = ("y", "row", "rows", "lat", "latitude"), ("x", "column", "columns", "lon")
MODES = {"1": "L", "P": "RGBA", "PA": "RGBA", "CMYK": "RGB", "YCbCr": "RGB", "HSV": "RGB"}
COLORMAP = "turbo"
PERCENTILES = (0.5, 99.5)  # range of the finite values that false colors span
ENCODED = (np.dtype(np.uint8), np.dtype(np.uint16))  # types with sRGB-encoded light
NOTEBOOK = 2048  # px; larger pictures are reduced for notebooks
HOLE_COLORS = "tab10"
MEASURED = ("depth", "first_depth", "coverage", "value", "holes", "magnification", "confidence")


def as_picture(given: Any, name: str = "picture") -> NDArray[Any]:
    """Convert an argument to an array, with its values unchanged.

    `given`: an array of real numbers of any layout and byte order, masked, memory-mapped or lazy;
    nested lists; the path or address of a picture; a Pillow image (palettes become colors); a
    SimpleITK image; an `xarray.DataArray` with rows along y and columns along x; or a result:
    its `image` or `rgba`. Result: masked arrays stay masked. Arrays that need no conversion
    are not copied.
    """
    return picture_and_encoding(given, name)[0]


def picture_and_encoding(
    given: Any, name: str = "picture", kinds: str = "biuf"
) -> tuple[NDArray[Any], bool | None]:
    """Return `as_picture`'s array, and whether its levels are sRGB-encoded, if a file says so.

    `kinds`: NumPy's letters of the kinds of values that are taken.
    """
    if isinstance(given, str | PathLike | Address):
        from resample.files.pictures import picture_at, read_picture

        found = picture_at(place_of(given))
        if found.is_plain:
            found.tell_colors()
            return found.load().data, found.is_encoded
        return read_picture(found.path).data, None
    if isinstance(given, Showable):
        return (given.rgba if isinstance(given, Frame) else given.image), None
    library = type(given).__module__.partition(".")[0]
    if library == "PIL":
        array = np.asarray(given.convert(MODES[given.mode]) if given.mode in MODES else given)
    elif library == "SimpleITK":
        import SimpleITK

        if given.GetDimension() != 2:
            raise ValueError(f"an image of {given.GetDimension()} dimensions; a {name} has 2")
        array = np.asarray(SimpleITK.GetArrayFromImage(given))
    elif hasattr(given, "dims") and hasattr(given, "coords"):
        dims = {str(dim).lower(): dim for dim in given.dims}
        rows = next((dims.pop(dim) for dim in ROWS if dim in dims), None)
        columns = next((dims.pop(dim) for dim in COLUMNS if dim in dims), None)
        if rows is None or columns is None or len(dims) > 1:
            raise ValueError(
                f"a {name} has the dimensions y and x, and one of channels if need be, not "
                f"{', '.join(map(str, given.dims))}"
            )
        array = np.asarray(given.transpose(rows, columns, *dims.values()).values)
    elif isinstance(given, list | tuple) or hasattr(given, "__array__"):
        try:
            array = np.asanyarray(given)
        except (ValueError, TypeError, RuntimeError) as error:
            if isinstance(given, list | tuple):
                uneven = f"lists of different lengths are not a {name}; give {TAKEN}"
                raise ValueError(uneven) from None
            # Tensors that have a gradient, or are on a device, say what to call.
            raise TypeError(f"a {name} of {type(given).__name__}: {one_line(error)}") from None
    else:
        raise TypeError(f"a {name} of {type(given).__name__}; give {TAKEN}")
    if array.dtype.kind not in kinds:
        numbers = "real or complex numbers" if "c" in kinds else "real numbers"
        raise TypeError(f"a {name} of {array.dtype}; its values must be {numbers}")
    return array, None


def save(result: Any, path: str | Path, *, bits: int, background: Behind) -> None:
    """Write a result; see `resample.showable.Showable.save`."""
    check_kind("path", path, str | PathLike, "a text or a pathlib.Path")
    frame = result
    if not isinstance(result, Frame):
        light, coverage = light_of(result), np.asarray(result.coverage, np.float32)
        depth = getattr(result, "depth", np.full(light.shape[:2], np.inf, np.float32))
        frame = Frame(light, depth, depth, coverage, Statistics(0, 0, 0, 0, 1, {}))
    write_frame(Path(path), frame, bits, _behind(background))
    tell_empty(Path(path), not frame.coverage.any())


def composited(frame: Frame, background: Behind) -> Frame:
    """Composite a frame over a background; see `resample.types.Frame.over`."""
    behind = _behind(background)
    if behind is None:
        return frame
    opaque = np.ones((*frame.rgba.shape[:2], 1), np.float32)
    return frame._replace(rgba=np.concatenate([over(frame.rgba, behind), opaque], axis=-1))


def _behind(background: Behind) -> Color | None:
    """Linear light of a background; None: transparent."""
    if background is None or isinstance(background, str):
        return None if background is None else linear_color(background)
    try:
        light = [float(part) for part in background]
    except TypeError:
        raise TypeError(f"background {shortly(background)}; give {BACKGROUNDS}") from None
    if len(light) != 3:
        raise ValueError(f"a background of {len(light)} values; give {BACKGROUNDS}")
    red, green, blue = light
    return red, green, blue


def levels_of(
    result: Any, of: str, *, background: Behind = None, order: ChannelOrder = "rgb"
) -> NDArray[np.uint8]:
    """8-bit levels of a part of a result; see `resample.showable.Showable.to_uint8`."""
    if order not in get_args(ChannelOrder):
        raise ValueError(f"order {order!r}; give {' or '.join(get_args(ChannelOrder))}")
    if of != "color":
        light = _false_colors(result, of)
        levels = screen_levels(np.dstack([light, np.ones_like(light[..., :1])]))[..., :3]
    else:
        levels = screen_levels(light_of(result), background=_behind(background))
    if order == "bgr":
        return np.ascontiguousarray(levels[..., [2, 1, 0, 3][: levels.shape[2]]])
    return levels


def image_of(result: Any, of: str, *, background: Behind = None) -> "Image":
    """Convert a result to a Pillow image."""
    from PIL import Image

    return Image.fromarray(levels_of(result, of, background=background))


def png_of(result: Any) -> bytes:
    """PNG of a result, reduced to a size for notebooks."""
    image, file = image_of(result, "color"), BytesIO()
    image.thumbnail((NOTEBOOK, NOTEBOOK))
    image.save(file, "png")
    return file.getvalue()


def line_about(result: Any) -> str:
    """Class, size and covered fraction of a result."""
    name = type(result).__name__
    if isinstance(result, Frame):
        height, width = result.depth.shape
        near = result.first_depth[np.isfinite(result.first_depth)]
        depth = f", depth from {near.min():.4g}" if near.size else ""
        return f"{name}({width} × {height} px, {_covered(result)}{depth})"
    image = np.ma.getdata(result.image)
    size = " × ".join(map(str, image.shape))
    return f"{name}({size} {image.dtype}, {_covered(result)})"


def light_of(result: Any) -> Floats:
    """Premultiplied linear light (H, W, 4) of a result."""
    if isinstance(result, Frame):
        return result.rgba
    stored = np.ma.getdata(result.image)
    image = stored[..., np.newaxis] if stored.ndim == result.coverage.ndim else stored
    if image.ndim != 3 or image.shape[2] > 4:
        raise ValueError(
            f"{stored.shape} is not a picture (H, W) or (H, W, C) of up to 4 channels; take one of "
            "a batch, or some of the channels"
        )
    # Values (H, W, C) as linear light; missing values are black.
    values = np.nan_to_num(image.astype(np.float32))
    if image.dtype in ENCODED:
        values /= np.float32(np.iinfo(image.dtype).max)
        values[..., :3] = from_srgb(values[..., :3])
    elif image.dtype.kind in "iu":
        values /= max(1.0, float(np.abs(values).max(initial=0)))
    if image.shape[2] in (1, 2):
        values = np.repeat(values[..., :1], 3, axis=2)
    if values.shape[2] == 4:
        if stored.dtype in ENCODED:  # straight opacity
            values[..., :3] *= values[..., 3:]
        return values
    coverage = np.asarray(result.coverage, np.float32)[..., np.newaxis]
    if not getattr(result, "is_premultiplied", True):
        values = values * coverage
    return np.concatenate([values, coverage], axis=2)


def _false_colors(result: Any, of: str) -> Floats:
    """Linear light (H, W, 3) in false colors for a part; black where it has no values."""
    known = [part for part in MEASURED if getattr(result, part, None) is not None]
    if of not in known:
        raise ValueError(
            f"{type(result).__name__} has no part {of!r}; it has color, {', '.join(known)}"
        )
    values = np.asarray(getattr(result, of), np.float64)
    if of == "holes":
        kinds = mapped(HOLE_COLORS, np.arange(0.05, 1, 0.1))
        return np.where(values[..., None] > 0, kinds[values.astype(int) % 10], np.float32(0))
    finite = np.isfinite(values)
    low, high = np.percentile(values[finite], PERCENTILES) if finite.any() else (0.0, 1.0)
    share = np.clip((np.where(finite, values, low) - low) / max(high - low, 1e-30), 0, 1)
    colors = mapped(COLORMAP, share.ravel()).reshape(*values.shape, 3)
    return np.where(finite[..., None], colors, np.float32(0))


def _covered(result: Any) -> str:
    return f"{100 * float(np.mean(result.coverage > 0)):.3g} % covered"
