"""Deprecated: the index correction is in `resample.hybrid.correction`."""

import warnings

import numpy as np

from resample.hybrid.correction import LARGEST
from resample.hybrid.correction import true_distance as _true_distance
from resample.types import Doubles, Floats


def true_distance(index: Doubles, cone: Doubles) -> Doubles:
    """Return `resample.hybrid.correction.true_distance`."""
    _warn("true_distance")
    return _true_distance(index, cone)


def correction_table(cones: int = 64, indices: int = 256) -> Floats:
    """Return a table of d over the cone's angle (rows, 0 to 15°) and i (columns, 0 to 1)."""
    _warn("correction_table")
    cone = np.maximum(np.linspace(0.0, LARGEST, cones), 1e-6)[:, None]
    return _true_distance(np.linspace(0.0, 1.0, indices)[None, :], cone).astype(np.float32)


def _warn(name: str) -> None:
    warnings.warn(
        f"resample.profiles.correction.{name} has moved to resample.hybrid.correction",
        DeprecationWarning,
        stacklevel=3,
    )
