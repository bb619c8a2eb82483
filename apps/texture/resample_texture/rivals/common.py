"""What rivals have in common: places of pixels in the source, and checks of what they are given."""

from typing import Any

import numpy as np

from resample.types import Doubles, Floats
from resample_texture.geometry.mappings import BackwardMap, ForwardMap, Geometry, source_coordinates
from resample_texture.types import Warped


def places_of(geometry: BackwardMap, shape: tuple[int, int]) -> Doubles:
    """Map (6, h, w): x, y, their change from column to column, and from row to row."""
    x, y = source_coordinates(geometry, shape)
    return np.stack([x, y, _step(x, 1), _step(y, 1), _step(x, 0), _step(y, 0)])


def _step(position: Doubles, axis: int) -> Doubles:
    """Change of a coordinate from pixel to pixel along an axis; 0 where no neighbour has one.

    It is the mean of the steps to both neighbours unless they disagree much: at the seam of a
    panorama or the edge of a fold the smaller one counts.
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


def finished(image: Floats, coverage: Floats) -> Warped:
    """Picture with its coverage brought into 0..1, both by the same factor.

    At a transparent edge, negative lobes of a kernel take the warp of ones out of that range.
    """
    if coverage.min() < 0.0 or coverage.max() > 1.0:
        bounded = coverage.clip(0.0, 1.0)
        scale = np.divide(bounded, coverage, out=np.zeros_like(bounded), where=coverage > 0.0)
        image, coverage = image * scale[..., None], bounded
    return Warped(np.ascontiguousarray(image), np.ascontiguousarray(coverage))


def refuse_forward_map(method: str, geometry: Geometry) -> None:
    """Refuse a map from the source, which looking up cannot follow."""
    if isinstance(geometry, ForwardMap):
        raise ValueError(f"{method} takes a matrix or a backward map; for forward maps use hybrid")


def check_count(name: str, count: Any, most: int) -> None:
    """Refuse what is no whole number from 1 to `most`."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise ValueError(f"{name} is a whole number from 1 to {most}, not {count}")


def check_name(name: str, given: str, known: tuple[str, ...]) -> None:
    """Refuse a name that is none of the known ones."""
    if given not in known:
        raise ValueError(f"unknown {name} {given!r}; known are {', '.join(known)}")
