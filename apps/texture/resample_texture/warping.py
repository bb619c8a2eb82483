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
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, Homography
from resample_texture.geometry.matrices import homography
from resample_texture.geometry.shifts import shifted, whole_shift
from resample_texture.texels.encoding import Encoding, decoded, encoded
from resample_texture.types import Edge, Method, Warped

LARGEST_PICTURE = 1 << 30  # pixels; more is a mistake in a size
MARGIN = 3  # px of a map around a region, besides the filter: they tell how large its pixels are


def warp(  # noqa: PLR0913 - what a user may say about a warp
    image: NDArray[Any],
    matrix: ArrayLike | Geometry,
    shape: tuple[int, int],
    method: str | Method = "hybrid",
    *,
    filter: Any = None,  # noqa: A002
    interpolation: Any = None,
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
    interpolation
        Interpolation between texels: `area-spline`, `lanczos`, `spline`, `catmull-rom`,
        `bilinear`, `nearest`, `gaussian`.
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
    shape = whole_pair(shape, "height", "width")
    chosen = method_named(
        method, filter=filter, interpolation=interpolation, quality=quality, total=total
    )
    part = np.s_[:, :]
    if roi is not None:
        geometry, shape, part = _within(geometry, shape, roi, chosen)
    check_shape(shape)
    texels, encoding = decoded(image, linear_light=linear_light, alpha=alpha)
    if encoding.dtype.kind == "u" and _is_sum(chosen):
        raise ValueError(f"sums do not fit {encoding.dtype}; give floats: image.astype('float32')")
    shift = shift_of(geometry, chosen)
    if shift is not None:
        return moved(image, texels, encoding, shift, shape, border)
    warped = run(chosen, (texels, geometry, shape, border), threads)
    if encoding.has_gaps and _is_sum(chosen):
        mean = dataclasses.replace(chosen, total=False)  # type: ignore[type-var]
        there = np.ascontiguousarray(texels[..., -1:])
        warped.image[..., -1:] = run(mean, (there, geometry, shape, border), threads).image
    picture, coverage = encoded(warped, encoding)
    return Warped(picture[part], coverage[part])


def run(
    method: Method,
    given: tuple[Floats, Geometry, tuple[int, int], Edge],
    threads: int | None = None,
) -> Warped:
    """Warp on so many threads, whose tasks are handed out one by one."""
    from resample.engine import jit

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


def shift_of(geometry: Geometry, chosen: Method) -> tuple[int, int] | None:
    """Whole pixels by which texels move, if that is all that happens to them."""
    keeps = getattr(chosen, "keeps_texels", False)
    return whole_shift(geometry.matrix) if keeps and isinstance(geometry, Homography) else None


def moved(
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
    left, top = whole_pair(roi[:2], "left", "top")
    width, height = whole_pair(roi[2:], "width", "height")
    if left < 0 or top < 0 or left + width > shape[1] or top + height > shape[0]:
        raise ValueError(f"the region {roi} does not lie within {shape[1]} × {shape[0]} px")
    check_shape((height, width))
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


def whole_pair(given: Sequence[int], first: str, second: str) -> tuple[int, int]:
    """Two numbers of pixels."""
    try:
        numbers = [operator.index(number) for number in given]
    except TypeError:
        numbers = []
    if len(numbers) != 2:
        raise ValueError(f"{given!r} is no {first} and {second}: give two whole numbers of px")
    return numbers[0], numbers[1]


def check_shape(shape: tuple[int, int]) -> None:
    """Refuse a target's height and width that no picture can have."""
    height, width = shape
    if min(height, width) < 1 or height * width > LARGEST_PICTURE:
        raise ValueError(
            f"a target of {width} × {height} px; give a height and a width of 1 px or more, "
            f"together at most {LARGEST_PICTURE} px"
        )


def method_named(method: str | Method, **choices: Any) -> Method:
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
