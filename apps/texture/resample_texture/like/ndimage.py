"""Transforms of pictures as in `scipy.ndimage`, without aliasing.

`affine_transform`, `map_coordinates`, `rotate`, `shift` and `zoom`, of arrays of two dimensions.
"""

import math
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from resample.types import Doubles
from resample_texture.arguments import REFLECT_101, check_out, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry
from resample_texture.geometry.matrices import homography
from resample_texture.like.common import color_behind, draw, method_of_order
from resample_texture.texels.spans import rounded
from resample_texture.types import Edge, Method

Mode = Literal[
    "constant", "grid-constant", "nearest", "reflect", "grid-mirror", "mirror", "grid-wrap"
]
MODES = {
    "constant": Edge.TRANSPARENT,
    "grid-constant": Edge.TRANSPARENT,
    "nearest": Edge.CLAMP,
    "reflect": Edge.MIRROR,
    "grid-mirror": Edge.MIRROR,
    "mirror": REFLECT_101,
    "grid-wrap": Edge.WRAP,
}
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # (row, column) and (x, y)


def affine_transform(
    input: NDArray[Any],  # noqa: A002
    matrix: ArrayLike,
    offset: float | ArrayLike = 0.0,
    output_shape: tuple[int, int] | None = None,
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: Mode = "constant",
    cval: complex = 0.0,
    prefilter: bool = True,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Warp a picture (H, W): pixel o shows the input at `matrix` @ o + `offset`, rows first.

    Parameters
    ----------
    matrix
        (2, 2), its diagonal (2,), or (2, 3) or (3, 3) with the offset in the last column.
    order
        0 copies texels, 1 interpolates linearly, 2 to 5 are the degrees of a spline.
    interpolation
        Instead of that the name of one that `warp` takes, such as `area-spline`.
    """
    image = _picture(input)
    shape = _shape(output_shape, output, image)
    both = SWAP @ _full(matrix, offset) @ SWAP
    geometry = homography(both, convention="opencv", inverse=True)
    chosen = method_of_order(order, interpolation, method)
    return _drawn(image, geometry, shape, (order, mode, cval, prefilter), output, chosen)


def map_coordinates(
    input: NDArray[Any],  # noqa: A002
    coordinates: ArrayLike,
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: Mode = "constant",
    cval: complex = 0.0,
    prefilter: bool = True,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Warp a picture: pixels show the input at `coordinates` (2, h, w), rows first.

    Parameters
    ----------
    coordinates
        (2, h, w); pixels are areas, whose size follows from their neighbours' coordinates. Or (2,
        N), or of more dimensions: points, none of which is another's neighbour.
    """
    image = _picture(input)
    places = np.asarray(coordinates)
    if places.ndim < 2 or places.shape[0] != 2:
        raise ValueError(f"coordinates have the shape (2, height, width), not {places.shape}")
    chosen = method_of_order(order, interpolation, method)
    if places.ndim != 3:
        values = (order, mode, cval, prefilter)
        return _at_points(image, places, values, output, chosen)
    geometry = BackwardMap.from_opencv(places[1], places[0])
    shape = geometry.x.shape[0], geometry.x.shape[1]
    return _drawn(image, geometry, shape, (order, mode, cval, prefilter), output, chosen)


def zoom(
    input: NDArray[Any],  # noqa: A002
    zoom: float | tuple[float, float],
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: Mode = "constant",
    cval: complex = 0.0,
    prefilter: bool = True,
    *,
    grid_mode: bool = False,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Scale a picture by a factor, or by one down and one across.

    Parameters
    ----------
    grid_mode
        True: the picture's edges, not the centers of its outermost texels, become the result's.
    """
    image = _picture(input)
    factors = np.broadcast_to(np.asarray(zoom, np.float64), 2)
    size = np.array(image.shape)
    shape = [round(int(n) * float(factor)) for n, factor in zip(size, factors, strict=True)]
    if min(shape) < 1:
        raise ValueError(f"zoom {zoom} leaves no pixel of a picture of {image.shape}")
    new = np.array(shape)
    scale = size / new if grid_mode else (size - 1) / np.maximum(new - 1, 1)
    scale[scale == 0.0] = 1.0
    offset = 0.5 * scale - 0.5 if grid_mode else np.zeros(2)
    return affine_transform(
        image, scale, offset, (shape[0], shape[1]), output, order, mode, cval, prefilter,
        interpolation=interpolation, method=method,
    )  # fmt: skip


def shift(
    input: NDArray[Any],  # noqa: A002
    shift: float | tuple[float, float],
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: Mode = "constant",
    cval: complex = 0.0,
    prefilter: bool = True,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Move a picture by a distance, or by one down and one across."""
    moves = -np.broadcast_to(np.asarray(shift, np.float64), 2)
    return affine_transform(
        input, (1.0, 1.0), moves, None, output, order, mode, cval, prefilter,
        interpolation=interpolation, method=method,
    )  # fmt: skip


def rotate(
    input: NDArray[Any],  # noqa: A002
    angle: float,
    axes: tuple[int, int] = (1, 0),
    reshape: bool = True,
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: Mode = "constant",
    cval: complex = 0.0,
    prefilter: bool = True,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Turn a picture counterclockwise by degrees.

    Parameters
    ----------
    reshape
        Make the result large enough for the whole picture.
    """
    image = _picture(input)
    if sorted(axis % 2 for axis in axes) != [0, 1]:
        raise ValueError(f"axes are 0 and 1 of a picture, not {axes}")
    turn = math.radians(angle)
    matrix = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    size = np.array(image.shape)
    bounds = np.abs(matrix) @ size if reshape else size
    shape = np.floor(bounds + 0.5).astype(int) if reshape else size
    offset = 0.5 * (size - 1) - matrix @ (0.5 * (shape - 1))
    return affine_transform(
        image, matrix, offset, (int(shape[0]), int(shape[1])), output, order, mode, cval, prefilter,
        interpolation=interpolation, method=method,
    )  # fmt: skip


def _at_points(
    image: NDArray[Any],
    places: NDArray[Any],
    values: tuple[int, str, complex, bool],
    output: NDArray[Any] | DTypeLike | None,
    method: Method,
) -> NDArray[Any]:
    """Draw points (2, ...) apart from each other, with pixels that show nothing between them."""
    points = places.reshape(2, -1)
    if not points.shape[1]:
        return np.zeros(places.shape[1:], image.dtype)
    side = math.ceil(math.sqrt(points.shape[1]))
    apart = np.full((2, 2 * side + 1, 2 * side + 1), np.nan)
    row, column = np.divmod(np.arange(points.shape[1]), side)
    apart[:, 2 * row + 1, 2 * column + 1] = points
    kind = output.dtype if isinstance(output, np.ndarray) else output
    geometry = BackwardMap.from_opencv(apart[1], apart[0])
    drawn = _drawn(image, geometry, (apart.shape[1], apart.shape[2]), values, kind, method)
    result: NDArray[Any] = drawn[2 * row + 1, 2 * column + 1].reshape(places.shape[1:])
    if not isinstance(output, np.ndarray):
        return result
    check_out(output, result.shape, result)
    output[...] = result
    return output


def _picture(given: NDArray[Any]) -> NDArray[Any]:
    image = given if isinstance(given, np.ma.MaskedArray) else np.asarray(given)
    if image.ndim != 2:
        raise ValueError(f"a picture has the shape (height, width) here, not {image.shape}")
    return image


def _shape(given: Any, output: Any, image: NDArray[Any]) -> tuple[int, int]:
    if given is None:
        given = output.shape if isinstance(output, np.ndarray) else image.shape
    return whole_pair(given, "height", "width")


def _full(matrix: ArrayLike, offset: float | ArrayLike) -> Doubles:
    """Return the matrix (3, 3) from (row, column, 1) of the result to that of the input."""
    given, full = np.asarray(matrix, np.float64), np.eye(3)
    if given.shape in ((2, 3), (3, 3)):
        full[: given.shape[0]] = given
        if not np.array_equal(full[2], [0.0, 0.0, 1.0]):
            raise ValueError(f"an affine matrix ends with 0, 0, 1, not {full[2].tolist()}")
        return full
    if given.shape not in ((2,), (2, 2)):
        raise ValueError(f"a matrix is (2,), (2, 2), (2, 3) or (3, 3), not {given.shape}")
    full[:2, :2] = np.diag(given) if given.ndim == 1 else given
    full[:2, 2] = np.asarray(offset, np.float64)
    return full


def _drawn(
    image: NDArray[Any],
    geometry: Geometry,
    shape: tuple[int, int],
    chosen: tuple[int, str, complex, bool],
    output: NDArray[Any] | DTypeLike | None,
    method: Method,
) -> NDArray[Any]:
    """Draw a picture in the requested type, into the given array if any."""
    order, mode, cval, prefilter = chosen
    if mode not in MODES:
        raise ValueError(f"mode {mode!r}; known: {', '.join(MODES)}")
    if order > 1 and not prefilter:
        raise ValueError("an input of spline coefficients (prefilter=False); give values instead")
    out = output if isinstance(output, np.ndarray) else None
    dtype = image.dtype if output is None else np.dtype(output) if out is None else out.dtype
    if image.dtype.kind == "c" != dtype.kind:
        raise ValueError(f"a picture of {image.dtype} fits no output of {dtype}; give complex64")
    if dtype.kind in "fc" and image.dtype.kind not in "fc":
        image = image.astype(dtype)
    drawing = Drawing(method, geometry, shape, MODES[mode])
    result = draw(image, drawing, color_behind(cval, image, "cval"))
    if result.dtype != dtype:
        whole = dtype.kind in "biu" and result.dtype.kind == "f"
        result = rounded(result.astype(np.float64), dtype) if whole else result.astype(dtype)
    if out is None:
        return result
    check_out(out, result.shape, result)
    out[...] = result
    return out
