"""Reproject pictures between coordinate systems; add pictures up with weights and variances."""

import math
from collections.abc import Sequence
from typing import Any, Literal, NamedTuple, Unpack

import numpy as np
from numpy.typing import ArrayLike, DTypeLike, NDArray

from resample.calling import takes
from resample.showable import array_of
from resample.types import Doubles
from resample_sky.reprojection import ERROR, World, reprojection
from resample_texture.arguments import (
    PREMULTIPLIED,
    Places,
    check_shape,
    geometry_of,
    given_pictures,
    whole_pair,
)
from resample_texture.geometry.mappings import (
    BackwardMap,
    Geometry,
    places_of,
    source_coordinates,
)
from resample_texture.types import (
    AnyAxis,
    AnyEdge,
    Method,
    ResultOptions,
    SamplingOptions,
    StackOptions,
    ValueOptions,
    Warped,
)
from resample_texture.warping import warp

SUPPORT = {
    "nearest": 1,
    "bilinear": 2,
}  # texels that a place takes
LARGEST_PERIOD = 12  # texels between those that are probed at once


class ReprojectOptions(SamplingOptions, StackOptions, ValueOptions, ResultOptions, total=False):
    """Options of `reproject`, as `warp` describes them."""

    method: str | Method
    edge: AnyEdge


@takes(ReprojectOptions)
def reproject(
    image: Any,
    source: World,
    target: World,
    shape: tuple[int, int],
    *,
    transform: Any = None,
    error: float = ERROR,
    **choices: Unpack[ReprojectOptions],
) -> Warped:
    """Show a picture of one coordinate system in another: of the sky, of maps, of the Earth.

    Parameters
    ----------
    image
        As `warp` takes it.
    source, target
        Coordinates of the picture and of the result: each an affine map (2, 3) from pixels to the
        world, the first pixel's corner at (0, 0), as rasterio's `Affine` is; or world coordinates
        with `pixel_to_world_values` and `world_to_pixel_values`, as `astropy.wcs.WCS` has them,
        pixel centers at integers. Frames of two of astropy's are transformed by astropy.
    shape
        Height and width of the result, px.
    transform
        From the target's world coordinates to the source's, if they differ: a function from x and y
        to x and y, or a `pyproj.Transformer.from_crs(target_crs, source_crs, always_xy=True)`.
    error
        Of a pixel's place in the source, px, at most, as checked on a grid of 4 px; 0 transforms
        every pixel.
    choices
        Options of `warp`: `method`, `edge`, `filter`, `interpolation`, `quality`, `total`,
        `axis`, `linear_light`, `alpha`, `nodata`, `fill`, `roi`, `threads` and `out`.

    Returns
    -------
    As `warp` does: NaN where a picture of floats has no values.

    Raises
    ------
    ValueError
        Coordinates are invalid, or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_sky import reproject
    >>> coarse, fine = [[30, 0, 5000], [0, -30, 9000]], [[10, 0, 5300], [0, -10, 8700]]  # m
    >>> reproject(np.ones((40, 40)), coarse, fine, (60, 60))
    WarpedMeans(60 × 60 float64, 100 % covered)
    """
    shape = whole_pair(shape, "height", "width")
    check_shape(shape)
    geometry = reprojection(source, target, shape, transform=transform, error=error)
    return warp(image, geometry, shape, **choices)


class Coadded(NamedTuple):
    """Pictures added up."""

    mean: NDArray[Any]  # (h, w) or (h, w, C), of texels that cover a pixel; NaN without any
    weight: Doubles  # as `mean`: sum of weights times the shares of the pixel that they cover
    variance: Doubles | None  # as `mean`, of the mean; not a number where nothing covers a pixel

    def __array__(
        self, dtype: DTypeLike | None = None, *, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return `mean`."""
        return array_of(self.mean, dtype, copy)


def coadd(
    images: Sequence[Any],
    geometries: Sequence[ArrayLike | Geometry | Places],
    shape: tuple[int, int],
    *,
    weights: Sequence[Any] | None = None,
    variances: Sequence[Any] | None = None,
    interpolation: Literal["nearest", "bilinear"] = "nearest",
    axis: AnyAxis | None = None,
    threads: int | None = None,
) -> Coadded:
    """Add pictures up in one frame: their mean by weight, as drizzle and reproject make it.

    A texel counts by its weight times the share of the pixel that it covers. `nearest` takes
    texels for squares of one value, with exact shares for warps along the axes (drizzle with
    `pixfrac=1`). `bilinear` is smoother.

    Variances of the mean are sums of the texels' variances times their squared shares, exact where
    noise of texels is independent and a pixel covers fewer than 12 texels across; beyond that they
    are estimates. Neighbouring pixels share texels, so that their noise is correlated: the variance
    of a sum of pixels is larger than the sum of their variances.

    Parameters
    ----------
    images
        Pictures (H, W), or (H, W, C) of up to 15 channels, of real numbers, masked or not; what is
        not finite counts nothing.
    geometries
        One for each, as `warp` takes it, or of `reprojection`; not a forward map.
    shape
        Height and width of the result, px.
    weights
        For each picture a number, or an array that broadcasts to the picture, 0 or more; by default
        1. For the least variance give 1 / variance.
    variances
        For each picture a number, or an array that broadcasts to the picture, of its texels.
    interpolation
        `nearest` or `bilinear`.
    axis
        −1: pictures have any number of channels.
    threads
        Most threads to use.

    Raises
    ------
    ValueError
        Numbers of pictures, geometries, weights and variances, or channels, differ; a weight or
        variance is below 0 or none; or as `warp` does.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_sky import coadd
    >>> first, second = np.full((8, 8), 2.0), np.full((8, 8), 6.0)
    >>> shift = [[1, 0, 4], [0, 1, 0]]
    >>> made = coadd([first, second], [np.eye(3), shift], (8, 12), variances=[1.0, 1.0])
    >>> made.mean[0].tolist()
    [2.0, 2.0, 2.0, 2.0, 4.0, 4.0, 4.0, 4.0, 6.0, 6.0, 6.0, 6.0]
    >>> made.variance[0, [0, 5]].tolist()
    [1.0, 0.5]
    """
    shape = whole_pair(shape, "height", "width")
    check_shape(shape)
    if interpolation not in SUPPORT:
        raise ValueError(f"interpolation {interpolation!r}; known: {', '.join(SUPPORT)}")
    count = len(images)
    chosen = [1.0] * count if weights is None else weights
    noise = [None] * count if variances is None else variances
    if not count or {len(geometries), len(chosen), len(noise)} != {count}:
        raise ValueError(f"{count} pictures need as many geometries, weights and variances")
    sums: Doubles | None = None
    for image, geometry, weight, variance in zip(images, geometries, chosen, noise, strict=True):
        placed = geometry_of(geometry, shape, "corner", False)
        made = _Coadding(placed, shape, interpolation, axis, threads).added(image, weight, variance)
        if sums is not None and made.shape != sums.shape:
            raise ValueError(f"pictures of {sums.shape[1:]} and {made.shape[1:]} are not added")
        sums = made if sums is None else sums + made
    assert sums is not None
    total = np.where(sums[1] > 0.0, sums[1], np.nan)
    return Coadded(sums[0] / total, sums[1], None if variances is None else sums[2] / total**2)


class _Coadding(NamedTuple):
    """How a picture is put into the frame."""

    geometry: Geometry
    shape: tuple[int, int]
    interpolation: str
    axis: AnyAxis | None
    threads: int | None

    def added(self, image: Any, weight: Any, variance: Any) -> Doubles:
        """Return sums (2 or 3, h, w, ...) of a picture, of its weights, and of its variances."""
        picture = given_pictures(image, self.axis, kinds="biuf")
        picture.check_alone("each of the images")
        texels = _texels(picture.values)
        is_known = np.isfinite(texels)
        weight = _as_texels(weight, texels, "weights")
        drawn = [self.sums(np.where(is_known, texels, 0.0) * weight), self.sums(weight)]
        if variance is not None:
            noise = np.sqrt(_as_texels(variance, texels, "variances")) * weight
            drawn.append(self.squares(noise))
        made = np.stack(drawn)
        return made[..., 0] if picture.axis is None else made

    def sums(self, texels: Doubles) -> Doubles:
        """Return sums (h, w, C) of texels (H, W, C) times the shares of a pixel that they cover."""
        warped = warp(
            texels, self.geometry, self.shape, interpolation=self.interpolation, alpha="none",
            fill=PREMULTIPLIED, threads=self.threads, axis=-1,
        )  # fmt: skip
        return np.asarray(warped.image, np.float64)

    def squares(self, texels: Doubles) -> Doubles:
        """Return sums (h, w, C) of squared texels times squared shares.

        Texels that no pixel covers together are probed at once: their sum is one of them.
        """
        height, width, channels = texels.shape
        period = self._period((height, width))
        sign = np.random.default_rng(1).choice(
            [-1.0, 1.0], (height, width, 1)
        )  # if two are covered
        result = np.zeros((*self.shape, channels))
        for row in range(min(period, height)):
            probe = np.zeros((height, width, channels * period))
            for column in range(period):
                lattice = np.s_[row::period, column::period]
                own = slice(column * channels, (column + 1) * channels)
                probe[(*lattice, own)] = (texels * sign)[lattice]
            squared = self.sums(probe) ** 2
            result += squared.reshape(*self.shape, period, channels).sum(axis=2)
        return result

    def _period(self, size: tuple[int, int]) -> int:
        """Return the texels that a pixel covers along an axis, at most."""
        places = places_of(
            BackwardMap(*source_coordinates(self.geometry, self.shape, size)), self.shape
        )
        reach = np.nanmax(np.abs(places[2:4]) + np.abs(places[4:6]), initial=0.0)
        return min(LARGEST_PERIOD, math.ceil(float(reach)) + 1 + SUPPORT[self.interpolation])


def _texels(image: Any) -> Doubles:
    """Return a picture's values (H, W, C), not a number where they are masked."""
    values = np.ma.filled(np.ma.asarray(image).astype(np.float64), np.nan)
    return np.asarray(values.reshape(*values.shape[:2], -1))


def _as_texels(given: Any, texels: Doubles, name: str) -> Doubles:
    """Return weights or variances (H, W, C) of texels."""
    values = np.asarray(given, np.float64)
    if values.ndim == 2:
        values = values[..., None]
    try:
        values = np.broadcast_to(values, texels.shape)
    except ValueError:
        raise ValueError(f"{name} of {values.shape} do not fit {texels.shape}") from None
    if not (values >= 0.0)[np.isfinite(texels)].all() or np.isinf(values).any():
        raise ValueError(f"{name} are finite and 0 or more")
    return np.where(np.isfinite(texels), values, 0.0)
