"""Shared by the baselines: limit coverages, check parameters."""

from typing import Any

import numpy as np

from resample.types import Floats
from resample_texture.geometry.mappings import ForwardMap, Geometry
from resample_texture.types import Warped


def finished(image: Floats, coverage: Floats) -> Warped:
    """Limit the coverage to 0..1, and scale the picture by the same factor.

    At a transparent edge, negative lobes of a kernel take the warp of ones out of that range.
    """
    if coverage.min() < 0.0 or coverage.max() > 1.0:
        bounded = coverage.clip(0.0, 1.0)
        scale = np.divide(bounded, coverage, out=np.zeros_like(bounded), where=coverage > 0.0)
        image, coverage = image * scale[..., None], bounded
    return Warped(np.ascontiguousarray(image), np.ascontiguousarray(coverage))


def refuse_forward_map(method: str, geometry: Geometry) -> None:
    """Reject a forward map, which a gathering method cannot use."""
    if isinstance(geometry, ForwardMap):
        raise ValueError(f"{method} takes a matrix or a backward map; for forward maps use hybrid")


def check_count(name: str, count: Any, most: int) -> None:
    """Reject anything but a whole number from 1 to `most`."""
    if isinstance(count, bool) or not isinstance(count, int) or not 1 <= count <= most:
        raise ValueError(f"{name} is a whole number from 1 to {most}, not {count}")


def check_name(name: str, given: str, known: tuple[str, ...]) -> None:
    """Reject an unknown name."""
    if given not in known:
        raise ValueError(f"unknown {name} {given!r}; known are {', '.join(known)}")
