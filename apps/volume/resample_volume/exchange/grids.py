"""Convert uniform grids of yt: covering and arbitrary grids."""

from typing import Any

import numpy as np

from resample.words import one_line
from resample_volume.types import Volume


def of_grid(given: Any, part: Any, name: str) -> Volume:
    """Convert a field, whose values are at the centers of cells.

    Parameters
    ----------
    given
        It has `left_edge` and `right_edge` (3,), `ActiveDimensions` (3,), and fields (X, Y, Z) by
        name.
    """
    if not part:
        raise ValueError(
            f"{name}: name a field of the grid: part='density', or the pair (grid, 'density')"
        )
    try:
        values = np.asarray(given[part])
    except Exception as error:  # yt's own, of which one would have to import yt to know
        raise ValueError(f"{name}: no field {part!r:.60}: {one_line(error)}") from None
    shape = tuple(int(count) for count in np.asarray(given.ActiveDimensions))
    if values.shape != shape or len(shape) != 3:
        raise ValueError(f"{name}: field {part!r:.60} is {values.shape}, the grid is {shape}")
    low, high = (np.asarray(edge, np.float64) for edge in (given.left_edge, given.right_edge))
    spacing = (high - low) / shape
    return Volume(values.transpose(2, 1, 0), spacing, low + spacing / 2, np.eye(3), name)
