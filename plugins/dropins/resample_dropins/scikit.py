"""`skimage.transform` without aliasing: `import resample_dropins.scikit as transform`.

`warp`, `resize`, `rescale` and `rotate` are own code; other names are scikit-image's, if installed.
"""

import importlib
import math
from collections.abc import Sequence
from functools import partial
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from resample_dropins.common import color_behind, draw, method_of_order
from resample_texture.arguments import REFLECT_101, check_shape, places_of_points, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry
from resample_texture.geometry.matrices import homography, resizing
from resample_texture.types import Edge, Method

Mode = Literal["constant", "edge", "symmetric", "reflect", "wrap"]
MODES = {
    "constant": Edge.TRANSPARENT,
    "edge": Edge.CLAMP,
    "symmetric": Edge.MIRROR,
    "reflect": REFLECT_101,
    "wrap": Edge.WRAP,
}


def warp(
    image: NDArray[Any],
    inverse_map: Any,
    map_args: dict[str, Any] | None = None,
    output_shape: tuple[int, int] | None = None,
    order: int | None = None,
    mode: Mode = "constant",
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
    image = _picture(image)
    order = _order(order, image)
    shape = whole_pair(output_shape or image.shape[:2], "height", "width")
    params = getattr(inverse_map, "params", inverse_map)
    geometry: Geometry
    if np.ndim(params) == 2 and np.shape(params) == (3, 3):
        geometry = homography(params, convention="opencv", inverse=True)
    elif callable(inverse_map):
        places = places_of_points(partial(inverse_map, **(map_args or {})), is_forward=True)
        geometry = BackwardMap.from_function(places, shape, first=0.0)
    else:
        given = np.asarray(inverse_map)
        if given.shape != (2, *shape):
            raise ValueError(
                f"an inverse map is a function, a (3, 3) matrix or places {(2, *shape)}, not"
                f" {given.shape}"
            )
        geometry = BackwardMap.from_opencv(given[1], given[0])
    is_map = isinstance(geometry, BackwardMap)
    chosen = method_of_order(order, interpolation, method, splines=is_map)
    return _drawn(
        image, Drawing(chosen, geometry, shape, _edge(mode)), order, cval, clip, preserve_range
    )


def resize(
    image: NDArray[Any],
    output_shape: Sequence[int],
    order: int | None = None,
    mode: Mode = "reflect",
    cval: float = 0.0,
    clip: bool = True,
    preserve_range: bool = False,
    anti_aliasing: bool | None = None,
    anti_aliasing_sigma: Any = None,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Resize a picture (H, W) or (H, W, C), antialiased where it shrinks.

    Parameters
    ----------
    output_shape
        (height, width), or (height, width, C) with the picture's channels.
    order
        0 copies texels, 1 interpolates linearly, 2 to 5 are the degrees of a spline; by default 1,
        and 0 for booleans.
    anti_aliasing, anti_aliasing_sigma
        Pixels are averaged over what they cover: False is refused unless texels are copied, and so
        is the sigma of another filter.
    image, mode, cval, clip, preserve_range, interpolation, method
        As `warp` takes them.

    Raises
    ------
    ValueError
        The shape has other channels, or an option is unknown.
    """
    image = _picture(image)
    order = _order(order, image)
    sizes = tuple(output_shape)
    if len(sizes) == 3 and sizes[2:] != image.shape[2:]:
        raise ValueError(f"output_shape {sizes} of a picture of {image.shape}; keep its channels")
    if anti_aliasing_sigma is not None or (anti_aliasing is False and order > 0):
        raise ValueError(
            "pixels are averaged over what they cover: leave out anti_aliasing=False and sigma"
        )
    shape = whole_pair(sizes[:2] if len(sizes) == 3 else sizes, "height", "width")
    check_shape(shape)
    geometry = resizing((image.shape[0], image.shape[1]), shape)
    chosen = method_of_order(order, interpolation, method)
    return _drawn(
        image, Drawing(chosen, geometry, shape, _edge(mode)), order, cval, clip, preserve_range
    )


def rescale(
    image: NDArray[Any],
    scale: float | Sequence[float],
    order: int | None = None,
    mode: Mode = "reflect",
    cval: float = 0.0,
    clip: bool = True,
    preserve_range: bool = False,
    anti_aliasing: bool | None = None,
    anti_aliasing_sigma: Any = None,
    *,
    channel_axis: int | None = None,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Resize a picture by a factor, or by one down and one across.

    Parameters
    ----------
    channel_axis
        −1 or 2 for pictures with channels.
    image, order, mode, cval, clip, preserve_range, interpolation, method
        As `warp` takes them.
    anti_aliasing, anti_aliasing_sigma
        As `resize` takes them.
    """
    image = _picture(image)
    if image.ndim == 3 and channel_axis not in (-1, 2):
        raise ValueError(f"a picture of {image.shape} has channels; give channel_axis=-1")
    factors = np.broadcast_to(np.asarray(scale, np.float64), 2)
    shape = np.maximum(np.round(factors * image.shape[:2]), 1).astype(int).tolist()
    return resize(
        image, shape, order, mode, cval, clip, preserve_range, anti_aliasing, anti_aliasing_sigma,
        interpolation=interpolation, method=method,
    )  # fmt: skip


def rotate(
    image: NDArray[Any],
    angle: float,
    resize: bool = False,
    center: Sequence[float] | None = None,
    order: int | None = None,
    mode: Mode = "constant",
    cval: float = 0.0,
    clip: bool = True,
    preserve_range: bool = False,
    *,
    interpolation: str | None = None,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """Turn a picture counterclockwise by degrees.

    Parameters
    ----------
    resize
        Make the result large enough for the whole picture.
    center
        What stays in place: (column, row); by default the middle.
    image, order, mode, cval, clip, preserve_range, interpolation, method
        As `warp` takes them.
    """
    image = _picture(image)
    rows, columns = image.shape[:2]
    middle = np.array([columns - 1, rows - 1]) / 2 if center is None else np.asarray(center, float)
    turn = math.radians(angle)
    forward = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    inverse, first, shape = np.eye(3), np.zeros(2), (rows, columns)
    if resize:
        ends = np.array([[0, columns - 1, columns - 1, 0], [0, 0, rows - 1, rows - 1]])
        corners = forward @ (ends - middle[:, None]) + middle[:, None]
        first = corners.min(axis=1)
        across, down = np.around(corners.max(axis=1) - first + 1).astype(int)
        shape = int(down), int(across)
    inverse[:2, :2] = forward.T
    inverse[:2, 2] = middle + forward.T @ (first - middle)
    return warp(
        image, inverse, None, shape, order, mode, cval, clip, preserve_range,
        interpolation=interpolation, method=method,
    )  # fmt: skip


def _picture(image: Any) -> NDArray[Any]:
    given = image if isinstance(image, np.ma.MaskedArray) else np.asarray(image)
    if given.ndim not in (2, 3):
        raise ValueError(f"a picture is (height, width) or (height, width, C), not {given.shape}")
    return given


def _edge(mode: str) -> str:
    if mode not in MODES:
        raise ValueError(f"mode {mode!r}; known: {', '.join(MODES)}")
    return MODES[mode]


def _order(order: int | None, image: NDArray[Any]) -> int:
    """Return the interpolation's order, by default that of the picture's type."""
    return order if order is not None else 0 if image.dtype.kind == "b" else 1


def _drawn(
    image: NDArray[Any], drawing: Drawing, order: int, cval: float, clip: bool, preserve_range: bool
) -> NDArray[Any]:
    """Draw a picture; the options are those of `warp`."""
    given = image
    if order > 0 and image.dtype.kind != "f":
        given = image.astype(np.float64)
        if image.dtype.kind in "iu" and not preserve_range:
            given = given / np.iinfo(image.dtype).max
    result = draw(given, drawing._replace(behind=color_behind(cval, given, "cval")))
    if not clip or order <= 1:
        return result
    known = np.ma.getdata(given)[~np.ma.getmaskarray(given)]
    known = known[np.isfinite(known)]
    if known.size == 0:
        return result
    bounds = [known.min(), known.max(), *([cval] if np.isfinite(cval) else [])]
    clipped: NDArray[Any] = np.clip(result, min(bounds), max(bounds))
    return clipped


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(name)
    try:
        transform = importlib.import_module("skimage.transform")
    except ImportError:
        raise AttributeError(
            f"{name} is scikit-image's own; install that: pip install scikit-image"
        ) from None
    return getattr(transform, name)


__all__ = ["rescale", "resize", "rotate", "warp"]
