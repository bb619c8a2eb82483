"""Warp a picture by a matrix, a map, a function or a flow."""

from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from resample.calling import takes
from resample.cameras.models import AnyConvention, Convention
from resample.messages import check_threads, doubles_of
from resample.types import Doubles
from resample_texture.arguments import (
    Places,
    axis_of,
    check_shape,
    check_sums,
    edge_named,
    fill_for,
    geometry_of,
    given_pictures,
    is_pair_of_maps,
    is_transform,
    matrices_in,
    method_named,
    places_of_points,
    stacked,
    warn_if_unknown,
    whole_pair,
    within,
    without_nodata,
)
from resample_texture.drawing import MOST_AT_ONCE, Drawing, drawn, prepared, put
from resample_texture.geometry.mappings import (
    BackwardMap,
    ForwardMap,
    Geometry,
    Homography,
    Size,
    points_along,
    points_back,
)
from resample_texture.texels.encoding import light_for
from resample_texture.types import (
    FRAMES,
    AnyAlpha,
    AnyAxis,
    AnyEdge,
    AnyLight,
    Fill,
    Method,
    SamplingOptions,
    Warped,
    WarpOptions,
)


@takes(WarpOptions)
def warp(
    image: Any,
    matrix: ArrayLike | Geometry | Places,
    shape: Size | None = None,
    method: str | Method = "hybrid",
    *,
    edge: AnyEdge = "transparent",
    **options: Unpack[WarpOptions],
) -> Warped:
    """Warp a picture, antialiased where it shrinks and sharp where it grows.

    Parameters
    ----------
    image
        An array (H, W) or (H, W, C), or a stack of them, see `axis`, masked or not; or
        anything else that `resample.files.conversion.as_picture` takes, such as a path. uint8
        and uint16 are taken for light; bool, other integers of 8 to 64 bits and floats of 16 to 64
        bits for values, which are never encoded or limited to 0..1; complex ones are warped in
        both parts. Values that are masked, not finite or `nodata` are missing, channel by channel,
        and have no weight.
    matrix
        (3, 3) homography or (2, 3) affine map from source to target, or one for each frame or
        result, (N, 3, 3) or (N, 2, 3); or a `Homography`, a `ForwardMap` or a `BackwardMap`; or a
        function from x and y of pixels, (height, width) each, to x and y of the source; or the pair
        `(map_x, map_y)` as `cv2.remap` takes it, or a transform of scikit-image from source to
        target; both count from pixel centers, whatever the `convention`.
    shape
        Height and width of the target, px; None: the maps', or the picture's.
    method
        Name such as `hybrid`, `paper` or `opencv-supersample:n=8`, or an object in that role.
        `nearest` and `majority` are for labels: they copy texels without mixing them.
    edge
        What lies beyond the source: `transparent`, `clamp`, `wrap`, `mirror` or `reflect-101`.
    options
        Any of the options that follow; `WarpOptions` in `resample_texture.types` has their types.

    Other Parameters
    ----------------
    filter
        Pixel filter: `area`, `gaussian:sigma=0.5`, `tent`, `mitchell`, `lanczos:a=3`...
    interpolation
        Interpolation between texels: `area-spline`, `lanczos`, `spline`, `catmull-rom`,
        `bilinear`, `nearest`, `gaussian`.
    quality
        Parts per target px that texels are split into; 1 is fastest.
    total
        True preserves sums (of a flux, say) instead of means; for floats only.
    convention
        `corner`: pixel centers at + 0.5. `opencv`: the coordinates of `matrix`, or of a function,
        count from pixel centers.
    inverse
        True: `matrix` maps target to source.
    axis
        What three dimensions are: 0, a stack of gray frames (N, H, W); −1, a picture (H, W, C) of
        any number of channels. By default frames, if there is a matrix for each, or up to 15
        channels; else they are refused. Four are a stack (N, H, W, C), of more channels with 0.
    linear_light
        `pixels`: uint8 and uint16 are sRGB-encoded; between texels their levels are interpolated,
        and pixels that cover more than a texel average their light (along a `ForwardMap` all do).
        True: light is interpolated, too. False: values are filtered as given. By default `pixels`
        for uint8, and for files that are encoded.
    alpha
        What a fourth channel is: `straight` (as for uint8 and uint16), `premultiplied` (as for all
        other types) or `none`.
    nodata
        Value that stands for missing ones, also in the result.
    fill
        Value of unknown pixels, and all others are means of known values; or
        `premultiplied`: values are multiplied by the coverage, as light is composited. By default
        floats and masked arrays, unless they have opacity, get NaN or a mask, or `nodata`, and
        others are multiplied.
    roi
        Left, top, width and height of the part of the target to return, px.
    threads
        Most threads to use; the result does not depend on it.
    out
        Array of the result's shape and type to write the result to.

    Returns
    -------
    `image` of the source's type and number of channels, (height, width) or (height, width, C), and
    `coverage` (height, width). Of floats and masked arrays pixels are means of known values, NaN
    or masked where none are known, and a channel that is known for less than half of its pixel's
    coverage is, too; sums are 0 there. Others are multiplied by the coverage, so that pixels beyond
    the picture are black, or their opacity is, if the fourth channel is straight opacity; copied
    texels (`nearest`, `majority`, shifts by whole pixels) are not multiplied. A masked array
    returns a masked array, a stack, or many matrices, (N, ...) of both.

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
    check_threads(options.get("threads"))
    nodata, roi, out = options.get("nodata"), options.get("roi"), options.get("out")
    linear_light, alpha = options.get("linear_light"), options.get("alpha")
    convention, inverse = options.get("convention", "corner"), options.get("inverse", False)
    if shape is None and is_pair_of_maps(matrix):
        shape = np.shape(matrix[0])[:2]  # type: ignore[index]
    elif shape is None and isinstance(matrix, BackwardMap):
        shape = matrix.x.shape
    size = (0, 0) if shape is None else whole_pair(shape, "height", "width")
    matrices = matrices_in(matrix, size)
    given = given_pictures(image, options.get("axis"), None if matrices is None else len(matrices))
    image, shape = given.values, given.size if shape is None else size
    linear_light = light_for(linear_light, image.dtype, given.is_encoded)
    border = edge_named(edge)
    chosen = method_named(
        method, **{name: options.get(name) for name in SamplingOptions.__annotations__}
    )
    check_sums(image.dtype, chosen)
    if roi is None or callable(matrix):
        check_shape(shape)
    image = without_nodata(image, nodata)
    warn_if_unknown(image)
    one_of = image[0] if given.is_stack else image
    filling = fill_for(options.get("fill"), one_of, alpha, chosen)

    def placed(matrix: Any) -> tuple[Drawing, tuple[slice, slice]]:
        geometry, form, part = geometry_of(matrix, shape, convention, inverse), shape, np.s_[:, :]
        if roi is not None:
            geometry, form, part = within(geometry, shape, roi, chosen)
        check_shape(form)
        drawing = Drawing(chosen, geometry, form, border, options.get("threads"), fill=filling)
        return drawing._replace(linear_light=linear_light, alpha=alpha), part

    def one(picture: NDArray[Any], way: tuple[Drawing, tuple[slice, slice]]) -> Warped:
        drawing, part = way
        warped = drawn(picture, drawing)
        return type(warped)(warped.image[part], warped.coverage[part])

    if matrices is not None:
        pictures = image if given.is_stack else [image] * len(matrices)
        pairs = zip(pictures, map(placed, matrices), strict=True)
        warped = stacked([one(*pair) for pair in pairs], image)
    elif given.is_stack:
        drawing, part = placed(matrix)
        quick = prepared(drawing, given.size) if len(image) > 1 else drawing
        warped = stacked([one(picture, (quick, part)) for picture in image], image)
    else:
        warped = one(image, placed(matrix))
    return put(warped, nodata, options.get("fill"), out)


class Plan:
    """A prepared warp of pictures of one size, e.g. to undistort the frames of a film.

    Parameters
    ----------
    matrix, shape, method, edge, convention, inverse
        As `warp` takes them. A function is called once.
    source_shape
        Height and width of the pictures, px.

    Raises
    ------
    ValueError, LookupError
        As `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import Plan
    >>> plan = Plan(np.diag([2.0, 2.0, 1.0]), (40, 60), (20, 30))
    >>> plan(np.ones((20, 30), np.float32)).image.shape
    (40, 60)
    """

    def __init__(
        self,
        matrix: ArrayLike | Geometry | Places,
        shape: Size,
        source_shape: Size,
        method: str | Method = "hybrid",
        *,
        edge: AnyEdge = "transparent",
        convention: AnyConvention = "corner",
        inverse: bool = False,
    ) -> None:
        self.shape = whole_pair(shape, "height", "width")
        self.source_shape = whole_pair(source_shape, "height", "width")
        check_shape(self.shape)
        check_shape(self.source_shape)
        border = edge_named(edge)
        geometry = geometry_of(matrix, self.shape, convention, inverse)
        self._drawing = Drawing(method_named(method), geometry, self.shape, border)
        self._quick = prepared(self._drawing, self.source_shape)

    def __call__(
        self,
        image: NDArray[Any],
        *,
        axis: AnyAxis | None = None,
        linear_light: AnyLight | None = None,
        alpha: AnyAlpha | None = None,
        nodata: complex | None = None,
        fill: Fill | None = None,
        threads: int | None = None,
        out: NDArray[Any] | None = None,
    ) -> Warped:
        """Warp a picture.

        Parameters
        ----------
        image
            A picture of `source_shape`, or a stack of them. It and all options are as `warp` takes
            them.

        Returns
        -------
        What `warp` returns.

        Raises
        ------
        ValueError
            The picture has another size or is invalid.
        """
        check_threads(threads)
        image = image if isinstance(image, np.ma.MaskedArray) else np.asarray(image)
        is_stack = axis_of(image, axis) == FRAMES
        image = without_nodata(image, nodata)
        pictures = image if is_stack else image[np.newaxis]
        if pictures.shape[1:3] != self.source_shape:
            raise ValueError(f"the plan is for pictures of {self.source_shape}, not {image.shape}")
        channels = pictures[0, 0, 0].size
        values = pictures[0].size + channels * self.shape[0] * self.shape[1]
        drawing = self._quick if values <= MOST_AT_ONCE else self._drawing
        filling = fill_for(fill, pictures[0], alpha, self._drawing.method)
        light: dict[str, Any] = {"linear_light": linear_light, "alpha": alpha}
        drawing = drawing._replace(threads=threads, fill=filling, **light)
        each = [drawn(picture, drawing) for picture in pictures]
        warped = stacked(each, image) if is_stack else each[0]
        return put(warped, nodata, fill, out)


def warp_points(
    points: ArrayLike,
    matrix: ArrayLike | Geometry | Places,
    *,
    convention: AnyConvention = "corner",
    inverse: bool = False,
) -> Doubles:
    """Map points of a picture to its warp, or back.

    Parameters
    ----------
    points
        (2,), (N, 2) or (..., 2): x and y, px.
    matrix
        What `warp` took: a matrix, a geometry, a pair of maps as `cv2.remap` takes it, or a
        transform of scikit-image. A function only with `inverse`, as it leads from target to
        source.
    convention
        `corner`: points, and a matrix or function, count with pixel centers at + 0.5; `opencv`:
        from pixel centers.
    inverse
        True: points of the target, and their places in the source.

    Returns
    -------
    As `points`, float64; not a number where a map has no such place, to 0.001 px.

    Raises
    ------
    ValueError
        Points are not pairs of numbers, or the matrix is invalid.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp_points
    >>> box = [[0, 0], [64, 48]]
    >>> warp_points(box, [[0.5, 0, 10], [0, 0.5, 0]]).tolist()
    [[10.0, 0.0], [42.0, 24.0]]
    """
    given = doubles_of("points", points, "numbers (N, 2)")
    if given.ndim < 1 or given.shape[-1] != 2:
        raise ValueError(f"points are pairs of x and y, (N, 2), not {given.shape}")
    if convention not in tuple(Convention):
        raise ValueError(f"unknown convention {convention!r}; known: {', '.join(Convention)}")
    shift = 0.5 if convention == Convention.OPENCV else 0.0
    place = given.reshape(-1, 2).T
    if is_transform(matrix):
        u, v = places_of_points(matrix, not inverse)(*(place + shift - 0.5))
        moved = np.stack([u, v]) + 0.5 - shift
    elif callable(matrix):
        if not inverse:
            raise ValueError("a function leads from target to source; give inverse=True for that")
        moved = np.stack(np.broadcast_arrays(*matrix(*place)))
    else:
        is_given = isinstance(matrix, Homography | ForwardMap | BackwardMap)
        geometry = geometry_of(matrix, (1, 1), "corner" if is_given else convention, False)
        place = place + shift
        if isinstance(geometry, Homography):
            full = geometry.inverse() if inverse else geometry.matrix
            x, y, w = full[:, :2] @ place + full[:, 2:]
            is_seen = w > 0.0 if geometry.is_signed else w != 0.0
            with np.errstate(divide="ignore", invalid="ignore"):
                moved = np.where(is_seen, np.stack([x, y]) / w, np.nan) - shift
        else:
            goes_along = isinstance(geometry, BackwardMap) == inverse
            move: Any = points_along if goes_along else points_back
            moved = move(geometry.x, geometry.y, place) - shift
    return np.asarray(moved.T.reshape(given.shape), np.float64)
