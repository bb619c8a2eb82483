"""Texture filtering of graphics cards: mip mapping and anisotropic filtering."""

from dataclasses import dataclass

import numpy as np

from resample.types import Floats
from resample_texture.baselines.common import check_count, refuse_forward_map
from resample_texture.geometry.mappings import BackwardMap, Geometry, Homography, places_of
from resample_texture.texels.pyramid import pyramid
from resample_texture.types import Edge, Warped


@dataclass(frozen=True)
class Mipmap:
    """Trilinear mip mapping; the level follows from the pixel's longest side in the source.

    With the transparent edge mode every level is transparent outside the source.
    """

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("mipmap", geometry)
        return _through_pyramid(source, geometry, shape, edge, 1)


@dataclass(frozen=True)
class Anisotropic:
    """Anisotropic filtering as on graphics cards, with up to `taps` samples per pixel.

    With the transparent edge mode every level is transparent outside the source.
    """

    taps: int = 16

    def __post_init__(self) -> None:
        check_count("taps", self.taps, 32)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        refuse_forward_map("anisotropic", geometry)
        return _through_pyramid(source, geometry, shape, edge, self.taps)


def _through_pyramid(
    source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge, taps: int
) -> Warped:
    """Sample a pyramid with up to `taps` taps per pixel."""
    from resample_texture.baselines.kernels.anisotropic import (
        ByMap,
        ByMatrix,
        MipPyramid,
        Reading,
        TapPicture,
        read,
    )

    means = MipPyramid(*pyramid(source))
    picture = TapPicture(
        np.zeros((*shape, source.shape[2]), np.float32), np.zeros(shape, np.float32)
    )
    reading = Reading(taps, list(Edge).index(edge))
    if isinstance(geometry, Homography):
        inverse = np.linalg.inv(geometry.oriented(source.shape[:2])).astype(np.float64)
        read(means, ByMatrix(inverse), reading, picture)
    elif isinstance(geometry, BackwardMap):
        read(means, ByMap(places_of(geometry, shape)), reading, picture)
    return Warped(picture.image, picture.coverage)
