"""The library's calls: warp a picture by a matrix, a map or a flow."""

import dataclasses
import math
import operator
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample import registry
from resample.types import Floats
from resample_texture.encoding import Encoding, decoded, encoded, light, without_gaps
from resample_texture.geometry import BackwardMap, ForwardMap, Geometry, Homography
from resample_texture.matrices import homography
from resample_texture.shifts import shifted, whole_shift
from resample_texture.types import Edge, Method, Warped

LARGEST_PICTURE = 1 << 30  # pixels; more is a mistake in a size
MARGIN = 3  # px of a map around a region, besides the filter: they tell how large its pixels are

# Of cv2, which need not be imported for them.
WARP_INVERSE_MAP = 16
INTERPOLATIONS = {
    0: "nearest",
    1: "bilinear",
    2: "catmull-rom",
    3: "bilinear",
    4: "spline",
}
BORDER_CONSTANT, BORDER_TRANSPARENT = 0, 5
BORDERS = {
    BORDER_CONSTANT: Edge.TRANSPARENT,
    1: Edge.CLAMP,
    2: Edge.MIRROR,
    3: Edge.WRAP,
    BORDER_TRANSPARENT: Edge.TRANSPARENT,
}


def warp(  # noqa: PLR0913 - what a user may say about a warp
    image: NDArray[Any],
    matrix: ArrayLike | Geometry,
    shape: tuple[int, int],
    method: str | Method = "hybrid",
    *,
    filter: Any = None,  # noqa: A002
    reconstruction: Any = None,
    quality: float | None = None,
    total: bool | None = None,
    edge: str = "transparent",
    convention: str = "corner",
    inverse: bool = False,
    linear_light: bool = True,
    alpha: str | None = None,
    roi: tuple[int, int, int, int] | None = None,
    threads: int | None = None,
) -> Warped:
    """Warp a picture, antialiased where it shrinks and sharp where it grows.

    Parameters
    ----------
    image
        (H, W) or (H, W, C) of uint8, uint16, float16, float32 or float64. Values that are not
        finite in float32 are missing: they weigh nothing.
    matrix
        (3, 3) homography or (2, 3) affine map from source to target; or a `Homography`, a
        `ForwardMap` or a `BackwardMap`.
    shape
        Height and width of the target, px.
    method
        Name such as `hybrid`, `paper` or `opencv-supersample:n=8`, or an object with that role.
    filter
        Pixel filter: `area`, `gaussian:sigma=0.5`, `tent`, `mitchell`, `lanczos:a=3`...
    reconstruction
        Interpolation between texels: `nearest`, `bilinear`, `catmull-rom`, `spline`, `gaussian`.
    quality
        Parts that texels are cut into per px of the target; 1 is fastest.
    total
        True keeps sums (a texel's value is a flux, say) instead of means; of floats only.
    edge
        What lies beyond the source: `transparent`, `clamp`, `wrap` or `mirror`.
    convention
        `corner`: pixel centers at + 0.5. `opencv`: `matrix` counts from pixel centers.
    inverse
        `matrix` leads from target to source.
    linear_light
        Filter light: integer pictures are taken for sRGB-encoded, and returned so. False filters
        values as they are.
    alpha
        What a fourth channel is: `straight` (as for integers), `premultiplied` (as for floats) or
        `none`.
    roi
        Left, top, width and height of the part of the target that is wanted, px.
    threads
        At most this many; pixels do not depend on it.

    Returns
    -------
    `image` of the source's type and number of channels, (height, width) or (height, width, C),
    multiplied by `coverage` (height, width): what is not covered is black. Where the fourth channel
    is straight opacity, that alone is multiplied.

    Raises
    ------
    ValueError
        A picture, matrix, size or choice cannot be worked with.
    LookupError
        A name is unknown.
    """
    geometry = _geometry(matrix, convention, inverse)
    border = edge_named(edge)
    shape = _pair(shape, "height", "width")
    chosen = _method(
        method, filter=filter, reconstruction=reconstruction, quality=quality, total=total
    )
    part = np.s_[:, :]
    if roi is not None:
        geometry, shape, part = _within(geometry, shape, roi, chosen)
    _check_shape(shape)
    texels, encoding = decoded(image, linear_light=linear_light, alpha=alpha)
    if encoding.dtype.kind == "u" and _is_sum(chosen):
        raise ValueError(f"sums do not fit {encoding.dtype}; give floats: image.astype('float32')")
    shift = _shift(geometry, chosen)
    if shift is not None:
        return _moved(image, texels, encoding, shift, shape, border)
    warped = _run(chosen, (texels, geometry, shape, border), threads)
    if encoding.has_gaps and _is_sum(chosen):
        mean = dataclasses.replace(chosen, total=False)  # type: ignore[type-var]
        there = np.ascontiguousarray(texels[..., -1:])
        warped.image[..., -1:] = _run(mean, (there, geometry, shape, border), threads).image
    picture, coverage = encoded(warped, encoding)
    return Warped(picture[part], coverage[part])


def warp_like_opencv(  # noqa: PLR0913 - the parameters of cv2.warpPerspective
    src: NDArray[Any],
    M: ArrayLike,  # noqa: N803
    dsize: tuple[int, int],
    dst: NDArray[Any] | None = None,
    flags: int = 1,
    borderMode: int = BORDER_CONSTANT,  # noqa: N803
    borderValue: float | tuple[float, ...] = 0,  # noqa: N803
    *,
    linear_light: bool = True,
    method: str | Method = "hybrid",
) -> NDArray[Any]:
    """`cv2.warpPerspective` without the aliasing: same parameters, same kind of result.

    Parameters
    ----------
    src
        (H, W) or (H, W, C); a fourth channel is like the others.
    M
        (3, 3) or (2, 3) from source to target, pixel centers at integers; from target to source
        with `cv2.WARP_INVERSE_MAP` in `flags`.
    dsize
        Width and height of the result.
    dst
        What shows through under `BORDER_TRANSPARENT`; it is left as it is.
    flags
        `cv2.INTER_*`: how texels are interpolated where they grow (LANCZOS4: as a cubic spline).
    borderMode, borderValue
        `BORDER_CONSTANT`, `_REPLICATE`, `_REFLECT`, `_WRAP` or `_TRANSPARENT`; one value for all
        channels or one for each.
    linear_light
        Filter light, not encoded values, of integer pictures; OpenCV filters what it is given.
    method
        As `warp` takes it.

    Raises
    ------
    ValueError
        A flag is not one of these, `dst` or `borderValue` does not fit, or as `warp`.
    """
    kind = flags & ~WARP_INVERSE_MAP & ~8  # 8: WARP_FILL_OUTLIERS, which is what we do
    if kind not in INTERPOLATIONS:
        raise ValueError(f"flags {flags}: interpolations are cv2.INTER_NEAREST to INTER_LANCZOS4")
    if borderMode not in BORDERS:
        raise ValueError(
            f"borderMode {borderMode}: CONSTANT, REPLICATE, REFLECT, WRAP and TRANSPARENT are known"
        )
    width, height = _pair(dsize, "width", "height")
    shape = height, width
    _check_shape(shape)
    chosen = _method(method)
    if hasattr(chosen, "reconstruction"):
        chosen = _method(chosen, reconstruction=INTERPOLATIONS[kind])
    texels, encoding = decoded(src, linear_light=linear_light, alpha="none")
    image = np.asarray(src)
    geometry = homography(M, convention="opencv", inverse=bool(flags & WARP_INVERSE_MAP))
    full = (*shape, *image.shape[2:])
    if borderMode == BORDER_TRANSPARENT:
        background = _picture_behind(dst, full, image.dtype)
    else:
        background = _color_behind(borderValue, full, image.dtype)
    border = BORDERS[borderMode]
    shift = _shift(geometry, chosen)
    if shift is not None:
        moved = _moved(image, texels, encoding, shift, shape, border)
        is_there = (moved.coverage > 0).reshape(*shape, *[1] * (image.ndim - 2))
        return np.where(is_there, moved.image, background)
    warped = without_gaps(_run(chosen, (texels, geometry, shape, border)), encoding)
    behind = light(background.reshape(*shape, -1), is_encoded=encoding.is_encoded)
    over = Warped(_over(warped, behind), warped.coverage)
    return encoded(over, encoding._replace(has_gaps=False)).image


def _run(
    method: Method,
    given: tuple[Floats, Geometry, tuple[int, int], Edge],
    threads: int | None = None,
) -> Warped:
    """Warp on so many threads, whose tasks are handed out one by one."""
    from resample.kernels import jit

    with jit.threads(threads):
        return method(*given)


def edge_named(name: str) -> Edge:
    """What lies beyond the source, by name.

    Raises
    ------
    ValueError
        There is no such edge.
    """
    if name not in list(Edge):
        raise ValueError(f"edge {name!r}; known: {', '.join(Edge)}")
    return Edge(name)


def _picture_behind(
    dst: NDArray[Any] | None, full: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Picture to show where the source does not."""
    if dst is None:
        return np.zeros(full, dtype)
    behind = np.asarray(dst)
    if behind.shape != full or behind.dtype != dtype:
        raise ValueError(
            f"dst is {behind.dtype} of {behind.shape}; the result is {dtype} of {full}"
        )
    return behind


def _color_behind(
    value: float | tuple[float, ...], full: tuple[int, ...], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """One color, in the type of a picture, wherever the source does not show."""
    values = np.atleast_1d(np.asarray(value, np.float64))
    channels = full[2] if len(full) == 3 else 1
    if values.ndim > 1 or (values.size != 1 and values.size < channels):
        raise ValueError(f"borderValue {value}: give one number, or {channels}")
    if dtype.kind == "u":
        values = np.clip(np.rint(np.nan_to_num(values)), 0, np.iinfo(dtype).max)
    with np.errstate(over="ignore"):
        level = values.astype(dtype)
    level = np.broadcast_to(level, channels) if level.size == 1 else level[:channels]
    return np.broadcast_to(level if len(full) == 3 else level[0], full)


def _over(warped: Warped, behind: Floats) -> Floats:
    """Picture (H, W, C) and what shows through it; even what is not a number, but only there."""
    missing = (1.0 - warped.coverage)[..., None]
    through = np.zeros_like(warped.image)
    np.multiply(missing, behind, out=through, where=missing > 0.0)
    through += warped.image
    return through


def _shift(geometry: Geometry, chosen: Method) -> tuple[int, int] | None:
    """Whole pixels by which texels move, if that is all that happens to them."""
    keeps = getattr(chosen, "keeps_texels", False)
    return whole_shift(geometry.matrix) if keeps and isinstance(geometry, Homography) else None


def _moved(
    image: NDArray[Any], texels: Floats, encoding: Encoding,
    shift: tuple[int, int], shape: tuple[int, int], edge: Edge,
) -> Warped:  # fmt: skip
    """Picture moved by whole pixels, value for value; what is missing is not covered."""
    image = np.asarray(image)
    if not encoding.has_gaps:
        return shifted(image, shift, shape, edge)
    gap = texels[..., -1] == 0.0
    values = image.copy()
    values[gap] = 0
    moved, missing = shifted(values, shift, shape, edge), shifted(gap, shift, shape, edge)
    return Warped(moved.image, np.where(missing.image, np.float32(0), moved.coverage))


def _is_sum(chosen: Method) -> bool:
    return dataclasses.is_dataclass(chosen) and getattr(chosen, "total", False)


def _geometry(matrix: ArrayLike | Geometry, convention: str, inverse: bool) -> Geometry:
    if isinstance(matrix, Homography | ForwardMap | BackwardMap):
        if inverse or convention != "corner":
            raise ValueError("convention and inverse speak about a matrix, not about a geometry")
        return matrix
    return homography(matrix, convention=convention, inverse=inverse)


def _within(
    geometry: Geometry, shape: tuple[int, int], roi: tuple[int, int, int, int], chosen: Method
) -> tuple[Geometry, tuple[int, int], tuple[slice, slice]]:
    """Geometry and shape of what to draw of the target, and the part of it that is wanted."""
    left, top = _pair(roi[:2], "left", "top")
    width, height = _pair(roi[2:], "width", "height")
    if left < 0 or top < 0 or left + width > shape[1] or top + height > shape[0]:
        raise ValueError(f"the region {roi} does not lie within {shape[1]} × {shape[0]} px")
    _check_shape((height, width))
    if isinstance(geometry, BackwardMap):
        if geometry.x.shape != shape:
            raise ValueError(f"a map of {geometry.x.shape} makes no picture of {shape}")
        margin = MARGIN + math.ceil(getattr(getattr(chosen, "filter", None), "radius", 0.0))
        x, y = max(left - margin, 0), max(top - margin, 0)
        seen = np.s_[y : top + height + margin, x : left + width + margin]
        part = np.s_[top - y : top - y + height, left - x : left - x + width]
        around = BackwardMap(geometry.x[seen], geometry.y[seen])
        return around, around.x.shape, part
    everything = np.s_[:, :]
    if isinstance(geometry, ForwardMap):
        return ForwardMap(geometry.x - left, geometry.y - top), (height, width), everything
    moved = np.array([[1.0, 0.0, -left], [0.0, 1.0, -top], [0.0, 0.0, 1.0]]) @ geometry.matrix
    return Homography(moved, geometry.is_signed), (height, width), everything


def _pair(given: Sequence[int], first: str, second: str) -> tuple[int, int]:
    """Two numbers of pixels."""
    try:
        numbers = [operator.index(number) for number in given]
    except TypeError:
        numbers = []
    if len(numbers) != 2:
        raise ValueError(f"{given!r} is no {first} and {second}: give two whole numbers of px")
    return numbers[0], numbers[1]


def _check_shape(shape: tuple[int, int]) -> None:
    height, width = shape
    if min(height, width) < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a target of {width} × {height} px; give a height and a width of 1 px or more, "
            f"together at most {LARGEST_PICTURE} px"
        )


def _method(method: str | Method, **choices: Any) -> Method:
    """Method by name, with the choices that were made.

    Raises
    ------
    ValueError
        The method knows nothing of a choice.
    """
    chosen: Any = registry.build("methods", method) if isinstance(method, str) else method
    made = {name: value for name, value in choices.items() if value is not None}
    known = {f.name for f in dataclasses.fields(chosen)} if dataclasses.is_dataclass(chosen) else ()
    for name in made:
        if name not in known:
            raise ValueError(f"{method} takes no {name}; hybrid does")
    result: Method = dataclasses.replace(chosen, **made) if made else chosen
    return result
