"""Profiles of color across the edges of a depth map."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import kernel
from resample.types import Doubles, Floats
from resample_warp3d.depth.refining.kernels.ramps import UP

REACH = 6  # px on each side of an edge


@kernel
def _change(color: Floats, row: int, column: int, down: bool) -> float:
    """Absolute change of color from a sample to the next, all channels added up."""
    dr, dc = (1, 0) if down else (0, 1)
    total = 0.0
    for n in range(color.shape[2]):
        total += abs(np.float64(color[row + dr, column + dc, n]) - color[row, column, n])
    return total


@kernel
def profile_edges(color: Floats, mark: NDArray[np.uint8], profile: Doubles, count: Doubles) -> None:
    """Add up the changes of color beside edges of a single step.

    Parameters
    ----------
    color
        (H, W, C).
    mark
        (H, W, 2) of `ramps.mark_edges`.
    profile
        (4, 2 REACH + 1) added to: changes from the far side to the near one; the edge itself is in
        the middle. Edges with the near side at the right, left, below and above.
    count
        (4,) edges, added to.
    """
    for row in range(mark.shape[0]):
        for column in range(mark.shape[1]):
            for axis in range(2):
                kind = mark[row, column, axis]
                at, size = (column, mark.shape[1]) if axis == 0 else (row, mark.shape[0])
                # Skip steps that are no edge, and edges near the frame's border.
                if kind == 0 or at < REACH or at + REACH + 1 >= size:
                    continue
                # Read the changes from the far side to the near one.
                which, sign = 2 * axis + (0 if kind == UP else 1), 1 if kind == UP else -1
                for n in range(-REACH, REACH + 1):
                    r, c = (row, column + sign * n) if axis == 0 else (row + sign * n, column)
                    profile[which, n + REACH] += _change(color, r, c, axis == 1)
                count[which] += 1.0
