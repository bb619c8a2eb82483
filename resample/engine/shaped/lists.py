"""The painting order of ellipsoids, and the lists of the screen's tiles."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.engine.shaped.records import WIDTH, span_of
from resample.engine.tiles import HALF, Pairs, member_of, overlapping_tiles, settle
from resample.types import Floats, Indices

CHUNKS = 32  # fixed, so that lists never depend on the number of threads

Counts = NDArray[np.int64]


class TileGrid(NamedTuple):
    """Tiles of a part of the screen."""

    left: float  # px, of the first tile
    top: float
    side: int  # px
    columns: int
    rows: int
    fine: int  # sub-pixels per side of a pixel


class TileLists(NamedTuple):
    """Records in each tile, nearest first."""

    start: Indices  # (T + 1,)
    member: NDArray[np.int32]


@kernel
def settle_records(pair: Pairs, records: Floats) -> None:
    """Order records of equal keys by their contents, whatever order they came in.

    `pair`: (N,) keys and numbers of records, ascending.
    """
    first = 0
    for end in range(1, pair.size + 1):
        if end < pair.size and pair[end] >> HALF == pair[first] >> HALF:
            continue
        if end - first > 1:
            tied = pair[first:end].copy()
            looks = np.empty((end - first, WIDTH), np.float32)
            for k in range(end - first):
                looks[k] = records[member_of(tied[k])]
            turn = np.arange(end - first).astype(np.int32)
            settle(turn, looks)
            pair[first:end] = tied[turn]
        first = end


@inner_kernel
def _tiles_of(records: Floats, n: int, grid: TileGrid) -> tuple[int, int, int, int]:
    """First and last column and row of tiles that a record may touch."""
    low, high = span_of(records[n], 0)
    first, last = overlapping_tiles(low - grid.left, high - grid.left, 0.0, grid.side, grid.columns)
    low, high = span_of(records[n], 1)
    above, below = overlapping_tiles(low - grid.top, high - grid.top, 0.0, grid.side, grid.rows)
    return first, last, above, below


@parallel_kernel
def deal_records(
    counter: Counter,
    records: Floats,
    order: NDArray[np.uint32],
    grid: TileGrid,
    position: Counts,
    member: NDArray[np.int32],
) -> None:
    """Write each record to its tiles, or count each tile's records if `member` has no room.

    `position` (CHUNKS, T): where the members of each chunk of the order begin; it grows by them.
    """
    is_counting = member.size == 0
    for chunk in tasks(counter, CHUNKS):
        for k in range(order.size * chunk // CHUNKS, order.size * (chunk + 1) // CHUNKS):
            n = int(order[k])
            first, last, above, below = _tiles_of(records, n, grid)
            for row in range(above, below + 1):
                for column in range(first, last + 1):
                    tile = row * grid.columns + column
                    if not is_counting:
                        member[position[chunk, tile]] = n
                    position[chunk, tile] += 1
