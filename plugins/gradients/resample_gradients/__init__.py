"""Differentiable warps, with gradients by the picture and by the matrix or map."""

from typing import TYPE_CHECKING

from resample.lazy import attributes

if TYPE_CHECKING:
    from resample_gradients.places import MapPlaces, MatrixPlaces
    from resample_gradients.warping import LinearWarp

_HOMES = {"LinearWarp": "warping", "MapPlaces": "places", "MatrixPlaces": "places"}

__all__ = ["LinearWarp", "MapPlaces", "MatrixPlaces"]

__getattr__ = attributes(__name__, _HOMES)
