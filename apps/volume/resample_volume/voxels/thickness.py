"""Fields of two values whose thin parts are as thick as their voxels.

A cubic spline through samples of two values crosses the middle between them where voxels of both
kinds touch, but it is 1.16 voxels wide across a wall of one voxel, and 1.22 where it overshoots at
the wall's edges. So voxels that differ from both neighbours along an axis get other values.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.memory.mapped import array_like
from resample.painting.splines import FIELD
from resample.types import Doubles, Flags

# Value, from 0 to 1, of the higher kind by the number of axes along which a voxel is thin: of
# solids, walls (a large one is 1.0 wide seen edge on, 0.9 along one ray), lines (their cross
# section is 1) and points (their volume is 1). That of the lower kind is 1 minus it.
VALUES = (1.0, 0.75, 0.95, 1.1)


class Levels(NamedTuple):
    """Samples of a field in 8 bits, and what they mean."""

    level: Flags  # (Z, Y, X)
    zero: float  # data units of level 0
    scale: float  # data units


def with_true_thickness(values: NDArray[np.generic], two: Doubles) -> Levels:
    """Samples whose spline is as thick as the voxels of the higher of two values.

    `values`: (Z, Y, X). `two`: ascending, all that there are.
    """
    zero = 1.0 - max(VALUES)
    scale = (max(VALUES) - zero) / np.iinfo(np.uint8).max
    fraction = np.array([1.0 - np.array(VALUES), VALUES])
    table = np.rint((fraction - zero) / scale).astype(np.uint8)
    level = array_like(values, values.shape, np.uint8, FIELD)
    before = here = values[0] == two[1]
    for z in range(len(values)):
        behind = values[z + 1] == two[1] if z + 1 < len(values) else here
        thin = ((here != before) & (here != behind)).astype(np.uint8)
        for axis in (0, 1):
            thin += _is_thin(here, axis)
        level[z] = table[here.view(np.uint8), thin]
        before, here = here, behind
    span = float(two[1] - two[0])
    return Levels(level, float(two[0]) + zero * span, scale * span)


def _is_thin(plane: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """Which of a plane differ from both neighbours along an axis; at its ends none do."""
    line, thin = np.moveaxis(plane, axis, 0), np.zeros(plane.shape, bool)
    differs = line[1:] != line[:-1]
    np.moveaxis(thin, axis, 0)[1:-1] = differs[1:] & differs[:-1]
    return thin
