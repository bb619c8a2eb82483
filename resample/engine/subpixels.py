"""Sub-pixels of a tile: how many, how wide points are on them, their layout, and their filter."""

import math
from inspect import unwrap
from typing import NamedTuple

import numpy as np

from resample.engine.jit import kernel
from resample.engine.lookup import radial
from resample.types import Floats, Place, Single, Stage, Style, Tables, Tiles

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


@kernel
def laid_out(tile: int, tiles: Tiles, stage: Stage) -> tuple[Home, Place, int, int]:
    """A tile's place in the frame, its canvas, and the canvas' rows and columns of sub-pixels."""
    # Look up the grid of the tile.
    subpixels, size = grid(tiles.spacing[tile], stage.style), tiles.size
    screen, margin = stage.screen, stage.tables.pixel_margin
    left, top = tile % tiles.columns * size, tile // tiles.columns * size
    home = Home(left, top, size, screen.width, screen.height)
    place = Place(float(left - margin), float(top - margin), subpixels)
    # Leave out what lies beyond the frame's edge: nothing may ever cover it.
    rows = (min(size, screen.height - top) + 2 * margin) * subpixels
    columns = (min(size, screen.width - left) + 2 * margin) * subpixels
    return home, place, rows, columns
