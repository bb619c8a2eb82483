"""Tiles of the screen, each of whose sub-pixels sees a field along a ray."""

from typing import NamedTuple

import numpy as np

from resample.engine.canvas import Home, pixel_weights
from resample.engine.jit import Counter, inner_kernel, kernel, packed_kernel, tasks
from resample.engine.rays.marching import ray_at
from resample.engine.rays.seeing import NOTHING, Medium, Way, seen
from resample.types import Film, Floats, Indices, Tables, View

ALPHA, DEEP, FIRST, COVER, VALUE, PRESENCE = range(3, 9)
NUMBERS = 9  # of a sub-pixel


class Output(NamedTuple):
    """Picture that is painted, in tiles."""

    camera: View
    tables: Tables
    film: Film
    value: Floats  # (H, W) what projections measure; or (0, 0)
    is_sum: bool  # of values, which no presence weighs
    size: int  # px, side of a tile
    columns: int  # tiles in a row of them


@inner_kernel
def _cast(way: Way, medium: Medium, target: Output, home: Home, n: int, fine: Floats) -> None:
    """Let the sub-pixels (R, C, NUMBERS) of a tile see the field."""
    margin = target.tables.pixel_margin
    for row in range(fine.shape[0]):
        y = home.top - margin + (row + 0.5) / n
        for column in range(fine.shape[1]):
            x = home.left - margin + (column + 0.5) / n
            ray = ray_at(x, y, medium.space, target.camera)
            result = NOTHING
            if ray.steps > 0:
                result = seen(way, ray, medium)
            here = fine[row, column]
            here[0], here[1], here[2] = result[0], result[1], result[2]
            here[ALPHA], here[DEEP], here[FIRST] = result[3], result[4], result[5]
            here[COVER], here[VALUE], here[PRESENCE] = result[6], result[7], result[8]


@kernel
def _resolve(fine: Floats, n: int, weight: Floats, home: Home, target: Output) -> None:
    """Filter the sub-pixels of a tile to its pixels."""
    film, (height, width) = target.film, target.film.depth.shape
    beside = (weight.size - n) // 2  # sub-pixels read on either side of a pixel
    total = np.empty(NUMBERS, np.float32)
    for row in range(home.top, min(home.top + home.size, height)):
        for column in range(home.left, min(home.left + home.size, width)):
            total[:] = 0.0
            first, present = np.float32(np.inf), np.float32(0.0)
            for down in range(weight.size):
                for right in range(weight.size):
                    here = fine[(row - home.top) * n + down, (column - home.left) * n + right]
                    share = weight[down] * weight[right]
                    for number in range(NUMBERS):
                        if number not in (FIRST, VALUE):
                            total[number] += share * here[number]
                    of_value = share if target.is_sum else share * here[PRESENCE]
                    total[VALUE] += of_value * here[VALUE]
                    present += of_value
                    if beside <= down < beside + n and beside <= right < beside + n:
                        first = min(first, here[FIRST])
            alpha = total[ALPHA]
            for channel in range(3):
                film.rgba[row, column, channel] = max(np.float32(0.0), total[channel])
            film.rgba[row, column, 3] = min(np.float32(1.0), max(np.float32(0.0), alpha))
            if alpha > 0.0:
                film.depth[row, column] = total[DEEP] / alpha
            film.first_depth[row, column] = first
            film.coverage[row, column] = min(np.float32(1.0), max(np.float32(0.0), total[COVER]))
            if target.value.size and present > 0.0:
                target.value[row, column] = total[VALUE] / present


@kernel
def _paint(tile: int, n: int, way: Way, medium: Medium, target: Output) -> None:
    size, margin = target.size, target.tables.pixel_margin
    height, width = target.film.depth.shape
    home = Home(tile % target.columns * size, tile // target.columns * size, size, width, height)
    rows = (min(size, height - home.top) + 2 * margin) * n
    columns = (min(size, width - home.left) + 2 * margin) * n
    fine = np.empty((rows, columns, NUMBERS), np.float32)
    _cast(way, medium, target, home, n, fine)
    _resolve(fine, n, pixel_weights(target.tables, n), home, target)


@packed_kernel
def paint_rays(
    counter: Counter, turn: Indices, fineness: Indices, way: Way, medium: Medium, target: Output
) -> None:
    """Paint tiles.

    Parameters
    ----------
    turn
        (N,) numbers of tiles.
    fineness
        (T,) sub-pixels per side of a pixel of all tiles.
    way
        What rays see.
    medium
        What they go through.
    target
        Filled.
    """
    for task in tasks(counter, turn.size):
        tile = turn[task]
        _paint(tile, fineness[tile], way, medium, target)
