"""Resolution of a tile's sub-pixels, and the width of points on them."""

import math
from inspect import unwrap

import numpy as np

from resample.engine.jit import kernel
from resample.types import Single, Style

# Sub-pixels between the closest points of a tile, at most; measured (docs/quality.md)
POINT_SPACING = 0.6


@kernel
def grid(smallest: float, style: Style) -> int:
    """Sub-pixels per side of a pixel for a tile whose closest samples are `smallest` px apart.

    Fine enough that splats are at least a sub-pixel apart. Where that would be finer than splats
    are worth, these samples are points, and the grid is as fine as that allows.
    """
    # A fixed resolution, or an empty tile.
    if style.subpixels > 0:
        return style.subpixels
    if not smallest < np.inf:
        return 1
    # Splats need a sub-pixel each; points must not be farther apart than a share of one.
    spacing = max(smallest, 1e-6)
    for_splats = min(style.most_for_splats, math.ceil(1.0 / spacing))
    for_points = min(style.most_for_points, int(min(style.threshold, POINT_SPACING) / spacing))
    return max(1, for_splats, for_points)


def grid_of(smallest: Single, style: Style) -> int:
    """As `grid`, for Python: machine code does not pay for a single number."""
    return int(unwrap(grid)(float(smallest), style))


@kernel
def is_surely_point(spacing: Single, style: Style) -> bool:
    """Whether a sample is a point on the finest grid that a tile may have."""
    finest = style.subpixels
    if finest == 0:
        finest = max(style.most_for_splats, style.most_for_points)
    return bool(spacing * finest <= style.threshold)


@kernel
def point_width(spacing: Single, variance: float) -> Single:
    """Standard deviation of a point's filter: the kernel's projection and a sub-pixel's extent.

    `spacing` is in sub-pixels, `variance` in voxels².
    """
    # A box one sub-pixel wide has variance 1 / 12.
    return math.sqrt(variance * spacing * spacing + 1.0 / 12.0)
