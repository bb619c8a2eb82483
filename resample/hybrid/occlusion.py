"""Section 6: an occlusion map, which marks blocks with open pixels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, kernel
from resample.types import Record

TILE, BLOCK = 32, 8  # px, sides of a tile and of its blocks
ACROSS = TILE // BLOCK

OpenBlocks = NDArray[np.int32]  # (ACROSS² + 1,) open pixels of each block of a tile; and a mask
MASK = ACROSS * ACROSS  # entry of the mask; its bits are set for the blocks with open pixels
FIRST_COLUMN = 0x1111  # mask of the blocks at the left of a tile, one per row of four


class TileBox(NamedTuple):
    """Pixels of a tile: rows top to bottom - 1, columns left to right - 1."""

    top: int
    bottom: int
    left: int
    right: int


@kernel
def open_blocks(box: TileBox) -> OpenBlocks:
    """Blocks of a tile with only open pixels."""
    blocks = np.zeros(ACROSS * ACROSS + 1, np.int32)
    for row in range(box.bottom - box.top):
        for column in range(box.right - box.left):
            block = row // BLOCK * ACROSS + column // BLOCK
            blocks[block] += 1
            blocks[MASK] |= 1 << block
    return blocks


@inner_step
def blocks_met(s: Record, tile_row: int, tile_column: int) -> int:
    """Mask of the blocks of a tile that a sample's box meets."""
    above, beside = tile_row * TILE, tile_column * TILE
    top, bottom = max(s["top"] - above, 0) // BLOCK, min(s["bottom"] - above, TILE) - 1
    left, right = max(s["left"] - beside, 0) // BLOCK, min(s["right"] - beside, TILE) - 1
    # Rows of blocks, at the left of the tile; each times the columns.
    rows = FIRST_COLUMN & ((1 << (bottom // BLOCK + 1) * ACROSS) - (1 << top * ACROSS))
    columns = (1 << right // BLOCK + 1) - (1 << left)
    return int(rows * columns)


@inner_step
def close(blocks: OpenBlocks, row: int, column: int, box: TileBox) -> None:
    """Count a pixel that became opaque."""
    block = (row - box.top) // BLOCK * ACROSS + (column - box.left) // BLOCK
    blocks[block] -= 1
    if blocks[block] == 0:
        blocks[MASK] &= ~(1 << block)
