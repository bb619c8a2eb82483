"""The sub-pixels of a tile: their layout, and the weights that filter them to pixels."""

from typing import NamedTuple

import numpy as np

from resample.engine.grid import grid
from resample.engine.jit import kernel
from resample.engine.lookup import radial
from resample.types import Floats, Place, Stage, Tables, Tiles


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
