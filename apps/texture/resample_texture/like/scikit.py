"""`skimage.transform.warp` without aliasing."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample_texture.arguments import REFLECT_101, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry
from resample_texture.geometry.matrices import homography
from resample_texture.like.common import color_behind, draw, method_of_order
from resample_texture.types import Edge, Method

MODES = {
    "constant": Edge.TRANSPARENT,
    "edge": Edge.CLAMP,
    "symmetric": Edge.MIRROR,
    "reflect": REFLECT_101,
    "wrap": Edge.WRAP,
}


def warp(  # noqa: PLR0913, PLR0917 - as scikit-image has it
    image: NDArray[Any],
    inverse_map: Any,
    map_args: dict[str, Any] | None = None,
    output_shape: tuple[int, int] | None = None,
    order: int | None = None,
    mode: str = "constant",
    cval: float = 0.0,
    clip: bool = True,
    preserve_range: bool = False,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Warp a picture (H, W) or (H, W, C) by an inverse map, antialiased where it shrinks.

    Parameters
    ----------
    image
        Integers become floats of 0 to 1, or −1 to 1, unless `preserve_range`; copied texels
        (`order` 0) keep their type.
    inverse_map
        From the result to the image, pixel centers at integers: a (3, 3) matrix of (x, y, 1); an
        object with such a matrix as `params`; a function of (M, 2) coordinates (column, row); or
        coordinates (2, height, width), rows first.
    map_args
        Further arguments of the function, by name.
    output_shape
        Height and width of the result; by default the image's.
    order
        0 copies texels, 1 interpolates linearly, 2 to 5 are the degrees of a spline, but 3 is cubic
        convolution if `inverse_map` is a matrix; by default 1, and 0 for booleans.
    mode, cval
        Edge mode: `constant`, `edge`, `symmetric`, `reflect` or `wrap`.
    clip
        Clip values to the range of the image and `cval`.
    preserve_range
        Keep integer values instead of scaling them.
    interpolation
        Instead of an order the name of one that `resample_texture.warp` takes, as `area-spline`.
    method
        As `resample_texture.warp` takes it.

    Raises
    ------
    ValueError
        The map has another shape, or an option is unknown.
    """
    image = image if isinstance(image, np.ma.MaskedArray) else np.asarray(image)
    if order is None:
        order = 0 if image.dtype.kind == "b" else 1
    if mode not in MODES:
        raise ValueError(f"mode {mode!r}; known: {', '.join(MODES)}")
    shape = whole_pair(output_shape or image.shape[:2], "height", "width")
    geometry = _geometry(inverse_map, map_args or {}, shape)
    is_map = isinstance(geometry, BackwardMap)
    chosen = method_of_order(order, interpolation, method, splines=is_map)
    given = image if order == 0 else _as_floats(image, preserve_range)
    drawing = Drawing(chosen, geometry, shape, MODES[mode])
    result = draw(given, drawing, color_behind(cval, given, "cval"))
    return _clipped(result, given, cval) if clip and order > 1 else result


def _geometry(given: Any, args: dict[str, Any], shape: tuple[int, int]) -> Geometry:
    """Return the geometry of an inverse map."""
    params = getattr(given, "params", given)
    if np.ndim(params) == 2 and np.shape(params) == (3, 3):
        return homography(params, convention="opencv", inverse=True)
    if callable(given):

        def places(x: NDArray[Any], y: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
            pairs = np.asarray(given(np.stack([x.ravel(), y.ravel()], axis=1), **args))
            if pairs.shape != (x.size, 2):
                raise ValueError(
                    f"the inverse map returned {pairs.shape} for places of {(x.size, 2)};"
                    " it must return as many"
                )
            return pairs[:, 0].reshape(x.shape), pairs[:, 1].reshape(x.shape)

        return BackwardMap.from_function(places, shape, first=0.0)
    rows_columns = np.asarray(given)
    if rows_columns.shape != (2, *shape):
        raise ValueError(
            f"an inverse map is a function, a (3, 3) matrix or places {(2, *shape)}, not"
            f" {rows_columns.shape}"
        )
    return BackwardMap.from_opencv(rows_columns[1], rows_columns[0])


def _as_floats(image: NDArray[Any], preserve_range: bool) -> NDArray[Any]:
    """Convert a picture to floats; integers to 0..1 or −1..1 unless `preserve_range`."""
    if image.dtype.kind == "f":
        return image
    floats = image.astype(np.float64)
    if preserve_range or image.dtype.kind not in "iu":
        return floats
    return floats / np.iinfo(image.dtype).max


def _clipped(result: NDArray[Any], image: NDArray[Any], cval: float) -> NDArray[Any]:
    """Clip values to the range of the image and `cval`."""
    known = np.ma.getdata(image)[~np.ma.getmaskarray(image)]
    known = known[np.isfinite(known)]
    if known.size == 0:
        return result
    bounds = [known.min(), known.max(), *([cval] if np.isfinite(cval) else [])]
    clipped: NDArray[Any] = np.clip(result, min(bounds), max(bounds))
    return clipped
