"""Enlarge depth maps to the size of the picture, surface by surface."""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links


@kernel
def _step(nearness: Floats, links: Links, row: int, column: int, away: float, down: bool) -> float:
    """Change of nearness at a distance from a sample along an axis, on its surface."""
    ahead, back = (DOWN, UP) if down else (RIGHT, LEFT)
    dr, dc = (1, 0) if down else (0, 1)
    if away < 0:
        ahead, back, dr, dc = back, ahead, -dr, -dc
    # Interpolate to the linked neighbour, or extrapolate from the one behind.
    here = np.float64(nearness[row, column])
    if links[row, column] & ahead:
        return float(abs(away) * (nearness[row + dr, column + dc] - here))
    if links[row, column] & back:
        return float(abs(away) * (here - nearness[row - dr, column - dc]))
    return 0.0


@kernel
def _enlarge_row(nearness: Floats, links: Links, scale: Doubles, row: int, result: Floats) -> None:
    """Enlarge a row; see `enlarge_rows`."""
    height, width = nearness.shape
    # Find the nearest sample of the small map.
    y = (row + 0.5) * scale[0] - scale[1]
    r = min(max(math.floor(y + 0.5), 0), height - 1)
    for column in range(result.shape[1]):
        x = (column + 0.5) * scale[2] - scale[3]
        c = min(max(math.floor(x + 0.5), 0), width - 1)
        here = np.float64(nearness[r, c])
        value = 0.0
        # Follow its surface along both axes; a limit keeps nearness positive.
        if here > 0.0:
            value = here + _step(nearness, links, r, c, x - c, False)
            value = max(value + _step(nearness, links, r, c, y - r, True), 0.3 * here)
        result[row, column] = np.float32(value)


@parallel_kernel
def enlarge_rows(
    counter: Counter, nearness: Floats, links: Links, scale: Doubles, result: Floats
) -> None:
    """Interpolate between linked samples, and extrapolate those without a link.

    `nearness`, `links`: (h, w) of the small map. `scale`: (4,) the small map's rows per row of the
    result, the center of its first row in its own rows, and the same of columns. `result`: (H, W)
    filled; 0 where nothing is known.
    """
    for row in tasks(counter, result.shape[0]):
        _enlarge_row(nearness, links, scale, row, result)
