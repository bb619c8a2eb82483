"""`affine_transform` and `map_coordinates` as in `scipy.ndimage`, without aliasing."""

from typing import Any

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


def affine_transform(  # noqa: PLR0913, PLR0917 - as scipy.ndimage has it
    input: NDArray[Any],  # noqa: A002
    matrix: ArrayLike,
    offset: float | ArrayLike = 0.0,
    output_shape: tuple[int, int] | None = None,
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: str = "constant",
    cval: float = 0.0,
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


def map_coordinates(  # noqa: PLR0913 - as scipy.ndimage has it
    input: NDArray[Any],  # noqa: A002
    coordinates: ArrayLike,
    output: NDArray[Any] | DTypeLike | None = None,
    order: int = 3,
    mode: str = "constant",
    cval: float = 0.0,
    prefilter: bool = True,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Warp a picture: pixels show the input at `coordinates` (2, h, w), rows first.

    Parameters
    ----------
    coordinates
        (2, h, w); pixels are areas, whose size follows from their neighbours' coordinates.
    """
    image = _picture(input)
    places = np.asarray(coordinates)
    if places.ndim != 3 or places.shape[0] != 2:
        raise ValueError(f"coordinates have the shape (2, height, width), not {places.shape}")
    geometry = BackwardMap.from_opencv(places[1], places[0])
    shape = geometry.x.shape[0], geometry.x.shape[1]
    chosen = method_of_order(order, interpolation, method)
    return _drawn(image, geometry, shape, (order, mode, cval, prefilter), output, chosen)


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
    chosen: tuple[int, str, float, bool],
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
    if dtype.kind == "f" and image.dtype.kind != "f":
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
