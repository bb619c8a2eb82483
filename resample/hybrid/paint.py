"""One painter for everything: samples are dealt to tiles, and each tile is painted by one thread.

Within a tile samples come in the order of their records. So a pixel's sum has one order, and the
picture the same bits, whatever the number of threads.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.hybrid.occlusion import MASK, TILE, TileBox, blocks_met, open_blocks
from resample.hybrid.points import filter_point
from resample.hybrid.record import NOTHING, POINT
from resample.hybrid.roles import Blend, finish, sweeps
from resample.hybrid.splats import LookupTables, scan_splat
from resample.types import Indices, Records, Single

SHIFT = 5  # bits of TILE


class Counts(NamedTuple):
    """Counts of a picture's samples, by treatment."""

    points: int
    splats: int
    hidden: int  # of both, occluded by nearer samples
    from_table: int  # splats with an index correction from the table
    by_equation: int  # splats beyond the table, with the equation evaluated


POINTS, SPLATS, _, FROM_TABLE, BY_EQUATION = range(len(Counts._fields))


class TileMembers(NamedTuple):
    """Which samples touch which tile (compressed rows)."""

    member: NDArray[np.int32]  # (M,) samples of tile t from start[t] on, in order
    blocks: NDArray[np.uint16]  # (M,) mask of the tile's blocks that the sample's box meets
    start: Indices  # (T + 1,)
    across: int  # tiles in a row of them
    shown: Indices  # tiles to paint


def paint(
    records: Records,
    tables: LookupTables,
    blend: Blend,
    size: tuple[int, int],
    window: Sequence[int] | None = None,
) -> Counts:
    """Blend records (N,), in this order, into the blend's pictures.

    `size`: height and width of the pictures, px. `window`: (x0, y0, x1, y1) px: only tiles that
    meet it are painted; None: all.
    """
    height, width = size
    down, across = -(-height // TILE), -(-width // TILE)
    counts = np.zeros(len(Counts._fields), np.int64)
    member, blocks, start = deal_members(records, (down, across), tables.largest, counts)
    shown = _shown(start, (down, across), window or (0, 0, width, height))
    tiles = TileMembers(member, blocks, start, across, shown)
    met = np.zeros(len(records), np.bool_)
    paint_tiles(records, tiles, tables, blend, (height, width), met)
    points, splats, _, from_table, by_equation = map(int, counts)
    hidden = points + splats - int(np.count_nonzero(met))
    return Counts(points, splats, hidden, from_table, by_equation)


def _shown(start: Indices, grid: tuple[int, int], window: Sequence[int]) -> Indices:
    """Tiles of a grid (rows, columns) that meet a window, the fullest first.

    So no thread is left with a full one at the end.
    """
    x0, y0, x1, y1 = window
    rows, columns = slice(y0 // TILE, -(-y1 // TILE)), slice(x0 // TILE, -(-x1 // TILE))
    shown = np.arange(grid[0] * grid[1]).reshape(grid)[rows, columns].ravel()
    load = start[shown + 1] - start[shown]
    return shown[np.argsort(-load, kind="stable")]


@parallel_kernel
def paint_tiles(
    counter: Counter,
    records: Records,
    tiles: TileMembers,
    tables: LookupTables,
    blend: Blend,
    size: tuple[int, int],
    met: NDArray[np.bool_],
) -> None:
    """Paint tiles; no two threads share one.

    `met`: (N,) set for samples that found a pixel open.
    """
    height, width = size
    for task in tasks(counter, tiles.shown.size):
        tile = tiles.shown[task]
        top, left = tile // tiles.across * TILE, tile % tiles.across * TILE
        box = TileBox(top, min(top + TILE, height), left, min(left + TILE, width))
        _paint_tile(records, tiles, tile, box, open_blocks(box), tables, blend, met)


@inner_kernel
def _paint_tile(
    records: Records,
    tiles: TileMembers,
    tile: int,
    box: TileBox,
    blocks: NDArray[np.int32],
    tables: LookupTables,
    blend: Blend,
    met: NDArray[np.bool_],
) -> None:
    """Paint the members of a tile that has the pixels of a box."""
    for sweep in range(sweeps(blend)):
        for m in range(tiles.start[tile], tiles.start[tile + 1]):
            # Occlusion culling: what meets opaque blocks alone is skipped (section 6).
            if tiles.blocks[m] & blocks[MASK] == 0:
                continue
            n = np.uint64(tiles.member[m])
            s = records[n]
            if s["kind"] == POINT:
                met[n] |= filter_point(s, n, box, blocks, tables.point, blend, sweep)
            else:
                met[n] |= scan_splat(s, n, box, blocks, tables, blend, sweep)
    for row in range(box.top, box.bottom):
        for column in range(box.left, box.right):
            finish(blend, np.uint64(row), np.uint64(column))


@kernel
def _count_members(
    records: Records, across: int, largest: Single, load: Indices, counts: Indices
) -> None:
    """Count the samples of each tile, and of each kind."""
    for n in range(records.size):
        s = records[n]
        if s["kind"] == NOTHING:
            continue
        for row in range(s["top"] >> SHIFT, (s["bottom"] - 1 >> SHIFT) + 1):
            for column in range(s["left"] >> SHIFT, (s["right"] - 1 >> SHIFT) + 1):
                load[row * across + column] += 1
        if s["kind"] == POINT:
            counts[POINTS] += 1
        else:
            counts[SPLATS] += 1
            if s["alpha"] > 0.0:
                counts[FROM_TABLE if s["alpha"] <= largest else BY_EQUATION] += 1


@kernel
def deal_members(
    records: Records, grid: tuple[int, int], largest: Single, counts: Indices
) -> tuple[NDArray[np.int32], NDArray[np.uint16], Indices]:
    """Members, blocks and starts of `TileMembers` for a grid of tiles.

    `grid`: rows and columns of tiles. `largest`: angle up to which the index correction has a
    table, rad. `counts`: samples of each kind, as in `Counts`; filled.
    """
    down, across = grid
    load = np.zeros(down * across, np.int64)
    _count_members(records, across, largest, load, counts)
    start = np.zeros(load.size + 1, np.int64)
    for tile in range(load.size):
        start[tile + 1] = start[tile] + load[tile]

    # Each tile takes its samples in the order of the records.
    member, blocks = np.empty(start[-1], np.int32), np.empty(start[-1], np.uint16)
    filled = start.copy()
    for n in range(records.size):
        s = records[n]
        if s["kind"] == NOTHING:
            continue
        for row in range(s["top"] >> SHIFT, (s["bottom"] - 1 >> SHIFT) + 1):
            for column in range(s["left"] >> SHIFT, (s["right"] - 1 >> SHIFT) + 1):
                tile = row * across + column
                member[filled[tile]], blocks[filled[tile]] = n, blocks_met(s, row, column)
                filled[tile] += 1
    return member, blocks, start
