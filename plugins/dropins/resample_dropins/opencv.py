"""`cv2` without aliasing: `import resample_dropins.opencv as cv2`.

All names are OpenCV's own, but for the calls that may shrink a picture: `warpPerspective`,
`warpAffine`, `remap`, `resize`, `warpPolar`, `linearPolar` and `logPolar`. These have OpenCV's
arguments, and where no pixel shrinks they return OpenCV's result, bit by bit. In tiles where pixels
shrink, these are means over what they cover. Own code also draws what OpenCV does not take: masked
arrays, values that are not numbers, which have no weight, and further types and numbers of
channels. Pixels with a value in less than half of their area are NaN, or masked.
"""

import functools
import math
from collections.abc import Callable
from typing import Any, NamedTuple, ParamSpec

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample_dropins import common
from resample_texture.arguments import REFLECT_101, whole_pair
from resample_texture.drawing import Drawing
from resample_texture.geometry.mappings import BackwardMap, Geometry, Homography, from_fixed_point
from resample_texture.geometry.matrices import homography
from resample_texture.types import Edge, Method

INTERPOLATIONS = {
    cv2.INTER_NEAREST: common.NEAREST,
    cv2.INTER_LINEAR: "bilinear",
    cv2.INTER_CUBIC: "cubic",
    cv2.INTER_AREA: "bilinear",
    cv2.INTER_LANCZOS4: "lanczos:a=4",
}
OF_RESIZE = {
    **INTERPOLATIONS,
    cv2.INTER_LINEAR_EXACT: "bilinear",
    cv2.INTER_NEAREST_EXACT: common.NEAREST,
}
LIMITS = {
    common.NEAREST: math.inf,
    "bilinear": common.LINEAR,
    "cubic": common.SHARP,
    "lanczos:a=4": common.SHARP,
}
BORDERS = {
    cv2.BORDER_CONSTANT: Edge.TRANSPARENT,
    cv2.BORDER_REPLICATE: Edge.CLAMP,
    cv2.BORDER_REFLECT: Edge.MIRROR,
    cv2.BORDER_WRAP: Edge.WRAP,
    cv2.BORDER_REFLECT_101: REFLECT_101,
    cv2.BORDER_TRANSPARENT: Edge.TRANSPARENT,
}
# Types that OpenCV takes and returns; others it refuses, or returns as int32. Of float64 its warps
# round positions to 1/32 px, and cubic ones by maps are wrong at some places.
WARPED = {np.dtype(name) for name in ("uint8", "uint16", "int16", "float32")}
RESIZED = {*WARPED, np.dtype("float64")}
BEYOND = 64  # rows around a polar picture that go on at its other end
OPENCV: Any = cv2  # its stubs accept less than it does
Color = float | tuple[float, ...]
P = ParamSpec("P")


class RefusedError(cv2.error, ValueError):
    """What neither OpenCV nor this library takes."""


class Call(NamedTuple):
    """What a call draws by own code, and when it does."""

    src: Any
    shape: tuple[int, int]  # of the target: height, width
    dst: Any
    kernel: str  # between texels
    most: float | None  # squared length of a pixel that does not shrink, texels²; None: all is own
    border: int
    value: Color = 0
    linear_light: bool = False
    method: str | Method | None = None
    around: int = 0  # rows of the source that go on at its other end
    taken: set[np.dtype[Any]] = WARPED  # types that OpenCV draws


def _refusing(call: Callable[P, NDArray[Any]]) -> Callable[P, NDArray[Any]]:
    """Let a call refuse by an error that is OpenCV's, too."""

    @functools.wraps(call)
    def made(*args: P.args, **named: P.kwargs) -> NDArray[Any]:
        try:
            return call(*args, **named)
        except ValueError as error:
            raise RefusedError(str(error)) from None

    return made


@_refusing
def warp_like_opencv(
    src: NDArray[Any],
    M: ArrayLike,  # noqa: N803
    dsize: tuple[int, int] | None,
    dst: NDArray[Any] | None = None,
    flags: int = cv2.INTER_LINEAR,
    borderMode: int = cv2.BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    hint: int = 0,
    *,
    interpolation: str | None = None,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpPerspective` without aliasing: same arguments, and same result where none would be.

    Parameters
    ----------
    src
        (H, W) or (H, W, C), of any type that `warp` takes; a fourth channel is like the others.
    M
        (3, 3) or (2, 3) from source to target, pixel centers at integers; from target to source
        with `cv2.WARP_INVERSE_MAP` in `flags`.
    dsize
        Width and height of the result; None or zeros: those of `src`.
    dst
        Shows through under `BORDER_TRANSPARENT`. The result is also stored there, if shape and
        type fit.
    flags
        `cv2.INTER_*`: the kernel between texels. Where they shrink, it is averaged over the pixel.
        NEAREST copies the texel at each pixel's center.
    borderMode, borderValue
        `BORDER_CONSTANT`, `_REPLICATE`, `_REFLECT`, `_REFLECT_101`, `_WRAP` or `_TRANSPARENT`; one
        value for each channel, the first four 0 if not given.
    hint
        `cv2.ALGO_HINT_*`, for OpenCV.
    interpolation
        Instead of that flag the name of one that `warp` takes, such as `area-spline`.
    linear_light
        Filter the linear light of uint8 and uint16; OpenCV filters the encoded values.
    method
        As `warp` takes it; by default `hybrid`, or `nearest` for that flag.

    Raises
    ------
    ValueError, cv2.error
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
    kernel, most = _kernel(
        interpolation or flags & cv2.INTER_MAX, INTERPOLATIONS, method, linear_light
    )
    matrix = M if isinstance(M, np.ndarray) else np.asarray(M, np.float64)
    shape, is_inverse = _size(dsize, src), bool(flags & cv2.WARP_INVERSE_MAP)
    call = Call(src, shape, dst, kernel, most, borderMode, borderValue, linear_light, method)

    def tiles(most: float) -> common.Tiles | None:
        back = _back(matrix, is_inverse, src.shape)
        return None if back is None else common.by_matrix(back, shape, most)

    def theirs(dst: Any) -> Any:
        draw = OPENCV.warpPerspective if matrix.shape == (3, 3) else OPENCV.warpAffine
        return draw(src, matrix, dsize, dst, flags, borderMode, borderValue, *[hint][: hint > 0])

    def geometry() -> Geometry:
        return homography(matrix, convention="opencv", inverse=is_inverse)

    return _drawn(call, tiles, theirs, geometry)


warpPerspective = warp_like_opencv  # noqa: N816 - as cv2 has it


def warpAffine(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    M: ArrayLike,  # noqa: N803
    dsize: tuple[int, int] | None,
    dst: NDArray[Any] | None = None,
    flags: int = cv2.INTER_LINEAR,
    borderMode: int = cv2.BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    hint: int = 0,
    *,
    interpolation: str | None = None,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.warpAffine` without aliasing; parameters as for `warpPerspective`."""
    if np.shape(M) != (2, 3):
        raise RefusedError(f"an affine matrix is (2, 3), not {np.shape(M)}; see warpPerspective")
    return warpPerspective(
        src, M, dsize, dst, flags, borderMode, borderValue, hint,
        interpolation=interpolation, linear_light=linear_light, method=method,
    )  # fmt: skip


@_refusing
def remap(
    src: NDArray[Any],
    map1: ArrayLike,
    map2: ArrayLike | None,
    interpolation: int | str,
    dst: NDArray[Any] | None = None,
    borderMode: int = cv2.BORDER_CONSTANT,  # noqa: N803
    borderValue: Color = 0,  # noqa: N803
    hint: int = 0,
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.remap` without aliasing; pixels' sizes are looked up at every eighth of them.

    Parameters
    ----------
    interpolation
        `cv2.INTER_*`, with `cv2.WARP_RELATIVE_MAP` if maps are relative to each pixel; or the name
        of an interpolation that `warp` takes.
    src, dst, borderMode, borderValue, hint, linear_light, method
        As `warpPerspective` takes them.
    """
    kind, is_relative = interpolation, False
    if not isinstance(interpolation, str):
        is_relative = bool(interpolation & cv2.WARP_RELATIVE_MAP)
        kind = interpolation & ~cv2.WARP_RELATIVE_MAP
    kernel, most = _kernel(kind, INTERPOLATIONS, method, linear_light)
    first = np.asarray(map1)
    second = None if map2 is None or np.size(map2) == 0 else np.asarray(map2)
    shape = first.shape[0], first.shape[1]
    call = Call(src, shape, dst, kernel, most, borderMode, borderValue, linear_light, method)

    def places(step: int) -> common.Places:
        x, y = first[::step, ::step], None if second is None else second[::step, ::step]
        if y is None or x.ndim == 3:
            both = x if y is None else from_fixed_point(x, y)
            x, y = both[..., 0], both[..., 1]
        if is_relative:
            x = x + np.arange(0, shape[1], step)
            y = y + np.arange(0, shape[0], step)[:, None]
        return x, y

    given = borderMode, borderValue, *[hint][: hint > 0]
    return _drawn_by_map(
        call, places, lambda dst: OPENCV.remap(src, map1, map2, interpolation, dst, *given)
    )


@_refusing
def resize(
    src: NDArray[Any],
    dsize: tuple[int, int] | None,
    dst: NDArray[Any] | None = None,
    fx: float = 0,
    fy: float = 0,
    interpolation: int | str = cv2.INTER_LINEAR,
    *,
    linear_light: bool = False,
    method: str | Method | None = None,
) -> NDArray[Any]:
    """`cv2.resize`, antialiased for every interpolation but NEAREST.

    Parameters
    ----------
    src, dst, linear_light, method
        As `warpPerspective` takes them.
    dsize
        Width and height of the result; None or zeros: given by `fx` and `fy`.
    fx, fy
        Scale along x and y, without `dsize`.
    interpolation
        `cv2.INTER_*`: AREA, which is the mean of the block that a pixel covers, and NEAREST are
        OpenCV's own; or the name of an interpolation that `warp` takes.

    Raises
    ------
    ValueError, cv2.error
        There is neither a size nor a scale, or as `warpPerspective` does.
    """
    # The scales: of a size, those to it.
    size, scale = _size(None, src), (fx, fy)
    if dsize is None or min(whole_pair(dsize, "width", "height")) <= 0:
        if not (math.isfinite(fx) and math.isfinite(fy) and min(fx, fy) > 0):
            raise ValueError(f"neither dsize nor scales: {dsize}, fx {fx}, fy {fy}; give one")
        shape = round(size[0] * fy), round(size[1] * fx)
    else:
        shape = dsize[1], dsize[0]
        scale = shape[1] / max(size[1], 1), shape[0] / max(size[0], 1)
    # Blocks have means already, unless one axis grows.
    kernel, most = _kernel(interpolation, OF_RESIZE, method, linear_light)
    if interpolation == cv2.INTER_AREA:
        kernel, method = common.NEAREST, method or "hybrid"
        most = math.inf if most is not None and max(scale) <= 1.0 else most
    call = Call(
        src, shape, dst, kernel, most, cv2.BORDER_REPLICATE, 0, linear_light, method, 0, RESIZED
    )

    def geometry() -> Geometry:
        if interpolation != cv2.INTER_NEAREST:
            return Homography(np.diag([*scale, 1.0]))
        # OpenCV samples at a pixel's corner, not at its center.
        axes = (np.floor(np.arange(shape[n]) / scale[1 - n]) + 0.5 for n in (1, 0))
        return BackwardMap(*np.meshgrid(*axes))

    return _drawn(
        call,
        lambda most: np.ones((1, 1), np.bool_) if min(scale) ** -2 > most else None,
        lambda dst: OPENCV.resize(src, dsize, dst, fx, fy, interpolation),
        geometry,
    )


@_refusing
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
    ValueError, cv2.error
        The radius is not above 0, of logarithms 1, or as `remap` does.
    """
    is_log, is_inverse = bool(flags & cv2.WARP_POLAR_LOG), bool(flags & cv2.WARP_INVERSE_MAP)
    least = 1.0 if is_log else 0.0
    if not least < maxRadius < math.inf:
        raise ValueError(f"maxRadius is above {least:g} px, not {maxRadius}")
    farthest = math.log(maxRadius) if is_log else maxRadius
    (down, across), (width, height) = _size(None, src), whole_pair(dsize, "width", "height")
    if width <= 0:
        width, height = round(maxRadius), round(maxRadius * math.pi)
    elif height <= 0:
        height = round(width * math.pi)

    def places(step: int) -> common.Places:
        x: Any = np.arange(0, width, step)
        y: Any = np.arange(0, height, step)[:, None]
        if is_inverse:
            x, y = x - center[0], y - center[1]
            radius = np.log1p(np.hypot(x, y)) if is_log else np.hypot(x, y)
            row = np.arctan2(y, x) % (2.0 * math.pi) * (down / (2.0 * math.pi))
            return radius * (across / farthest), row + call.around
        radius, angle = x * (farthest / width), y * (2.0 * math.pi / height)
        radius = np.expm1(radius) if is_log else radius
        return radius * np.cos(angle) + center[0], radius * np.sin(angle) + center[1]

    kernel, most = _kernel(flags & cv2.INTER_MAX, INTERPOLATIONS, method, linear_light)
    is_filled = bool(flags & cv2.WARP_FILL_OUTLIERS)
    border = cv2.BORDER_CONSTANT if is_filled else cv2.BORDER_TRANSPARENT
    around = min(BEYOND, down) if is_inverse else 0
    size = width, height
    call = Call(src, size[::-1], dst, kernel, most, border, 0, linear_light, method, around)
    return _drawn_by_map(
        call, places, lambda dst: OPENCV.warpPolar(src, size, center, maxRadius, flags, dst)
    )


def linearPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    maxRadius: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """`linearPolar` of OpenCV 4: `warpPolar` to the picture's own size."""
    size = _size(None, src)[::-1]
    return warpPolar(src, size, center, maxRadius, flags & ~cv2.WARP_POLAR_LOG, dst)


def logPolar(  # noqa: N802 - as cv2 has it
    src: NDArray[Any],
    center: tuple[float, float],
    M: float,  # noqa: N803
    flags: int,
    dst: NDArray[Any] | None = None,
) -> NDArray[Any]:
    """`logPolar` of OpenCV 4: `warpPolar` by logarithms to its own size; `M` px per unit."""
    size = _size(None, src)[::-1]
    most = math.exp(size[0] / M) if M > 0 else 0.0
    return warpPolar(src, size, center, most, flags | cv2.WARP_POLAR_LOG, dst)


def _drawn_by_map(
    call: Call, places: Callable[[int], common.Places], theirs: Callable[[Any], Any]
) -> NDArray[Any]:
    """As `_drawn`, by the places of every so many pixels."""
    return _drawn(
        call,
        lambda most: common.by_nodes(places, call.shape, most),
        theirs,
        lambda: BackwardMap.from_opencv(*places(1)),
    )


def _drawn(
    call: Call,
    tiles: Callable[[float], common.Tiles | None],
    theirs: Callable[[Any], Any],
    geometry: Callable[[], Geometry],
) -> NDArray[Any]:
    """Return OpenCV's picture, with own tiles where pixels shrink, or an own one.

    Of functions, each is called if needed: for tiles that shrink, by OpenCV's call for a `dst`, and
    for the geometry of own code.
    """
    src, dst, most = call.src, call.dst, call.most
    if not isinstance(src, np.ndarray):  # none, or one in the memory of a graphics card
        return theirs(dst)  # type: ignore[no-any-return]
    image = src[..., 0] if src.ndim == 3 and src.shape[2] == 1 else src
    if call.border & ~cv2.BORDER_ISOLATED not in BORDERS:
        raise ValueError(
            f"borderMode {call.border}: CONSTANT, REPLICATE, REFLECT, WRAP, REFLECT_101 and"
            " TRANSPARENT are known"
        )
    if call.border == cv2.BORDER_TRANSPARENT:
        full = (*call.shape, *image.shape[2:])
        dst = np.zeros(full, image.dtype) if dst is None else dst
        if dst.shape not in (full, (*full, 1)) or dst.dtype != image.dtype:
            raise ValueError(
                f"dst is {dst.dtype} of {dst.shape}; the result is {image.dtype} of {full}"
            )
    # Texels that are copied are OpenCV's whatever their value.
    is_taken, wanted = src.dtype in call.taken and not isinstance(src, np.ma.MaskedArray), None
    if most is None or (is_taken and most < math.inf and common.has_gaps(src)):
        is_taken = False
    elif is_taken and most < math.inf:
        wanted = tiles(most)
    if call.around:
        image = image[np.arange(-call.around, len(image) + call.around) % len(image)]
    if is_taken and (wanted is None or not wanted.all()):
        try:
            if wanted is None:
                return theirs(dst)  # type: ignore[no-any-return]
            # What shows through, and the source, may lie in `dst`: own tiles come first.
            place, mask, own = common.tiles_drawn(image, _drawing(call, image, geometry()), wanted)
            made: NDArray[Any] = theirs(dst)
        except cv2.error:  # so many channels, say: all is own, or refused in words
            pass
        else:
            made[place][mask] = own[mask].reshape(-1, *made.shape[2:])
            return made
    made = common.draw(image, _drawing(call, image, geometry()), linear_light=call.linear_light)
    if dst is None or dst.shape not in (made.shape, (*made.shape, 1)) or dst.dtype != made.dtype:
        return made
    dst[...] = made.reshape(dst.shape)
    return np.asanyarray(dst)


def _kernel(
    interpolation: int | str,
    known: dict[int, str],
    method: str | Method | None,
    linear_light: bool,
) -> tuple[str, float | None]:
    """Return a flag's interpolation, or the one named, and the limit of what does not shrink.

    No limit: own code draws all.
    """
    if isinstance(interpolation, str):
        return interpolation, None
    if interpolation not in known:
        last = "NEAREST_EXACT" if known is OF_RESIZE else "LANCZOS4"
        raise ValueError(
            f"interpolation {interpolation}: known are cv2.INTER_NEAREST to INTER_{last}"
        )
    kernel = known[interpolation]
    return kernel, None if linear_light or method is not None else LIMITS[kernel]


def _size(dsize: tuple[int, int] | None, src: Any) -> tuple[int, int]:
    """Return height and width of a size (width, height), or of the source without one."""
    width, height = (0, 0) if dsize is None else whole_pair(dsize, "width", "height")
    if min(width, height) > 0:
        return height, width
    if not isinstance(src, np.ndarray):  # OpenCV's own call sees to it
        return 1, 1
    if src.ndim not in (2, 3):
        raise ValueError(f"a picture is (height, width) or (height, width, C), not {src.shape}")
    return src.shape[0], src.shape[1]


def _back(
    matrix: NDArray[np.float64], is_inverse: bool, size: tuple[int, ...]
) -> tuple[float, ...] | None:
    """Return nine numbers from target to source, positive in front; None of a singular matrix.

    The source's center is in front. `size`: height and width of the source.
    """
    a, b, c, d, e, f, *others = matrix.ravel().tolist()
    g, h, i = others or (0.0, 0.0, 1.0)
    back = (
        e * i - f * h, c * h - b * i, b * f - c * e, f * g - d * i, a * i - c * g, c * d - a * f,
        d * h - e * g, b * g - a * h, a * e - b * d,
    )  # fmt: skip
    determinant = a * back[0] + b * back[3] + c * back[6]
    last = back[6:] if is_inverse else (g, h, i)
    sign = determinant * (last[0] * size[1] / 2 + last[1] * size[0] / 2 + last[2])
    if determinant == 0.0:
        return None
    back = (a, b, c, d, e, f, g, h, i) if is_inverse else back
    return back if sign > 0.0 else tuple(-one for one in back)


def _drawing(call: Call, image: NDArray[Any], geometry: Geometry) -> Drawing:
    """Return how own code draws a picture: over `dst` (h, w, C), or over a color (1, 1, C)."""
    channels = math.prod(image.shape[2:])
    color: Any = np.atleast_1d(call.value if call.border == cv2.BORDER_CONSTANT else 0)
    if color.ndim == 1 and 0 < color.size < channels:  # OpenCV's colors have four values
        color = np.resize([*color, *np.zeros(max(4 - color.size, 0))], channels)
    is_seen = call.border == cv2.BORDER_TRANSPARENT and call.dst is not None
    behind = call.dst.reshape(*call.shape, -1) if is_seen else common.color_behind(color, image)
    edge = BORDERS[call.border & ~cv2.BORDER_ISOLATED]
    return Drawing(
        common.method_for(call.kernel, call.method), geometry, call.shape, edge, behind=behind
    )


def __getattr__(name: str) -> Any:
    if name.startswith("__") and name != "__version__":
        raise AttributeError(name)
    return getattr(cv2, name)


def __dir__() -> list[str]:
    return sorted({*globals(), *dir(cv2)})


OWN = ["linearPolar", "logPolar", "remap", "resize", "warpAffine"]
OWN += ["warpPerspective", "warpPolar", "warp_like_opencv"]
__all__ = [*OWN, *(name for name in dir(cv2) if name[0] != "_" and name not in OWN)]  # noqa: PLE0604
