"""A call in place of OpenCV's, with its parameters and its conventions."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.types import Floats
from resample_texture.geometry.matrices import homography
from resample_texture.texels.encoding import decoded, encoded, light, without_gaps
from resample_texture.types import Edge, Method, Warped
from resample_texture.warping import check_shape, method_named, moved, run, shift_of, whole_pair

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
        Shows through under `BORDER_TRANSPARENT`. If it has the result's shape and type, the result
        is also put into it.
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
    width, height = whole_pair(dsize, "width", "height")
    shape = height, width
    check_shape(shape)
    chosen = method_named(method)
    if hasattr(chosen, "interpolation"):
        chosen = method_named(chosen, interpolation=INTERPOLATIONS[kind])
    texels, encoding = decoded(src, linear_light=linear_light, alpha="none")
    image = np.asarray(src)
    geometry = homography(M, convention="opencv", inverse=bool(flags & WARP_INVERSE_MAP))
    full = (*shape, *image.shape[2:])
    if borderMode == BORDER_TRANSPARENT:
        background = _picture_behind(dst, full, image.dtype)
    else:
        background = _color_behind(borderValue, full, image.dtype)
    border = BORDERS[borderMode]
    shift = shift_of(geometry, chosen)
    if shift is not None:
        result = moved(image, texels, encoding, shift, shape, border)
        is_there = (result.coverage > 0).reshape(*shape, *[1] * (image.ndim - 2))
        return _into(dst, np.where(is_there, result.image, background))
    warped = without_gaps(run(chosen, (texels, geometry, shape, border)), encoding)
    behind = light(background.reshape(*shape, -1), is_encoded=encoding.is_encoded)
    over = Warped(_over(warped, behind), warped.coverage)
    return _into(dst, encoded(over, encoding._replace(has_gaps=False)).image)


def _into(dst: NDArray[Any] | None, result: NDArray[Any]) -> NDArray[Any]:
    """Result, also put into an array that was given for it and fits."""
    if dst is None or dst.shape != result.shape or dst.dtype != result.dtype:
        return result
    dst[...] = result
    return dst


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
