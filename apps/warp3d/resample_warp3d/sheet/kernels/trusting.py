"""Confidence of the depth that each pixel of a target is made from."""

import math

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.sheet.kernels.bridging import back_projected, on_lattice


@kernel
def _sample_row(
    nearness: Floats, back: Doubles, origin: Doubles, place: Doubles, trust: Floats, row: int,
    found: Floats,
) -> None:  # fmt: skip
    """Look up a row of confidences; see `sample_map`."""
    height, width = trust.shape
    for column in range(nearness.shape[1]):
        found[row, column] = 0
        # Skip empty pixels.
        near = float(nearness[row, column])
        if not near > 0.0:
            continue
        # Project the pixel back into the source; undo lens distortion.
        u, v = back_projected(back, origin, column + 0.5, row + 0.5, near)
        if not (abs(u) < 1e6 and abs(v) < 1e6):
            continue
        if place.size > 0:
            u, v = on_lattice(place, u, v)
        # Read the nearest sample.
        r, c = min(max(math.floor(v), 0), height - 1), min(max(math.floor(u), 0), width - 1)
        found[row, column] = trust[r, c]


@parallel_kernel
def sample_map(
    counter: Counter, nearness: Floats, back: Doubles, origin: Doubles, place: Doubles,
    trust: Floats, found: Floats,
) -> None:  # fmt: skip
    """Read a map of the source where pixels of the target project back to.

    Parameters
    ----------
    nearness
        (H, W) of the target; 0 where nothing is.
    back, origin
        Matrix and epipole of the warp back to the source.
    place
        As in `DepthImage`.
    trust
        (h, w) of the source.
    found
        (H, W) filled; 0 where nothing is.
    """
    for row in tasks(counter, nearness.shape[0]):
        _sample_row(nearness, back, origin, place, trust, row, found)
