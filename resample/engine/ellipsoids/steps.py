"""Paint tiles step by step: checkpoints of their sub-pixels until more samples are loaded.

Samples are composited front to back, so a tile may stop and resume later: before any splat that is
composited by itself, between two sheets, or between two slabs. Each step paints the samples whose
keys lie within its limits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

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
from resample.engine.subpixels import laid_out
from resample.types import Floats, Indices, Single, Stage, Tiles

KEPT = (RED, GREEN, BLUE, ALPHA, DEPTH, WEIGHT, FIRST)  # numbers of a sub-pixel that are saved
NEW, OPEN, OPAQUE = 0, 1, 2  # states of a tile


class Step(NamedTuple):
    """Keys of the samples that a step paints; layers are composited in the steps they end in.

    Slabs that cut splats stay open behind the last one composited. Samples that contribute to them
    are added once more in the next step, as the sums are not saved.
    """

    again: Single  # least key of samples that are added once more
    first: Single  # least key of samples that are painted for the first time
    last: Single  # least key of samples that are left to later steps
    done: int  # number of the first sheet or slab that was not composited before
    due: int  # number of the first one that is not composited in this step


class Carried(NamedTuple):
    """Checkpoints of tiles between steps, and which samples a step paints."""

    number: Floats  # (each S,) of S sub-pixels, tile after tile
    each: int  # numbers per sub-pixel: KEPT, and what slabs save besides
    start: Indices  # (T + 1,) index of each tile's first sub-pixel
    state: NDArray[np.uint8]  # (T,) NEW, OPEN or OPAQUE
    is_open: NDArray[np.bool_]  # (T, S, S) pixels of tiles of S px that are not opaque yet
    step: Step


# Painted in one go: nothing is saved.
AT_ONCE = Carried(
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
    """Count the sub-pixels on the canvas of each tile (T,); 0 for those not shown."""
    for tile in range(count.size):
        _, _, height, width = laid_out(tile, tiles, stage)
        count[tile] = height * width if shown[tile] else 0


@kernel
def resume(rows: Floats, height: int, width: int, tile: int, carried: Carried) -> None:
    """Restore saved sub-pixels into new rows."""
    # A new tile has nothing saved.
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
    """Restore saved sub-pixels into new rows, and close groups that are opaque."""
    # Groups that are opaque already cull samples from the start.
    if in_steps(carried):
        resume(rows, size[0], size[1], tile, carried)
        close_rows(open_groups, rows, size[1], opaque)


@kernel
def checkpoint(
    rows: Floats,
    size: tuple[int, int],
    grid: tuple[int, int],
    opaque: Single,
    tile: int,
    is_open: bool,
    carried: Carried,
) -> None:
    """Checkpoint the sub-pixels until the next step, unless all are opaque: these never change.

    `size` is rows and columns of the canvas; `grid` is sub-pixels per side of a pixel, and pixels
    of margin around the tile. Open sub-pixels in the margin are noted at the nearest pixel of the
    tile, as what reaches them reaches that far beyond it.
    """
    if in_steps(carried):
        # Note the state of the tile.
        (height, width), (n, margin), side = size, grid, carried.is_open.shape[1]
        carried.state[tile] = OPEN if is_open else OPAQUE
        carried.is_open[tile] = False
        place, one = carried.each * carried.start[tile], np.float32(1.0)
        # Save the sub-pixels, and mark pixels that are still open.
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
    """Keep only the pairs first..last of this step's samples; return where they end."""
    if not in_steps(carried):
        return last
    # Compact in place, without branches.
    least = np.uint64(bits_of(carried.step.again)) << HALF
    behind = np.uint64(bits_of(carried.step.last)) << HALF
    stay = first
    for n in range(first, last):
        found = line[np.uint64(n)]
        line[np.uint64(stay)] = found
        stay += 1 if least <= found < behind else 0
    return stay
