"""Source coordinates of a backward map's pixels, and their derivatives."""

import numpy as np

from resample.types import Doubles
from resample_texture.geometry.mappings import BackwardMap, source_coordinates


def places_of(geometry: BackwardMap, shape: tuple[int, int]) -> Doubles:
    """Return (6, h, w): x, y, their change per column, and their change per row."""
    x, y = source_coordinates(geometry, shape)
    return np.stack([x, y, _step(x, 1), _step(y, 1), _step(x, 0), _step(y, 0)])


def _step(position: Doubles, axis: int) -> Doubles:
    """Return a coordinate's change per pixel along an axis; 0 without valid neighbours.

    It is the mean of the steps to both neighbours, unless they differ much: at the seam of a
    panorama or the edge of a fold the smaller step counts.
    """
    step = np.diff(position, axis=axis)
    none = np.full_like(position.take([0], axis), np.nan)
    before, after = np.concatenate([none, step], axis), np.concatenate([step, none], axis)
    before, after = (
        np.where(np.isnan(before), after, before),
        np.where(np.isnan(after), before, after),
    )
    smaller = np.where(abs(before) < abs(after), before, after)
    is_smooth = abs(before - after) <= 1.0 + abs(smaller)
    return np.nan_to_num(np.where(is_smooth, (before + after) / 2, smaller))
