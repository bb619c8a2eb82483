"""Check a warp's arguments: sizes, edge modes, methods, geometries, regions and stacks."""

import dataclasses
import math
import operator
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from os import PathLike
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample import registry
from resample.calling import choice_meant
from resample.cameras.models import Convention
from resample.files.conversion import picture_and_encoding
from resample.files.stores import Address
from resample.messages import doubles_of, shortly, warn
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Geometry,
    Homography,
    Size,
    TargetRegion,
)
from resample_texture.geometry.matrices import homography, resizing, scaled_shape
from resample_texture.texels.encoding import masked
from resample_texture.types import FRAMES, AnyAlpha, AnyAxis, Edge, Fill, Method, Warped

LARGEST_PICTURE = 1 << 30  # pixels; a larger size is taken for a mistake
MARGIN = 3  # px of a map around a region, beyond the filter, from which pixel sizes are estimated
REFLECT_101 = "reflect-101"  # as `mirror`, about the outermost texels' centers: d c b | a b c d

Places = Callable[[Any, Any], Any]  # from x and y in the target to x and y in the source
MOST_CHANNELS = 15  # of an array with an unnamed last axis
MOST_COLORS = 4  # so many numbers are likelier channels than columns of narrow frames
CHANNELS: Literal[-1] = -1
PREMULTIPLIED: Literal["premultiplied"] = "premultiplied"
Fit = Literal["contain", "cover", "stretch", "pad"]
AnySize = tuple[int, int] | int | float  # height and width; longer side; share


def edge_named(name: str) -> str:
    """Return the edge mode of a name: an `Edge`, or `REFLECT_101`."""
    known = (*Edge, REFLECT_101)
    meant = choice_meant(name, known) if isinstance(name, str) and name not in known else name
    if meant not in known:
        raise ValueError(f"edge {name!r}; known: {', '.join(known)}")
    return meant if meant == REFLECT_101 else Edge(meant)


def geometry_of(given: Any, shape: Size, convention: str, inverse: bool) -> Geometry:
    """Return the geometry of a matrix, a function, a pair of maps, a transform, or a geometry."""
    if isinstance(given, Homography | ForwardMap | BackwardMap):
        if inverse or convention != "corner":
            raise ValueError("convention and inverse apply to a matrix, not to a geometry")
        return given
    if np.shape(params := getattr(given, "params", ())) == (3, 3):  # of scikit-image
        return homography(params, convention=Convention.OPENCV, inverse=inverse)
    if is_transform(given):
        return BackwardMap.from_function(places_of_points(given, inverse), shape, first=0.0)
    if not callable(given) and not is_pair_of_maps(given):
        return homography(given, convention=convention, inverse=inverse)
    if inverse:
        raise ValueError("a function or map always maps target to source; leave inverse out")
    if is_pair_of_maps(given):
        return BackwardMap.from_opencv(*given)
    if convention not in tuple(Convention):
        raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
    return BackwardMap.from_function(given, shape, first=0.5 if convention == "corner" else 0.0)


def is_pair_of_maps(given: Any) -> bool:
    """Whether something is a pair of maps, or a map and None, as `cv2.remap` takes it."""
    is_pair = isinstance(given, tuple) and len(given) == 2
    return is_pair and isinstance(given[0], np.ndarray) and given[0].ndim > 1


def is_transform(given: Any) -> bool:
    """Whether something maps points and has an inverse, as scikit-image's transforms do."""
    return callable(given) and hasattr(type(given), "inverse")


def places_of_points(transform: Any, is_forward: bool) -> Places:
    """Return a function of x and y, any shape, for a transform of points (M, 2), or its inverse."""
    try:
        function = transform if is_forward else transform.inverse
    except NotImplementedError:
        raise ValueError(
            f"{type(transform).__name__} knows no inverse; estimate it from target to source, and"
            " give inverse=True"
        ) from None

    def places(x: Any, y: Any) -> tuple[Any, Any]:
        pairs = np.asarray(function(np.stack([np.ravel(x), np.ravel(y)], axis=1)))
        if pairs.shape != (np.size(x), 2):
            raise ValueError(
                f"the map of points returned {pairs.shape} for places of {(np.size(x), 2)};"
                " it must return as many"
            )
        return pairs[:, 0].reshape(np.shape(x)), pairs[:, 1].reshape(np.shape(x))

    return places


def within(
    geometry: Geometry | Places, shape: Size, roi: tuple[int, int, int, int],
    chosen: Method,
) -> tuple[Geometry, tuple[int, int], tuple[slice, slice]]:  # fmt: skip
    """Return geometry and shape of tiles around a region, and the region within them."""
    try:
        left, top, width, height = (operator.index(side) for side in roi)
    except (TypeError, ValueError):
        raise ValueError(
            f"{shortly(roi)} is not a region: give left, top, width and height, whole numbers of px"
        ) from None
    if left < 0 or top < 0 or left + width > shape[1] or top + height > shape[0]:
        raise ValueError(f"the region {roi} does not lie within {shape[1]} × {shape[0]} px")
    check_shape((height, width))
    tile = getattr(chosen, "tile", 1)
    if isinstance(geometry, BackwardMap) and geometry.x.shape != shape:
        raise ValueError(f"a map of {geometry.x.shape} does not fit a target of {shape}")
    if isinstance(geometry, BackwardMap) or callable(geometry):
        margin = MARGIN + math.ceil(getattr(getattr(chosen, "filter", None), "radius", 0.0))
        (left, top, right, bottom), part = _around(roi, shape, margin, tile)
        form = bottom - top, right - left
        if isinstance(geometry, BackwardMap):
            seen = np.s_[top:bottom, left:right]
            return BackwardMap(geometry.x[seen], geometry.y[seen]), form, part
        places = geometry
        around = BackwardMap.from_function(lambda x, y: places(x + left, y + top), form)
        return around, form, part
    if isinstance(geometry, ForwardMap):
        return ForwardMap(geometry.x - left, geometry.y - top), (height, width), np.s_[:, :]
    (left, top, right, bottom), part = _around(roi, shape, 0, tile)
    moved = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]]) @ geometry.matrix
    region = TargetRegion(geometry, left, top, shape)
    if geometry.region is not None:
        outer = geometry.region
        region = outer._replace(left=left + outer.left, top=top + outer.top)
    return Homography(moved, geometry.is_signed, region), (bottom - top, right - left), part


def _around(
    roi: tuple[int, int, int, int], shape: Size, margin: int, tile: int
) -> tuple[tuple[int, int, int, int], tuple[slice, slice]]:
    """Return the bounds of whole tiles around a region and a margin, and the region in them."""
    left, top, width, height = (int(side) for side in roi)
    x, y = max(left - margin, 0) // tile * tile, max(top - margin, 0) // tile * tile
    right = min(-(-(left + width + margin) // tile) * tile, shape[1])
    bottom = min(-(-(top + height + margin) // tile) * tile, shape[0])
    return (x, y, right, bottom), np.s_[top - y : top - y + height, left - x : left - x + width]


def whole_pair(given: Sequence[int], first: str, second: str) -> tuple[int, int]:
    """Return two whole numbers of px."""
    try:
        numbers = [operator.index(number) for number in given]
    except TypeError:
        numbers = []
    if len(numbers) != 2:
        raise ValueError(
            f"{shortly(given)} is not {first} and {second}: give two whole numbers of px"
        )
    return numbers[0], numbers[1]


def check_shape(shape: Size) -> None:
    """Reject an impossible height and width of a target."""
    height, width = shape
    if min(height, width) < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a target of {width} × {height} px; give a height and a width of 1 px or more, "
            f"together at most {LARGEST_PICTURE} px"
        )


def adds(method: Method) -> bool:
    """Whether a method preserves sums instead of means."""
    return dataclasses.is_dataclass(method) and bool(getattr(method, "total", False))


def check_sums(dtype: np.dtype[Any], method: Method) -> None:
    """Reject sums of whole numbers, which overflow their types."""
    if dtype.kind in "bui" and adds(method):
        raise ValueError(f"sums do not fit {dtype}; give floats: image.astype('float32')")


def fill_for(fill: Fill | None, image: Any, alpha: AnyAlpha | None, method: Method) -> Any:
    """Return the value of pixels without any; None: the picture is multiplied by its coverage."""
    is_total, is_complex = adds(method), image.dtype.kind == "c"
    has_alpha = len(image.shape) > 2 and image.shape[-1] == 4 and alpha != "none" and not is_complex
    if fill == PREMULTIPLIED:
        return None
    if fill is None:  # floats and masked arrays are measurements
        is_measured = image.dtype.kind in "fc" or isinstance(image, np.ma.MaskedArray)
        return math.nan if is_measured and not (is_total or has_alpha) else None
    if isinstance(fill, str) and fill in ("black", "white"):
        whole = np.iinfo(image.dtype).max if image.dtype.kind in "ui" else 1
        fill = whole if fill == "white" else 0
    if isinstance(fill, str) or not np.isscalar(fill):
        raise ValueError(f"fill is a number, 'black', 'white' or {PREMULTIPLIED!r}, not {fill!r}")
    if is_total or has_alpha:
        kind = "totals are 0" if is_total else "pictures with opacity are transparent"
        raise ValueError(f"{kind} where nothing is; leave fill out")
    if isinstance(fill, complex) and not is_complex:
        raise ValueError(f"fill {fill!r} of a picture of {image.dtype}; give a real number")
    if image.dtype.kind in "bui" and not _holds(image.dtype, fill):
        raise ValueError(f"fill {fill!r} does not fit {image.dtype}; give a value of that type")
    return fill


def _holds(dtype: np.dtype[Any], value: Any) -> bool:
    """Whether a type of whole numbers has a value."""
    if dtype.kind == "b":
        return value in (0, 1)
    limits = np.iinfo(dtype)
    return bool(np.isfinite(value) and value == int(value) and limits.min <= value <= limits.max)


def without_nodata(image: NDArray[Any], nodata: complex | None) -> NDArray[Any]:
    """Mask the value for missing data."""
    if nodata is None:
        return image
    if isinstance(image, np.ma.MaskedArray):
        raise ValueError("a masked array marks missing values; leave nodata out")
    if image.dtype.kind in "bui" and not _holds(image.dtype, nodata):
        raise ValueError(f"nodata {nodata!r} does not fit {image.dtype}; give a value of that type")
    missing = np.isnan(image) if np.isnan(nodata) else image == image.dtype.type(nodata)
    return np.ma.MaskedArray(image, missing)


def warn_if_unknown(image: NDArray[Any]) -> None:
    """Warn of pictures with only missing values."""
    if image.size and image.dtype.kind in "fc" and not np.isfinite(image.flat[0]):
        known = np.isfinite(np.ma.getdata(image)) & ~np.ma.getmaskarray(image)
        if not known.any():
            warn("no value of the picture is finite, so that none of the result is")


def check_out(out: NDArray[Any], shape: tuple[int, ...], image: NDArray[Any]) -> None:
    """Reject an `out` array that does not fit the result."""
    if not isinstance(out, np.ndarray) or out.shape != shape or out.dtype != image.dtype:
        given = f"{out.dtype} of {out.shape}" if isinstance(out, np.ndarray) else repr(type(out))
        raise ValueError(f"out is {given}; the result is {image.dtype} of {shape}")
    if isinstance(image, np.ma.MaskedArray) and not isinstance(out, np.ma.MaskedArray):
        raise ValueError("out has no mask; give a masked array for a masked picture")
    if not out.flags.writeable:
        raise ValueError("out is read-only; give an array that can be written")


_method = lru_cache(maxsize=16)(partial(registry.build, "methods"))  # they do not change


def method_named(method: str | Method, **choices: Any) -> Method:
    """Return a method by name, with the given choices."""
    chosen: Any = _method(method) if isinstance(method, str) else method
    if not callable(chosen):
        raise TypeError(f"method {shortly(method)}; give a name or an object that warps")
    made = {name: value for name, value in choices.items() if value is not None}
    known = {f.name for f in dataclasses.fields(chosen)} if dataclasses.is_dataclass(chosen) else ()
    for name in made:
        if name not in known:
            raise ValueError(f"{method} takes no {name}; hybrid does")
    result: Method = dataclasses.replace(chosen, **made) if made else chosen
    return result


class GivenPictures(NamedTuple):
    """A picture, or a stack of them, its axis and whether it is encoded."""

    values: NDArray[Any]  # (H, W) or (H, W, C), or (N, ...) of them
    is_encoded: bool | None  # whether its file says that levels are sRGB-encoded
    axis: AnyAxis | None  # 0: a stack; -1: a picture with channels; None: without

    @property
    def is_stack(self) -> bool:
        """Whether the first axis counts frames."""
        return self.axis == FRAMES

    def check_alone(self, name: str) -> None:
        """Reject a stack of pictures."""
        if self.is_stack:
            raise ValueError(f"{name} is of one picture, not of a stack {self.values.shape}")

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of each picture."""
        height, width = self.values.shape[self.is_stack :][:2]
        return height, width


def given_pictures(
    given: Any, axis: AnyAxis | None = None, matrices: int | None = None, kinds: str = "biufc"
) -> GivenPictures:
    """Read an argument of `warp` as a picture or a stack; see `axis_of`."""
    values, is_encoded = given, None
    if type(given) not in (np.ndarray, np.ma.MaskedArray) or given.dtype.kind not in kinds:
        values, is_encoded = picture_and_encoding(given, kinds=kinds)
    is_named = isinstance(given, str | PathLike | Address) or hasattr(given, "dims")
    if is_named and axis is None and values.ndim == 3:
        axis = CHANNELS  # files and names of dimensions say so
    return GivenPictures(values, is_encoded, axis_of(values, axis, matrices))


def axis_of(image: Any, axis: AnyAxis | None = None, matrices: int | None = None) -> AnyAxis | None:
    """Return the axis of an array that does not belong to a picture: 0, -1, or None.

    `axis`: as `warp` takes it; by default three dimensions are a picture of up to 15 channels,
    unless there is a matrix for each frame. `matrices`: number of matrices, if they are a stack.
    """
    shape = image.shape
    if image.ndim not in (2, 3, 4) or 0 in shape:
        raise ValueError(
            f"a picture is (H, W) or (H, W, C), a stack of them (N, H, W) with axis=0, or"
            f" (N, H, W, C), and none is empty; not {shape}"
        )
    if axis not in (None, FRAMES, CHANNELS, 2) or isinstance(axis, bool):
        raise ValueError(f"axis {shortly(axis)}; give 0 for frames, or -1 for channels")
    if axis is not None and (image.ndim, axis == FRAMES) in ((2, True), (2, False), (4, False)):
        raise ValueError(f"axis {axis} of {shape}; leave that out, its dimensions say enough")
    if image.ndim == 2:
        return None
    found = axis
    if axis is None:
        rows, columns, channels = shape[-3:]
        is_narrow, is_one = channels <= MOST_CHANNELS, image.ndim == 3
        has_each = matrices == shape[0]
        if is_one and has_each and not is_narrow:
            found = FRAMES
        elif is_narrow and (not is_one or not has_each or channels <= MOST_COLORS):
            found = CHANNELS if is_one else FRAMES
        else:
            told = "" if matrices is None else f", with {matrices} matrices,"
            kinds = "axis=-1 if so, axis=0 if it is a stack (N, H, W)" if is_one else "axis=0 if so"
            raise ValueError(
                f"{shape}{told} would be {rows} rows of {columns} pixels with {channels} channels"
                f" each; give {kinds}, or, of channels first,"
                f" numpy.moveaxis(image, {image.ndim - 3}, -1)"
            )
    if found == FRAMES and matrices not in (None, shape[0]):
        raise ValueError(f"{matrices} matrices for {shape[0]} frames; give one, or one for each")
    return FRAMES if found == FRAMES else CHANNELS


def matrices_in(given: Any, shape: Size) -> NDArray[Any] | None:
    """Return matrices (N, 3, 3) or (N, 2, 3), if given; `shape`: of the target."""
    if callable(given) or not isinstance(given, list | tuple | np.ndarray):
        return None
    try:
        form = np.shape(given)
    except ValueError:  # of lists of different lengths
        return None
    is_maps = isinstance(given, tuple) and form == (2, *shape)
    is_stack = form[1:] in ((2, 3), (3, 3)) and form[0] > 0 and not is_maps
    return np.asarray(given) if is_stack else None


def stacked(each: list[Warped], image: NDArray[Any]) -> Warped:
    """Stack warped pictures; `image` tells whether they are masked."""
    images = [warped.image for warped in each]
    stack: NDArray[Any] = np.stack([np.ma.getdata(one) for one in images])
    if isinstance(image, np.ma.MaskedArray):
        mask = np.stack([np.ma.getmaskarray(one) for one in images])
        stack = masked(stack, mask, image.fill_value)
    return type(each[0])(stack, np.stack([warped.coverage for warped in each]))


def resized(
    source_shape: tuple[float, float],
    size: AnySize | None = None,
    *,
    height: int | None = None,
    width: int | None = None,
    fit: Fit | None = None,
    box: Sequence[float] | None = None,
) -> tuple[Homography, tuple[int, int]]:
    """Return the map from a picture (height, width) to its new size, as `resize` takes it."""
    if box is not None:
        rows, columns = source_shape
        sides = doubles_of("box", box, "left, top, right and bottom, px").ravel().tolist()
        if len(sides) != 4 or not (
            0 <= sides[0] < sides[2] <= columns and 0 <= sides[1] < sides[3] <= rows
        ):
            raise ValueError(
                f"box {shortly(box)} of a picture of {columns} × {rows} px; give left, top, right"
                " and bottom of a part of it"
            )
        if fit == "pad":
            raise ValueError(
                "pad fills up around whole pictures; leave box out, or cut it out first"
            )
        left, top, right, bottom = sides
        part = bottom - top, right - left
        placed, shape = resized(part, size, height=height, width=width, fit=fit)
        return Homography(placed.matrix @ [[1, 0, -left], [0, 1, -top], [0, 0, 1]]), shape
    if (size is None) == (width is None and height is None):
        raise ValueError("give a size, or a width, a height or both")
    if fit not in (None, "contain", "cover", "stretch", "pad"):
        raise ValueError(f"fit {fit!r}; known: contain, cover, stretch, pad")
    is_share = isinstance(size, float | np.floating)
    if fit is not None and (is_share or (size is None and None in (width, height))):
        raise ValueError("fit needs a width and a height in px, or one number for both")
    usual: Fit = "contain" if size is not None and not (is_share or np.ndim(size)) else "stretch"
    if size is None:
        rows, columns = source_shape
        down = _side("height", height, rows * (width or 0) / columns)
        across = _side("width", width, columns * (height or 0) / rows)
    elif is_share:
        down, across = scaled_shape(source_shape, (float(size), float(size)))  # type: ignore[arg-type]
    else:
        both: Any = size if np.ndim(size) else (size, size)
        down, across = whole_pair(both, "height", "width")
        check_shape((down, across))
    fit = fit or usual
    if fit == "stretch":
        return resizing(source_shape, (down, across)), (down, across)
    factors = down / source_shape[0], across / source_shape[1]
    factor = max(factors) if fit == "cover" else min(factors)
    shown = _rounded(source_shape[0] * factor), _rounded(source_shape[1] * factor)
    if fit == "contain":
        return resizing(source_shape, shown), shown
    matrix = resizing(source_shape, shown).matrix
    matrix[:2, 2] = (across - shown[1]) // 2, (down - shown[0]) // 2  # whole px stay sharp
    return Homography(matrix), (down, across)


def _side(name: str, given: int | None, following: float) -> int:
    """Return a side, px: as given, or in proportion to the other."""
    if given is not None and not (hasattr(given, "__index__") and given > 0):
        raise ValueError(f"{name} {shortly(given)}; give a whole number of px, 1 or more")
    return _rounded(following) if given is None else int(given)


def _rounded(side: float) -> int:
    return max(1, math.floor(side + 0.5))
