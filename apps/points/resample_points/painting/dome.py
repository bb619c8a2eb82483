"""Eye-dome lighting: darken what lies behind the edges of a depth picture.

After Boucheny, "Interactive scientific visualization of large datasets: towards a perceptive-based
approach" (2009). A pixel is compared with pairs of neighbours on opposite sides, so that slopes
stay as bright as they are.
"""

import math

import numpy as np

from resample.types import Floats

PAIRS = ((0, 1), (1, 1), (1, 0), (1, -1))  # rows and columns to one neighbour of each pair
SCALES = (1, 2)  # of the distance to neighbours
REACH = 1 / 500  # of the picture's height: distance to the nearest of them
GAIN = 300.0  # from the change of log₂ depth to the exponent of darkening


def eye_dome(depth: Floats, strength: float, *, extent: float | None = None) -> Floats:
    """Return the share of light (H, W) that stays at each pixel.

    Parameters
    ----------
    depth
        (H, W) scene units; inf where nothing is.
    strength
        Of the darkening; 1 is usual.
    extent
        Height of a parallel camera's picture, scene units, to which differences of depth are
        compared; None: the camera is perspective, and ratios of depths count.
    """
    known = np.isfinite(depth)
    if not known.any():
        return np.ones_like(depth)
    # What is linear on planes: minus the depth, or the nearness.
    if extent is not None:
        near = np.where(known, -depth / np.float32(extent), np.float32(np.nan))
    else:
        near = np.where(known, 1 / np.maximum(depth, np.float32(1e-30)), np.float32(np.nan))
    step, total = max(1, math.ceil(REACH * len(depth))), np.zeros_like(depth)
    for scale in SCALES:
        for row, column in PAIRS:
            shift = row * step * scale, column * step * scale
            pair = 0.5 * (_moved(near, shift) + _moved(near, (-shift[0], -shift[1])))
            with np.errstate(invalid="ignore", divide="ignore"):
                drop = pair - near if extent is not None else np.log2(pair / near)
            total += np.maximum(np.where(np.isfinite(drop), drop, np.float32(0)), np.float32(0))
    mean = total / (len(SCALES) * len(PAIRS))
    light: Floats = np.exp(-GAIN * strength * mean).astype(np.float32)
    return light


def _moved(near: Floats, shift: tuple[int, int]) -> Floats:
    """Return the picture whose pixels are those a shift away; NaN beyond its edges."""
    height, width = near.shape
    row, column = shift
    moved = np.full_like(near, np.nan)
    to = [
        slice(max(0, -part), size - max(0, part)) for part, size in ((row, height), (column, width))
    ]
    of = [
        slice(max(0, part), size + min(0, part)) for part, size in ((row, height), (column, width))
    ]
    if all(part.start < part.stop for part in to):
        moved[to[0], to[1]] = near[of[0], of[1]]
    return moved
