"""Paint tiles step by step: what they are by now is kept until more samples are at hand.

Samples are composited from the nearest on, so a tile may stop and go on later: before any splat
that is composited by itself, between two sheets, or between two slabs. Each step paints those
samples whose keys lie within its limits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.canvas import laid_out
from resample.engine.ellipsoids.rows import (
    ALPHA,
    BLUE,
    DEPTH,
    FIRST,
    GREEN,
    RED,
    WEIGHT,
    Groups,
    close_rows,
    index_of,
)
from resample.engine.jit import kernel
from resample.engine.sorting import HALF, Pairs, bits_of
from resample.types import Floats, Indices, Single, Stage, Tiles

KEPT = (RED, GREEN, BLUE, ALPHA, DEPTH, WEIGHT, FIRST)  # numbers of a sub-pixel
NEW, OPEN, OPAQUE = 0, 1, 2  # what a tile is by now


class Step(NamedTuple):
    """Which samples a step paints, by their keys; layers are composited in the steps they end in.

    Slabs that cut splats are left open behind the last one that is composited. Who has part in them
    is added once more in the next step, as what they sum is not kept.
    """

    again: Single  # least key of samples that are added once more
    first: Single  # least key of those that are painted
    last: Single  # key of those that are not any more
    done: int  # number of the first sheet or slab that was not composited before
    due: int  # number of the first one that is not composited now


class Carried(NamedTuple):
    """What tiles keep from step to step, and which samples a step paints."""

    number: Floats  # (each S,) of S sub-pixels, tile after tile
    each: int  # numbers of a sub-pixel: KEPT, and what slabs keep besides
    start: Indices  # (T + 1,) sub-pixels before those of a tile
    state: NDArray[np.uint8]  # (T,) NEW, OPEN or OPAQUE
    is_open: NDArray[np.bool_]  # (T, S, S) pixels of tiles of S px, which something may still reach
    step: Step


AT_ONCE = Carried(  # painted in one go, from which nothing is kept
    np.zeros(0, np.float32),
    0,
    np.zeros(0, np.int64),
    np.zeros(0, np.uint8),
    np.zeros((0, 0, 0), np.bool_),
    Step(np.float32(0.0), np.float32(0.0), np.float32(0.0), 0, 0),
)


@kernel
def in_steps(carried: Carried) -> bool:
    """Whether tiles are painted step by step."""
    return bool(carried.state.size > 0)


@kernel
def count_subpixels(tiles: Tiles, stage: Stage, shown: NDArray[np.bool_], count: Indices) -> None:
    """Sub-pixels of the canvas of each tile (T,) that is shown."""
    for tile in range(count.size):
        _, _, height, width = laid_out(tile, tiles, stage)
        count[tile] = height * width if shown[tile] else 0


@kernel
def take_up(rows: Floats, height: int, width: int, tile: int, carried: Carried) -> None:
    """Put sub-pixels that were kept into rows that are new."""
    if in_steps(carried) and carried.state[tile] != NEW:
        place = carried.each * carried.start[tile]
        for row in range(height):
            for column in range(width):
                k = index_of(row, column)
                for n, name in enumerate(KEPT):
                    rows[k + name] = carried.number[place + n]
                place += len(KEPT)


@kernel
def go_on(
    rows: Floats,
    open_groups: Groups,
    size: tuple[int, int],
    opaque: Single,
    tile: int,
    carried: Carried,
) -> None:
    """Put sub-pixels that were kept into rows that are new, and close groups that are opaque."""
    if in_steps(carried):
        take_up(rows, size[0], size[1], tile, carried)
        close_rows(open_groups, rows, size[1], opaque)


@kernel
def lay_down(
    rows: Floats,
    size: tuple[int, int],
    grid: tuple[int, int],
    opaque: Single,
    tile: int,
    is_open: bool,
    carried: Carried,
) -> None:
    """Keep sub-pixels until the next step, unless all are opaque: these never change.

    Of a canvas of a size, rows and columns, in which a pixel has so many per side, and which goes
    so many pixels beyond its tile. Those are reached by what reaches so far beyond the tile, so
    that its pixels stand for those next to them.
    """
    if in_steps(carried):
        (height, width), (n, margin), side = size, grid, carried.is_open.shape[1]
        carried.state[tile] = OPEN if is_open else OPAQUE
        carried.is_open[tile] = False
        place, one = carried.each * carried.start[tile], np.float32(1.0)
        for row in range(height if is_open else 0):
            y = min(max(row // n - margin, 0), side - 1)
            for column in range(width):
                k = index_of(row, column)
                if one - rows[k + ALPHA] > opaque:
                    x = min(max(column // n - margin, 0), side - 1)
                    carried.is_open[tile, y, x] = True
                for at, name in enumerate(KEPT):
                    carried.number[place + at] = rows[k + name]
                place += len(KEPT)


@kernel
def leave_out(line: Pairs, first: int, last: int, carried: Carried) -> int:
    """Of pairs from one to before another, keep those of this step; gives where they end."""
    if not in_steps(carried):
        return last
    least = np.uint64(bits_of(carried.step.again)) << HALF
    behind = np.uint64(bits_of(carried.step.last)) << HALF
    stay = first
    for n in range(first, last):
        found = line[np.uint64(n)]
        line[np.uint64(stay)] = found
        stay += 1 if least <= found < behind else 0
    return stay
