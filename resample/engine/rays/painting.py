"""Tiles of the screen, each of whose sub-pixels sees a field along a ray."""

from typing import NamedTuple

import numpy as np

from resample.engine.canvas import Home, pixel_weights
from resample.engine.jit import Counter, inner_kernel, kernel, packed_kernel, tasks
from resample.engine.rays.meshes import is_on_mesh, seen_with_mesh
from resample.engine.rays.seeing import Medium, Way
from resample.types import Film, Floats, Indices, Tables, View

ALPHA, DEEP, FIRST, COVER, VALUE, PRESENCE = range(3, 9)
NUMBERS = 9  # of a sub-pixel
ALIKE, ALIKE_OF = 0.002, 0.03  # by how much colors may differ that are taken for alike
ORDER = (0, 2, 1)  # how many of a sub-pixel's row and column are odd, turn by turn

Around = tuple[int, int, int, int, int, int, int, int]  # rows and columns of four sub-pixels


class Output(NamedTuple):
    """Picture that is painted, in tiles."""

    camera: View
    tables: Tables
    film: Film
    value: Floats  # (H, W) what projections measure; or (0, 0)
    is_sum: bool  # of values, which no presence weighs
    coarse: float  # data units by which values may differ that are taken for alike
    is_sparing: bool  # sub-pixels between ones that are alike are not looked at
    size: int  # px, side of a tile
    columns: int  # tiles in a row of them


@inner_kernel
def _point(output: Output, home: Home, n: int, row: int, column: int) -> tuple[float, float]:
    """Where the ray of a sub-pixel goes through the screen, px."""
    margin = output.tables.pixel_margin
    return home.left - margin + (column + 0.5) / n, home.top - margin + (row + 0.5) / n


@inner_kernel
def _cast(
    way: Way, medium: Medium, output: Output, home: Home, n: int, row: int, column: int,
    here: Floats,
) -> None:  # fmt: skip
    """Let a sub-pixel see the field."""
    x, y = _point(output, home, n, row, column)
    result = seen_with_mesh(x, y, way, medium, output.camera)
    here[0], here[1], here[2] = result[0], result[1], result[2]
    here[ALPHA], here[DEEP], here[FIRST] = result[3], result[4], result[5]
    here[COVER], here[VALUE], here[PRESENCE] = result[6], result[7], result[8]


@inner_kernel
def _are_alike(fine: Floats, around: Around, coarse: float) -> bool:
    """Whether four sub-pixels see nearly the same."""
    one, two = fine[around[0], around[1]], fine[around[2], around[3]]
    three, four = fine[around[4], around[5]], fine[around[6], around[7]]
    for number in (0, 1, 2, ALPHA, VALUE, PRESENCE):
        a, b, c, d = one[number], two[number], three[number], four[number]
        most, least = max(a, b, c, d), min(a, b, c, d)
        slack = coarse if number == VALUE else ALIKE + ALIKE_OF * abs(most)
        if not most - least <= slack:
            return False
    return True


@inner_kernel
def _between(fine: Floats, around: Around, here: Floats) -> None:
    """Mean of four sub-pixels."""
    one, two = fine[around[0], around[1]], fine[around[2], around[3]]
    three, four = fine[around[4], around[5]], fine[around[6], around[7]]
    quarter = np.float32(0.25)
    for number in range(NUMBERS):
        here[number] = quarter * (one[number] + two[number] + three[number] + four[number])
    here[FIRST] = min(one[FIRST], two[FIRST], three[FIRST], four[FIRST])


@inner_kernel
def _look(way: Way, medium: Medium, output: Output, home: Home, n: int, fine: Floats) -> None:
    """Let the sub-pixels (R, C, NUMBERS) of a tile see the field.

    If sparing, every second one in every second row does. Then those in the middle of four, and
    last those between them, do where these four are not alike.
    """
    rows, columns, _ = fine.shape
    is_sparing = output.is_sparing and n > 1
    for turn in range(3 if is_sparing else 1):
        for row in range(rows):
            for column in range(columns):
                odd = (row & 1) + (column & 1)
                if is_sparing and odd != ORDER[turn]:
                    continue
                here = fine[row, column]
                is_inside = 0 < row < rows - 1 and 0 < column < columns - 1
                if turn > 0 and is_inside:
                    around = (row - 1, column, row, column - 1, row, column + 1, row + 1, column)
                    if turn == 1:
                        around = (
                            row - 1, column - 1, row - 1, column + 1,
                            row + 1, column - 1, row + 1, column + 1,
                        )  # fmt: skip
                    x, y = _point(output, home, n, row, column)
                    is_alone = not is_on_mesh(x, y, medium.mesh, output.camera)
                    if is_alone and _are_alike(fine, around, output.coarse):
                        _between(fine, around, here)
                        continue
                _cast(way, medium, output, home, n, row, column, here)


@kernel
def _resolve(fine: Floats, n: int, weight: Floats, home: Home, output: Output) -> None:
    """Filter the sub-pixels of a tile to its pixels."""
    film, (height, width) = output.film, output.film.depth.shape
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
                    of_value = share if output.is_sum else share * here[PRESENCE]
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
            if output.value.size and present > 0.0:
                output.value[row, column] = total[VALUE] / present


@kernel
def _paint(tile: int, n: int, way: Way, medium: Medium, output: Output) -> None:
    size, margin = output.size, output.tables.pixel_margin
    height, width = output.film.depth.shape
    home = Home(tile % output.columns * size, tile // output.columns * size, size, width, height)
    rows = (min(size, height - home.top) + 2 * margin) * n
    columns = (min(size, width - home.left) + 2 * margin) * n
    fine = np.empty((rows, columns, NUMBERS), np.float32)
    _look(way, medium, output, home, n, fine)
    _resolve(fine, n, pixel_weights(output.tables, n), home, output)


@packed_kernel
def paint_rays(
    counter: Counter, turn: Indices, fineness: Indices, way: Way, medium: Medium, output: Output
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
    output
        Filled.
    """
    for task in tasks(counter, turn.size):
        tile = turn[task]
        _paint(tile, fineness[tile], way, medium, output)
