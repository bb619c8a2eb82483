"""Sub-pixels of a tile: where it lies, and the filter of its pixels."""

from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import radial
from resample.types import Floats, Tables


class Home(NamedTuple):
    """A tile and the frame it belongs to, px."""

    left: int
    top: int
    size: int
    width: int
    height: int


@kernel
def pixel_weights(tables: Tables, n: int) -> Floats:
    """Weights, with sum 1, of the sub-pixels along one axis that a pixel's filter covers."""
    margin = tables.pixel_margin
    weight, total = np.zeros((2 * margin + 1) * n, np.float32), np.float32(0.0)
    # Evaluate the filter at the sub-pixels' centers, then normalize.
    for tap in range(weight.size):
        distance = abs((tap + 0.5) / n - margin - 0.5)
        weight[tap] = radial(tables.pixel, tables.pixel_extent, distance)
        total += weight[tap]
    for tap in range(weight.size):
        weight[tap] /= total
    return weight
