"""Weights of the sub-pixels that a point is spread over."""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import unit_lookup
from resample.types import Floats, Single

MOST_TAPS = 64  # sub-pixels per axis; wider filters are narrowed to it


@kernel
def _weigh(
    center: Single, reach: Single, per_reach: Single, profile: Floats, weight: Floats
) -> tuple[int, int]:
    """Weights, with sum 1, of the sub-pixels around `center`; return the first, and their count."""
    # First sub-pixel whose center the filter reaches, and how many there are.
    first = math.floor(center - reach + 0.5)
    count = min(math.floor(center + reach - 0.5) - first + 1, weight.size)
    offset = np.float32(first + 0.5 - center)
    total = np.float32(0.0)
    # Evaluate the filter at their centers.
    for tap in range(count):
        weight[tap] = unit_lookup(profile, abs(offset + np.float32(tap)) * per_reach)
        total += weight[tap]
    # A filter that misses all centers goes to the sub-pixel that it lies in.
    if count < 1 or total == np.float32(0.0):
        first, count = math.floor(center), 1
        weight[0] = total = np.float32(1.0)
    # Normalize.
    share = np.float32(1.0) / total
    for tap in range(count):
        weight[tap] *= share
    return first, count


class SpreadBox(NamedTuple):
    """Sub-pixels that a point is spread over, and the indices of its first weights."""

    top: int
    bottom: int
    left: int
    right: int
    first_row: int
    first_column: int


@kernel
def box_around(
    size: tuple[int, int],
    x: float,
    y: float,
    reach: float,
    profile: Floats,
    across: Floats,
    down: Floats,
) -> SpreadBox:
    """Compute the weights of a filter around a position, in `across` and `down`, and its box.

    All in sub-pixels, of which there are `size` rows and columns.
    """
    # Narrow filters that are wider than the scratch.
    reach = min(reach, 0.5 * (MOST_TAPS - 2))
    per_reach = np.float32(1.0 / reach)
    left, columns = _weigh(x, reach, per_reach, profile, across)
    top, rows = _weigh(y, reach, per_reach, profile, down)
    # Clip the box to the canvas; the weights are those of the whole filter.
    return SpreadBox(
        max(0, top),
        min(size[0], top + rows),
        max(0, left),
        min(size[1], left + columns),
        top,
        left,
    )
