"""How fine the sub-pixels of a tile are, and how wide points are on them."""

import math
from inspect import unwrap

import numpy as np

from resample.engine.jit import kernel
from resample.types import Single, Style

# Sub-pixels between the closest points of a tile, at most; measured (docs/quality.md).
POINT_SPACING = 0.6


@kernel
def grid(smallest: float, style: Style) -> int:
    """Sub-pixels per side of a pixel for a tile whose closest samples are `smallest` px apart.

    Fine enough that splats are at least a sub-pixel apart; where that would be finer than splats
    are worth, as fine as leaves these samples points.
    """
    if style.subpixels > 0:
        return style.subpixels
    if not smallest < np.inf:
        return 1
    spacing = max(smallest, 1e-6)
    for_splats = min(style.most_for_splats, math.ceil(1.0 / spacing))
    for_points = min(style.most_for_points, int(min(style.threshold, POINT_SPACING) / spacing))
    return max(1, for_splats, for_points)


def grid_of(smallest: Single, style: Style) -> int:
    """As `grid`, for Python: a single number is not worth machine code."""
    return int(unwrap(grid)(float(smallest), style))


@kernel
def is_surely_point(spacing: Single, style: Style) -> bool:
    """Whether a sample is a point on the finest grid that a tile may get."""
    finest = style.subpixels
    if finest == 0:
        finest = max(style.most_for_splats, style.most_for_points)
    return bool(spacing * finest <= style.threshold)


@kernel
def point_width(spacing: Single, variance: float) -> Single:
    """Standard deviation of a point's filter: the kernel's projection and a sub-pixel's extent.

    `spacing` is in sub-pixels, `variance` in voxels²; 0 stands for a filter of fixed width 1.
    """
    if variance == 0.0:
        return 1.0
    return math.sqrt(variance * spacing * spacing + 1.0 / 12.0)
