"""The method that copies texels and mixes none, for labels (plugins: group `methods`)."""

from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from resample.types import Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry, source_coordinates
from resample_texture.geometry.regions import Picks, nearest_texels
from resample_texture.types import Edge, Warped


@dataclass(frozen=True)
class NearestTexel:
    """The texel at each pixel's center; aliases where texels shrink."""

    def picks(
        self, image: NDArray[Any], geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Picks:
        if isinstance(geometry, ForwardMap):
            raise ValueError(
                "nearest takes a matrix or a backward map; for forward maps use hybrid"
            )
        source_shape = image.shape[0], image.shape[1]
        x, y = source_coordinates(geometry, shape, source_shape)
        return nearest_texels(x, y, source_shape, edge)

    def __call__(
        self, source: Floats, geometry: Geometry, shape: tuple[int, int], edge: Edge
    ) -> Warped:
        picks = self.picks(source, geometry, shape, edge)
        return Warped(picks.of(source) * picks.coverage[..., None], picks.coverage)
