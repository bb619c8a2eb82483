"""Sub-pixels that points are spread over, and by which weights."""

import math
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import unit_lookup
from resample.types import Floats, Single

MOST_TAPS = 64  # sub-pixels; wider filters are narrowed to it


@kernel
def _weigh(
    center: Single, reach: Single, per_reach: Single, profile: Floats, weight: Floats
) -> tuple[int, int]:
    """Weights with sum 1 of the sub-pixels around `center`; gives the first one and their count."""
    first = math.floor(center - reach + 0.5)
    count = min(math.floor(center + reach - 0.5) - first + 1, weight.size)
    offset = np.float32(first + 0.5 - center)
    total = np.float32(0.0)
    for tap in range(count):
        weight[tap] = unit_lookup(profile, abs(offset + np.float32(tap)) * per_reach)
        total += weight[tap]
    if count < 1 or total == np.float32(0.0):  # a filter between two centers of sub-pixels
        first, count = math.floor(center), 1
        weight[0] = total = np.float32(1.0)
    share = np.float32(1.0) / total
    for tap in range(count):
        weight[tap] *= share
    return first, count


class Box(NamedTuple):
    """Sub-pixels that a point is spread over, and where its weights begin."""

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
) -> Box:
    """Weights of a filter around a place, in `across` and `down`, and what they meet.

    All in sub-pixels, of which there are `size` rows and columns.
    """
    reach = min(reach, 0.5 * (MOST_TAPS - 2))
    per_reach = np.float32(1.0 / reach)
    left, columns = _weigh(x, reach, per_reach, profile, across)
    top, rows = _weigh(y, reach, per_reach, profile, down)
    return Box(
        max(0, top),
        min(size[0], top + rows),
        max(0, left),
        min(size[1], left + columns),
        top,
        left,
    )
