"""Types of the application: edge modes, warped pictures, the role of a method.

Continuous pixel coordinates everywhere: the pixel in row i, column j covers [j, j + 1) × [i, i + 1)
and has its center at (j + 0.5, i + 0.5), in the source as in the target.
"""

from enum import StrEnum
from typing import Any, Literal, NamedTuple, Protocol, TypedDict

import numpy as np
from numpy.typing import DTypeLike, NDArray

from resample.cameras.models import AnyConvention
from resample.profiles.filters import PixelFilter
from resample.profiles.interpolation import Interpolation
from resample.showable import Showable, array_of
from resample.types import Floats
from resample_texture.geometry.mappings import Geometry, Size
from resample_texture.geometry.regions import AnyEdge, Edge

__all__ = ["AnyEdge", "Edge"]  # those from elsewhere


class Alpha(StrEnum):
    """Meaning of the fourth channel."""

    STRAIGHT = "straight"  # opacity; color is not multiplied by it
    PREMULTIPLIED = "premultiplied"
    NONE = "none"  # no opacity


AnyAlpha = Alpha | Literal["straight", "premultiplied", "none"]
AnyLight = bool | Literal["pixels"]  # stages filtered in linear light
AnyAxis = Literal[0, -1, 2]  # of frames, or of channels
FRAMES: Literal[0] = 0
Fill = complex | Literal["premultiplied"]  # value of pixels that nothing is known of


class _Warped(NamedTuple):
    """Fields of `Warped`."""

    image: NDArray[Any]  # (H, W) or (H, W, C) as the source
    coverage: Floats  # (H, W) share of the pixel filter's mass that the source fills, 0..1


class Warped(Showable, _Warped):
    """A warped picture, or a batch (N, ...) of them; its image is multiplied by the coverage.

    `np.asarray(warped)` is the image: values of the source's type.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp
    >>> picture = np.full((16, 16), 200, np.uint8)
    >>> warped = warp(picture, [[1, 0, 2.5], [0, 1, 0]], (16, 16), linear_light=False)
    >>> warped
    Warped(16 × 16 uint8, 87.5 % covered)
    >>> warped.image[8, 1:4].tolist(), warped.coverage[8, 1:4].tolist()
    ([0, 100, 200], [0.0, 0.5, 1.0])
    >>> warped.mean[8, 1:4].tolist()
    [nan, 200.0, 200.0]
    """

    __slots__ = ()

    is_preview = False  # whether fewer texels and pixels were used
    is_premultiplied = True  # whether the image is multiplied by the coverage

    def __array__(
        self, dtype: DTypeLike | None = None, *, copy: bool | None = None
    ) -> NDArray[Any]:
        """Return the image, also of measurements and batches."""
        return array_of(self.image, dtype, copy)

    @property
    def mean(self) -> NDArray[Any]:
        """Mean of the values that cover each pixel; NaN where none do.

        float32, or float64 if the picture's values do not fit into float32.
        """
        image = np.ma.getdata(self.image)
        coverage = self.coverage.reshape(
            self.coverage.shape + (1,) * (image.ndim - self.coverage.ndim)
        )
        empty = np.full(image.shape, np.nan, np.result_type(image.dtype, np.float32))
        np.divide(image, coverage, out=empty, where=coverage > 0.0)
        empty[np.ma.getmaskarray(self.image)] = np.nan
        return empty


class WarpedMeans(Warped):
    """Warped measurements: each pixel is the mean of the values that cover it, however little.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_texture import warp
    >>> warp(np.full((16, 16), 6.0), [[1, 0, 2.5], [0, 1, 0]], (16, 16)).image[8, 1:4].tolist()
    [nan, 6.0, 6.0]
    """

    __slots__ = ()

    is_premultiplied = False

    @property
    def mean(self) -> NDArray[Any]:
        """Mean of the values that cover each pixel; NaN where none do."""
        image = np.ma.getdata(self.image)
        mean = image.astype(np.result_type(image.dtype, np.float32))
        mean[self.coverage == 0.0] = np.nan
        mean[np.ma.getmaskarray(self.image)] = np.nan
        return mean


class Previewed(Warped):
    """A quick preview of a warped picture, made from fewer texels and pixels."""

    __slots__ = ()

    is_preview = True


class SamplingOptions(TypedDict, total=False):
    """Options of methods, as `warp` describes them: conversion of texels to pixels."""

    filter: PixelFilter | str | None  # pixel filter
    interpolation: Interpolation | str | None  # between texels
    quality: float | None  # parts per target px
    total: bool | None  # whether sums are preserved instead of means


class PlaceOptions(TypedDict, total=False):
    """Meaning of coordinates of a matrix or a function, as `warp` describes it."""

    convention: AnyConvention
    inverse: bool  # whether the matrix maps target to source


class StackOptions(TypedDict, total=False):
    """Meaning of an array's axes, as `warp` describes it."""

    axis: AnyAxis | None


class MissingOptions(TypedDict, total=False):
    """Values for missing data, as `warp` describes them."""

    nodata: complex | None
    fill: Fill | None


class ValueOptions(MissingOptions, total=False):
    """Meaning of a picture's values, as `warp` describes it."""

    linear_light: AnyLight | None
    alpha: AnyAlpha | None


class ResultOptions(TypedDict, total=False):
    """Target and options of a warp, as `warp` describes them."""

    roi: tuple[int, int, int, int] | None
    threads: int | None
    out: NDArray[Any] | None


class WarpOptions(
    SamplingOptions, PlaceOptions, StackOptions, ValueOptions, ResultOptions, total=False
):
    """Options of `warp` besides its method and edge mode."""


class ResizeOptions(SamplingOptions, StackOptions, MissingOptions, ResultOptions, total=False):
    """Options of `resize`, `scale` and `rotate` besides those in their signatures."""


class ProjectOptions(SamplingOptions, StackOptions, ValueOptions, total=False):
    """Options of `project`, as `warp` describes them."""

    method: "str | Method"
    threads: int | None


class PictureSceneOptions(PlaceOptions, MissingOptions, total=False):
    """Options of `PictureScene.render`, as `warp` describes them; `detail` is its `quality`."""

    filter: PixelFilter | str | None
    interpolation: Interpolation | str | None
    detail: float | None
    total: bool | None
    roi: tuple[int, int, int, int] | None
    threads: int | None


class Method(Protocol):
    """Role of a warping method.

    A plugin is a class; its constructor takes options by name and rejects bad ones with a
    `ValueError`.
    """

    def __call__(self, source: Floats, geometry: Geometry, shape: Size, edge: Edge) -> Warped:
        """Warp texels.

        Parameters
        ----------
        source
            (H, W, C) float32, C-contiguous, linear light, premultiplied if it has alpha.
        geometry
            Mapping between source and target.
        shape
            Height and width of the target, px.
        edge
            What lies beyond the source's edges.

        Returns
        -------
        `image` (height, width, C) float32, multiplied by `coverage` (height, width).

        Raises
        ------
        ValueError
            The method does not support this kind of geometry.
        """
