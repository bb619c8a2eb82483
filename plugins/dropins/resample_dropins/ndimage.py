"""`scipy.ndimage` without aliasing: `import resample_dropins.ndimage as ndimage`.

All names are SciPy's own, but for the calls that may shrink a picture: `affine_transform`,
`map_coordinates`, `zoom`, `shift` and `rotate`. These have SciPy's arguments, and where no pixel
shrinks they return SciPy's result, as for arrays of other than two dimensions, points, copied
texels (`order` 0) and coefficients (`prefilter=False`). A picture that shrinks, or has gaps (a
mask, values that are not numbers), is drawn by own code.
"""

import math
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray
from scipy import ndimage

from resample.types import Doubles
from resample_dropins import common
from resample_texture.arguments import REFLECT_101, check_out, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry
from resample_texture.geometry.matrices import homography
from resample_texture.texels.encoding import rounded
from resample_texture.types import Edge, Method

Mode = Literal[
    "constant", "grid-constant", "nearest", "reflect", "grid-mirror", "mirror", "grid-wrap", "wrap"
]
MODES = {
    "constant": Edge.TRANSPARENT,
    "grid-constant": Edge.TRANSPARENT,
    "nearest": Edge.CLAMP,
    "reflect": Edge.MIRROR,
    "grid-mirror": Edge.MIRROR,
    "mirror": REFLECT_101,
    "grid-wrap": Edge.WRAP,
    "wrap": Edge.WRAP,  # of a picture without its last texels, which are its first ones
}
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # (row, column) and (x, y)


class Values(NamedTuple):
    """Arguments common to SciPy's calls, and the two that SciPy lacks."""

    output: Any
    order: int
    mode: str
    cval: complex
    prefilter: bool
    interpolation: str | None
    method: str | Method | None

    def dtype_of(self, image: NDArray[Any]) -> np.dtype[Any]:
        """Return the type of a picture's result."""
        given = image if self.output is None else self.output
        return np.dtype(given.dtype if isinstance(given, np.ndarray) else given)

    def are_scipy_s(self, image: NDArray[Any], long: float = 1.0) -> bool:
        """Whether SciPy draws a picture with pixels of a squared length, texels²."""
        if self.order not in common.ORDERS:
            raise ValueError(f"order {self.order!r}; known: 0 to 5")
        if self.mode not in MODES:
            raise ValueError(f"mode {self.mode!r}; known: {', '.join(MODES)}")
        is_named = self.interpolation is not None or self.method is not None
        if is_named or isinstance(image, np.ma.MaskedArray):
            return False
        if image.ndim != 2 or self.order == 0 or not self.prefilter:
            return True
        if (self.dtype_of(image).kind == "c") != (image.dtype.kind == "c"):
            return False
        return long <= _limit(self.order) and not common.has_gaps(image)


def affine_transform(
    input: NDArray[Any],  # noqa: A002
    matrix: ArrayLike,
    offset: float | ArrayLike = 0.0,
    output_shape: tuple[int, ...] | None = None,
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
    image = np.asanyarray(input)
    values = Values(output, order, mode, cval, prefilter, interpolation, method)
    # From (row, column, 1) of the result to that of the input.
    given, full = np.asarray(matrix, np.float64), np.eye(3)
    if image.ndim == 2 and given.shape in ((2, 3), (3, 3)):
        full[: given.shape[0]] = given
        if not np.array_equal(full[2], [0.0, 0.0, 1.0]):
            raise ValueError(f"an affine matrix ends with 0, 0, 1, not {full[2].tolist()}")
    elif image.ndim == 2:
        if given.shape not in ((2,), (2, 2)):
            raise ValueError(f"a matrix is (2,), (2, 2), (2, 3) or (3, 3), not {given.shape}")
        full[:2, :2] = np.diag(given) if given.ndim == 1 else given
        full[:2, 2] = np.asarray(offset, np.float64)
    if values.are_scipy_s(image, float(np.linalg.norm(full[:2, :2], 2)) ** 2):
        made = ndimage.affine_transform(image, matrix, offset, output_shape, *values[:5])
        return np.asarray(made)
    if output_shape is None:
        output_shape = output.shape if isinstance(output, np.ndarray) else image.shape
    return _affine(image, full, whole_pair(output_shape, "height", "width"), values)


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
        (2, h, w); pixels are areas, with sizes from their neighbours' coordinates. Or (2,
        N), or of more dimensions: points, none of which is another's neighbour.
    """
    image, places = np.asanyarray(input), np.asarray(coordinates)
    values = Values(output, order, mode, cval, prefilter, interpolation, method)
    shrinks = None
    if image.ndim == 2 and (places.ndim < 2 or places.shape[0] != 2):
        raise ValueError(f"coordinates have the shape (2, height, width), not {places.shape}")
    if image.ndim == 2 and places.ndim == 3 and places.size:
        shape = places.shape[1], places.shape[2]
        shrinks = common.by_nodes(
            lambda step: (places[1, ::step, ::step], places[0, ::step, ::step]),
            shape,
            _limit(order),
        )
    if values.are_scipy_s(image, 0.0 if shrinks is None else math.inf):
        return np.asarray(ndimage.map_coordinates(image, places, *values[:5]))
    if places.ndim == 3:
        return _drawn(image, BackwardMap.from_opencv(places[1], places[0]), shape, values)
    # Draw points (2, ...) apart from each other, with pixels that show nothing between them.
    points = places.reshape(2, -1)
    side = max(math.ceil(math.sqrt(points.shape[1])), 1)
    apart = np.full((2, 2 * side + 1, 2 * side + 1), np.nan)
    row, column = np.divmod(np.arange(points.shape[1]), side)
    apart[:, 2 * row + 1, 2 * column + 1] = points
    output, geometry = values.output, BackwardMap.from_opencv(apart[1], apart[0])
    shape, plain = (apart.shape[1], apart.shape[2]), values._replace(output=values.dtype_of(image))
    drawn = _drawn(image, geometry, shape, plain)
    return _stored(drawn[2 * row + 1, 2 * column + 1].reshape(places.shape[1:]), output)


def zoom(
    input: NDArray[Any],  # noqa: A002
    zoom: float | tuple[float, ...],
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
    zoom
        Planes (H, W, C) are scaled one by one if a third factor is 1.
    grid_mode
        True: the picture's edges, not the centers of its outermost texels, become the result's.
    """
    image = np.asanyarray(input)
    values = Values(output, order, mode, cval, prefilter, interpolation, method)
    factor, size = np.broadcast_to(np.asarray(zoom, np.float64), image.ndim), np.array(image.shape)
    new = np.array([round(float(one)) for one in size * factor])
    if new.min(initial=1) < 1:
        raise ValueError(f"zoom {zoom} leaves no pixel of a picture of {image.shape}")
    scale = size / new if grid_mode else (size - 1) / np.maximum(new - 1, 1)
    are_planes = image.ndim == 3 and factor[2] == 1.0
    seen = image.reshape(len(image), -1) if are_planes else image
    if values.are_scipy_s(seen, scale.max(initial=0.0) ** 2):
        return np.asarray(ndimage.zoom(image, zoom, *values[:5], grid_mode=grid_mode))
    scale = np.where(scale == 0.0, 1.0, scale)[:2]
    full = np.diag([*scale, 1.0])
    full[:2, 2] = 0.5 * scale - 0.5 if grid_mode else 0.0
    return _affine(image, full, (int(new[0]), int(new[1])), values)


def shift(
    input: NDArray[Any],  # noqa: A002
    shift: float | tuple[float, ...],
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
    image = np.asanyarray(input)
    values = Values(output, order, mode, cval, prefilter, interpolation, method)
    if values.are_scipy_s(image):
        return np.asarray(ndimage.shift(image, shift, *values[:5]))
    full = np.eye(3)
    full[:2, 2] = -np.asarray(shift, np.float64)
    return _affine(image, full, (image.shape[0], image.shape[1]), values)


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
    image = np.asanyarray(input)
    values = Values(output, order, mode, cval, prefilter, interpolation, method)
    if values.are_scipy_s(image):
        return np.asarray(ndimage.rotate(image, angle, axes, reshape, *values[:5]))
    if sorted(axis % 2 for axis in axes) != [0, 1]:
        raise ValueError(f"axes are 0 and 1 of a picture, not {axes}")
    turn, size, full = math.radians(angle), np.array(image.shape), np.eye(3)
    full[:2, :2] = [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
    shape = np.floor(np.abs(full[:2, :2]) @ size + 0.5).astype(int) if reshape else size
    full[:2, 2] = 0.5 * (size - 1) - full[:2, :2] @ (0.5 * (shape - 1))
    return _affine(image, full, (int(shape[0]), int(shape[1])), values)


def _limit(order: int) -> float:
    """Return the squared length up to which a pixel does not shrink, texels²."""
    return common.LINEAR if order == 1 else common.SHARP


def _affine(
    image: NDArray[Any], full: Doubles, shape: tuple[int, int], values: Values
) -> NDArray[Any]:
    """Draw a picture by own code, by a matrix (3, 3) of (row, column, 1)."""
    geometry = homography(SWAP @ full @ SWAP, convention="opencv", inverse=True)
    return _drawn(image, geometry, shape, values)


def _drawn(
    image: NDArray[Any], geometry: Geometry, shape: tuple[int, int], values: Values
) -> NDArray[Any]:
    """Draw a picture in the requested type, into the given array if any."""
    output, order, mode, cval, prefilter, interpolation, method = values
    if image.ndim < 2 or image.ndim > 3:
        raise ValueError(f"a picture has the shape (height, width) here, not {image.shape}")
    if order > 1 and not prefilter:
        raise ValueError("an input of spline coefficients (prefilter=False); give values instead")
    dtype = values.dtype_of(image)
    if image.dtype.kind == "c" != dtype.kind:
        raise ValueError(f"a picture of {image.dtype} fits no output of {dtype}; give complex64")
    if dtype.kind in "fc" and image.dtype.kind not in "fc":
        image = image.astype(dtype)
    if mode == "wrap":
        image = image[: max(len(image) - 1, 1), : max(image.shape[1] - 1, 1)]
    chosen, behind = (
        common.method_of_order(order, interpolation, method),
        common.color_behind(cval, image, "cval"),
    )
    result = common.draw(image, Drawing(chosen, geometry, shape, MODES[mode], behind=behind))
    if result.dtype != dtype:
        whole = dtype.kind in "biu" and result.dtype.kind == "f"
        result = rounded(result.astype(np.float64), dtype) if whole else result.astype(dtype)
    return _stored(result, output)


def _stored(result: NDArray[Any], output: Any) -> NDArray[Any]:
    """Put a result into the array given for it, if any."""
    if not isinstance(output, np.ndarray):
        return result
    check_out(output, result.shape, result)
    output[...] = result
    return output


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    return getattr(ndimage, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *dir(ndimage)})


__all__ = list(ndimage.__all__)
