"""`warpPerspective`, `warpAffine`, `remap`, `resize` and `warpPolar` as in `cv2`, without aliasing.

`from resample_texture.like import opencv as cv2` works: names, order of parameters, flags, kernels,
borders and pixel centers are OpenCV's; OpenCV need not be installed. Where nothing shrinks, results
are those of OpenCV up to rounding; where texels shrink, pixels are means. Arrays of all types and
layouts are accepted, also masked ones. Values that are not numbers have no weight; pixels of which
less than half has a value are not a number, or masked, in the result.
"""

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Doubles
from resample_texture.arguments import REFLECT_101, check_shape, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry, Homography
from resample_texture.geometry.matrices import homography
from resample_texture.like.common import NEAREST, color_behind, draw, into, method_for
from resample_texture.types import Edge, Method

# Values of cv2's constants, so that it need not be imported.
INTER_NEAREST, INTER_AREA, INTER_LINEAR_EXACT, INTER_NEAREST_EXACT = 0, 3, 5, 6
WARP_INVERSE_MAP, WARP_FILL_OUTLIERS, WARP_RELATIVE_MAP = 16, 8, 32
INTERPOLATIONS = {
    INTER_NEAREST: NEAREST,
    1: "bilinear",
    2: "cubic",
    INTER_AREA: "bilinear",
    4: "lanczos:a=4",
}
OF_RESIZE = {**INTERPOLATIONS, INTER_LINEAR_EXACT: "bilinear", INTER_NEAREST_EXACT: NEAREST}
BORDER_CONSTANT, BORDER_TRANSPARENT = 0, 5
WARP_POLAR_LOG = 256
KERNELS = 7  # bits of flags that are `cv2.INTER_*`
BEYOND = 64  # rows around a polar picture that go on at its other end
BORDERS = {
    BORDER_CONSTANT: Edge.TRANSPARENT,
    1: Edge.CLAMP,
    2: Edge.MIRROR,
    3: Edge.WRAP,
    4: REFLECT_101,
    BORDER_TRANSPARENT: Edge.TRANSPARENT,
}
Color = float | tuple[float, ...]


def warp_like_opencv(
    src: NDArray[Any],
    M: ArrayLike,  # noqa: N803
    dsize: tuple[int, int],
    dst: NDArray[Any] | None = None,
    flags: int = 1,
    borderMode: int = BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    *,
    interpolation: str | None = None,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpPerspective` without aliasing: same parameters, same kind of result.

    Parameters
    ----------
    src
        (H, W) or (H, W, C), of any type that `warp` takes; a fourth channel is like the others.
    M
        (3, 3) or (2, 3) from source to target, pixel centers at integers; from target to source
        with `cv2.WARP_INVERSE_MAP` in `flags`.
    dsize
        Width and height of the result.
    dst
        Shows through under `BORDER_TRANSPARENT`. The result is also stored there, if shape and
        type fit.
    flags
        `cv2.INTER_*`: the kernel between texels. Where they shrink, it is averaged over the pixel.
        NEAREST copies the texel at each pixel's center.
    borderMode, borderValue
        `BORDER_CONSTANT`, `_REPLICATE`, `_REFLECT`, `_REFLECT_101`, `_WRAP` or `_TRANSPARENT`; one
        value for all channels or one for each.
    interpolation
        Instead of that flag the name of one that `warp` takes, such as `area-spline`.
    linear_light
        Filter the linear light of uint8 and uint16; OpenCV filters the encoded values.
    method
        As `warp` takes it; by default `hybrid`, or `nearest` for that flag.

    Raises
    ------
    ValueError
        A flag is not one of these, `dst` or `borderValue` does not fit, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp_like_opencv
    >>> image = np.full((48, 64), 200, np.uint8)
    >>> small = warp_like_opencv(image, np.diag([0.25, 0.25, 1]), (20, 12), borderValue=50)
    >>> small.shape, small[6, [8, 18]].tolist()
    ((12, 20), [200, 50])
    """
    kind = flags & ~WARP_INVERSE_MAP & ~WARP_FILL_OUTLIERS  # the latter is always done
    if kind not in INTERPOLATIONS:
        raise ValueError(f"flags {flags}: interpolations are cv2.INTER_NEAREST to INTER_LANCZOS4")
    chosen = method_for(interpolation or INTERPOLATIONS[kind], method)
    shape = _shape(dsize)
    geometry = homography(M, convention="opencv", inverse=bool(flags & WARP_INVERSE_MAP))
    drawing = Drawing(chosen, geometry, shape, _edge(borderMode))
    return _shown(src, drawing, dst, borderMode, borderValue, linear_light=linear_light)


warpPerspective = warp_like_opencv  # noqa: N816 - as cv2 has it


def warpAffine(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    M: ArrayLike,  # noqa: N803
    dsize: tuple[int, int],
    dst: NDArray[Any] | None = None,
    flags: int = 1,
    borderMode: int = BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    *,
    interpolation: str | None = None,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpAffine` without aliasing; parameters as for `warpPerspective`."""
    if np.shape(M) != (2, 3):
        raise ValueError(f"an affine matrix is (2, 3), not {np.shape(M)}; see warpPerspective")
    return warpPerspective(
        src, M, dsize, dst, flags, borderMode, borderValue,
        interpolation=interpolation, linear_light=linear_light, method=method,
    )  # fmt: skip


def remap(
    src: NDArray[Any],
    map1: ArrayLike,
    map2: ArrayLike | None,
    interpolation: int | str,
    dst: NDArray[Any] | None = None,
    borderMode: int = BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.remap` without aliasing.

    Parameters
    ----------
    interpolation
        `cv2.INTER_*`, with `cv2.WARP_RELATIVE_MAP` if maps are relative to each pixel; or the name
        of an interpolation that `warp` takes.
    """
    is_relative = False
    if not isinstance(interpolation, str):
        is_relative = bool(interpolation & WARP_RELATIVE_MAP)
        interpolation &= ~WARP_RELATIVE_MAP
    chosen = method_for(_kernel(interpolation, INTERPOLATIONS, "INTER_LANCZOS4"), method)
    places = BackwardMap.from_opencv(map1, map2)
    height, width = places.x.shape
    if is_relative:
        x, y = np.arange(width), np.arange(height)[:, None]
        places = BackwardMap(places.x + x, places.y + y)
    drawing = Drawing(chosen, places, (height, width), _edge(borderMode))
    return _shown(src, drawing, dst, borderMode, borderValue, linear_light=linear_light)


def resize(
    src: NDArray[Any],
    dsize: tuple[int, int] | None,
    dst: NDArray[Any] | None = None,
    fx: float = 0,
    fy: float = 0,
    interpolation: int | str = 1,
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.resize`, antialiased for every interpolation; NEAREST picks OpenCV's texels.

    Parameters
    ----------
    src, dst, linear_light, method
        As `warpPerspective` takes them.
    dsize
        Width and height of the result; None or zeros: given by `fx` and `fy`.
    fx, fy
        Scale along x and y, if there is no `dsize`.
    interpolation
        `cv2.INTER_*`, AREA being the mean of the block that a pixel covers; or the name of an
        interpolation that `warp` takes.

    Raises
    ------
    ValueError
        There is neither a size nor a scale, or as `warpPerspective` does.
    """
    is_area = interpolation == INTER_AREA
    kernel = NEAREST if is_area else _kernel(interpolation, OF_RESIZE, "INTER_NEAREST_EXACT")
    chosen = method_for(kernel, "hybrid" if is_area and method is None else method)
    height, width = np.shape(src)[:2]
    if dsize is None or tuple(dsize) == (0, 0):
        if not (np.isfinite([fx, fy]).all() and min(fx, fy) > 0):
            raise ValueError(f"neither dsize nor scales: {dsize}, fx {fx}, fy {fy}; give one")
        shape = _shape((round(width * fx), round(height * fy)))
    else:
        shape = _shape(dsize)
        fx, fy = shape[1] / width, shape[0] / height
    geometry: Geometry = Homography(np.diag([fx, fy, 1.0]))
    if interpolation == INTER_NEAREST:  # OpenCV samples at a pixel's corner, not at its center
        x = np.floor(np.arange(shape[1]) * (1.0 / fx)) + 0.5
        y = np.floor(np.arange(shape[0]) * (1.0 / fy)) + 0.5
        geometry = BackwardMap(*np.meshgrid(x, y))
    drawing = Drawing(chosen, geometry, shape, Edge.CLAMP)
    return _shown(src, drawing, dst, BORDER_CONSTANT, 0, linear_light=linear_light)


def _shown(
    src: NDArray[Any],
    drawing: Drawing,
    dst: NDArray[Any] | None,
    border: int,
    value: Color,
    *,
    linear_light: bool,
) -> NDArray[Any]:
    """Draw a picture over its border color, or over `dst`, and store it in `dst`."""
    image = src if isinstance(src, np.ma.MaskedArray) else np.asarray(src)
    if border == BORDER_TRANSPARENT and dst is not None:
        behind = _picture_behind(dst, (*drawing.shape, *image.shape[2:]), image.dtype)
    else:
        behind = color_behind(value if border == BORDER_CONSTANT else 0, image)
    return into(dst, draw(image, drawing, behind, linear_light=linear_light))


def _shape(size: tuple[int, int]) -> tuple[int, int]:
    """Return height and width of a size (width, height)."""
    width, height = whole_pair(size, "width", "height")
    check_shape((height, width))
    return height, width


def _kernel(interpolation: int | str, known: dict[int, str], last: str) -> str:
    """Return the name of a flag's interpolation, or the name given."""
    if isinstance(interpolation, str):
        return interpolation
    if interpolation not in known:
        raise ValueError(f"interpolation {interpolation}: known are cv2.INTER_NEAREST to {last}")
    return known[interpolation]


def _edge(border: int) -> str:
    if border not in BORDERS:
        raise ValueError(
            f"borderMode {border}: CONSTANT, REPLICATE, REFLECT, WRAP, REFLECT_101 and TRANSPARENT"
            " are known"
        )
    return BORDERS[border]


def _picture_behind(dst: NDArray[Any], full: tuple[int, ...], dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return `dst` as a background (h, w, C), checked."""
    behind = np.asarray(dst)
    if behind.shape != full or behind.dtype != dtype:
        raise ValueError(
            f"dst is {behind.dtype} of {behind.shape}; the result is {dtype} of {full}"
        )
    return behind.reshape(*full[:2], -1)


def warpPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    dsize: tuple[int, int],
    center: tuple[float, float],
    maxRadius: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpPolar` without aliasing: angles by rows, radii by columns, or back.

    Parameters
    ----------
    dsize
        Width and height of the result; if not above 0, as OpenCV chooses them.
    center
        x and y of the pole, pixel centers at integers.
    maxRadius
        Radius at the end of a row, px; the result's width is that many px, or its logarithm.
    flags
        `cv2.INTER_*`, with `cv2.WARP_POLAR_LOG`, `cv2.WARP_INVERSE_MAP` (a polar picture becomes
        one of x and y) and `cv2.WARP_FILL_OUTLIERS` (pixels without texels are black).

    Raises
    ------
    ValueError
        The radius is not above 0, of logarithms 1, or as `remap` does.
    """
    least = 1.0 if flags & WARP_POLAR_LOG else 0.0
    if not least < maxRadius < math.inf:
        raise ValueError(f"maxRadius is above {least:g} px, not {maxRadius}")
    image = src if isinstance(src, np.ma.MaskedArray) else np.asarray(src)
    is_log = bool(flags & WARP_POLAR_LOG)
    chosen: dict[str, Any] = {"linear_light": linear_light, "method": method}
    border = BORDER_CONSTANT if flags & WARP_FILL_OUTLIERS else BORDER_TRANSPARENT
    if flags & WARP_INVERSE_MAP:
        width, height = _size(dsize, image.shape[1], image.shape[0])
        y, x = np.mgrid[:height, :width] - np.array([center[1], center[0]])[:, None, None]
        angle = np.arctan2(y, x) % (2.0 * math.pi)
        row = angle * (image.shape[0] / (2.0 * math.pi))
        column = _column(np.hypot(x, y), image.shape[1], maxRadius, is_log)
        around = min(BEYOND, image.shape[0])
        image = image[np.arange(-around, image.shape[0] + around) % image.shape[0]]
        return remap(image, column, row + around, flags & KERNELS, dst, border, **chosen)
    across = round(maxRadius)
    width, height = _size(dsize, across, round(across * math.pi))
    radius = _radius(np.arange(width), width, maxRadius, is_log)
    angle = np.arange(height)[:, None] * (2.0 * math.pi / height)
    x, y = radius * np.cos(angle) + center[0], radius * np.sin(angle) + center[1]
    return remap(image, x, y, flags & KERNELS, dst, border, **chosen)


def linearPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    maxRadius: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    **chosen: Any,
) -> NDArray[Any]:
    """`cv2.linearPolar`: `warpPolar` to the picture's own size."""
    height, width = np.shape(src)[:2]
    return warpPolar(
        src, (width, height), center, maxRadius, flags & ~WARP_POLAR_LOG, dst, **chosen
    )


def logPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    M: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
    **chosen: Any,
) -> NDArray[Any]:
    """`cv2.logPolar`: `warpPolar` by logarithms to the picture's own size; `M` px per unit."""
    height, width = np.shape(src)[:2]
    most = math.exp(width / M) if M > 0 else 0.0
    return warpPolar(src, (width, height), center, most, flags | WARP_POLAR_LOG, dst, **chosen)


def _size(dsize: tuple[int, int], width: int, height: int) -> tuple[int, int]:
    """Width and height of a result, of which those not above 0 are by default."""
    across, down = whole_pair(dsize, "width", "height")
    if across > 0 and down <= 0:
        return across, round(across * math.pi)
    return (width, height) if across <= 0 or down <= 0 else (across, down)


def _radius(column: Any, width: int, most: float, is_log: bool) -> Doubles:
    """Radius of columns."""
    if not is_log:
        return np.asarray(column * (most / width))
    return np.asarray(np.exp(column * (math.log(most) / width)) - 1.0)


def _column(radius: Doubles, width: int, most: float, is_log: bool) -> Doubles:
    """Column of radii."""
    if not is_log:
        return np.asarray(radius * (width / most))
    return np.asarray(np.log(radius + 1.0) * (width / math.log(most)))
