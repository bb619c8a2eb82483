"""Section 6: an occlusion map, which says of blocks of pixels whether any is still open."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_step, kernel
from resample.types import Record

TILE, BLOCK = 32, 8  # px, sides of a tile and of its blocks
ACROSS = TILE // BLOCK

OpenBlocks = NDArray[np.int32]  # (ACROSS²,) open pixels of each block of a tile


class TileBox(NamedTuple):
    """Pixels of a tile: rows top to bottom - 1, columns left to right - 1."""

    top: int
    bottom: int
    left: int
    right: int


@kernel
def open_blocks(box: TileBox) -> OpenBlocks:
    """Blocks of a tile, all of whose pixels are open."""
    blocks = np.zeros(ACROSS * ACROSS, np.int32)
    for row in range(box.bottom - box.top):
        for column in range(box.right - box.left):
            blocks[row // BLOCK * ACROSS + column // BLOCK] += 1
    return blocks


@inner_step
def is_any_open(blocks: OpenBlocks, s: Record, box: TileBox) -> bool:
    """Whether a sample's box meets a block of the tile that is open."""
    top, bottom = max(box.top, s["top"]) - box.top, min(box.bottom, s["bottom"]) - box.top
    left, right = max(box.left, s["left"]) - box.left, min(box.right, s["right"]) - box.left
    for row in range(top // BLOCK, (bottom - 1) // BLOCK + 1):
        for column in range(left // BLOCK, (right - 1) // BLOCK + 1):
            if blocks[row * ACROSS + column] > 0:
                return True
    return False


@inner_step
def close(blocks: OpenBlocks, row: int, column: int, box: TileBox) -> None:
    """Count a pixel that became opaque."""
    blocks[(row - box.top) // BLOCK * ACROSS + (column - box.left) // BLOCK] -= 1
