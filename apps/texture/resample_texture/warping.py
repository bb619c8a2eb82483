"""Warp a picture by a matrix, a map, a function or a flow."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.files.exchange import as_picture
from resample_texture.arguments import (
    Places,
    check_shape,
    edge_named,
    geometry_of,
    method_named,
    whole_pair,
    within,
)
from resample_texture.drawing import Drawing, adds, drawn, put
from resample_texture.geometry.mappings import Geometry
from resample_texture.texels.gaps import masked
from resample_texture.types import Method, Warped


def warp(  # noqa: PLR0913 - what a user may say about a warp
    image: Any,
    matrix: ArrayLike | Geometry | Places,
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
    out: NDArray[Any] | None = None,
) -> Warped:
    """Warp a picture, antialiased where it shrinks and sharp where it grows.

    Parameters
    ----------
    image
        An array (H, W) or (H, W, C), or a batch (N, H, W, C), in any layout, masked or not; or
        anything else that `resample.files.exchange.as_picture` takes, such as a path. uint8
        and uint16 are taken for light; bool, other integers of 8 to 64 bits and floats of 16 to 64
        bits for values, which are never encoded or limited to 0..1. Values that are masked or not
        finite are missing, channel by channel, and have no weight.
    matrix
        (3, 3) homography or (2, 3) affine map from source to target; or a `Homography`, a
        `ForwardMap` or a `BackwardMap`; or a function from x and y of pixels, (height, width)
        each, to those of the source.
    shape
        Height and width of the target, px.
    method
        Name such as `hybrid`, `paper` or `opencv-supersample:n=8`, or an object in that role.
        `nearest` and `majority` are for labels: they copy texels without mixing them.
    filter
        Pixel filter: `area`, `gaussian:sigma=0.5`, `tent`, `mitchell`, `lanczos:a=3`...
    interpolation
        Interpolation between texels: `area-spline`, `lanczos`, `spline`, `catmull-rom`,
        `bilinear`, `nearest`, `gaussian`.
    quality
        Parts per target px that texels are split into; 1 is fastest.
    total
        True preserves sums (of a flux, say) instead of means; for floats only.
    edge
        What lies beyond the source: `transparent`, `clamp`, `wrap`, `mirror` or `reflect-101`.
    convention
        `corner`: pixel centers at + 0.5. `opencv`: the coordinates of `matrix`, or of a function,
        count from pixel centers.
    inverse
        True: `matrix` maps target to source.
    linear_light
        Filter linear light: uint8 and uint16 are taken for sRGB-encoded, and the result is encoded
        again. False filters values as given.
    alpha
        What a fourth channel is: `straight` (as for uint8 and uint16), `premultiplied` (as for all
        other types) or `none`.
    roi
        Left, top, width and height of the part of the target to return, px.
    threads
        Most threads to use; the result does not depend on it.
    out
        Array of the result's shape and type to write the result to.

    Returns
    -------
    `image` of the source's type and number of channels, (height, width) or (height, width, C),
    multiplied by `coverage` (height, width): uncovered pixels are black. If the fourth channel is
    straight opacity, only it is multiplied; copied texels (`nearest`, `majority`, shifts by whole
    pixels) are not multiplied. A channel known for less than half of its pixel's coverage is not a
    number, or masked. A masked array returns a masked array, a batch (N, height, width, C) and
    (N, height, width).

    Raises
    ------
    ValueError
        A picture, matrix, size or option is invalid.
    LookupError
        A name is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp
    >>> image = np.full((48, 64, 3), 255, np.uint8)
    >>> matrix = [[0.9, -0.2, 10], [0.2, 0.9, 0], [0, 0.002, 1]]
    >>> warp(image, matrix, (60, 80))
    Warped(60 × 80 × 3 uint8, 50.1 % covered)
    >>> warp(image, matrix, (60, 80), interpolation="lanczos", edge="mirror")
    Warped(60 × 80 × 3 uint8, 100 % covered)
    >>> warp(image, lambda x, y: (y, x), (64, 48))  # where each pixel comes from
    Warped(64 × 48 × 3 uint8, 100 % covered)
    """
    image = as_picture(image)
    border = edge_named(edge)
    shape = whole_pair(shape, "height", "width")
    chosen = method_named(
        method, filter=filter, interpolation=interpolation, quality=quality, total=total
    )
    if image.dtype.kind in "bui" and adds(chosen):
        raise ValueError(f"sums do not fit {image.dtype}; give floats: image.astype('float32')")
    if roi is None or callable(matrix):
        check_shape(shape)
    geometry = geometry_of(matrix, shape, convention, inverse)
    part = np.s_[:, :]
    if roi is not None:
        geometry, shape, part = within(geometry, shape, roi, chosen)
    check_shape(shape)
    drawing = Drawing(chosen, geometry, shape, border, threads)

    def one(picture: NDArray[Any]) -> Warped:
        warped = drawn(picture, drawing, linear_light=linear_light, alpha=alpha)
        return Warped(warped.image[part], warped.coverage[part])

    warped = one(image) if image.ndim != 4 else _stacked([one(picture) for picture in image], image)
    return warped if out is None else put(warped, out)


def _stacked(each: list[Warped], image: NDArray[Any]) -> Warped:
    """Stack the warped pictures of a batch (N, H, W, C)."""
    if not each:
        raise ValueError(f"a batch has one picture or more, not {image.shape}")
    images = [warped.image for warped in each]
    stacked: NDArray[Any] = np.stack([np.ma.getdata(one) for one in images])
    if isinstance(image, np.ma.MaskedArray):
        mask = np.stack([np.ma.getmaskarray(one) for one in images])
        stacked = masked(stacked, mask, image.fill_value)
    return Warped(stacked, np.stack([warped.coverage for warped in each]))
