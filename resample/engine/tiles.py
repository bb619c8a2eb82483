"""Assignment of samples to the tiles of the screen that they touch."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Records, Screen, Tiles

CHUNKS = 64  # fixed, so that the members' order never depends on the number of threads

Counts = NDArray[np.int64]


@kernel
def overlapping_tiles(
    low: float, high: float, margin: float, size: int, count: int
) -> tuple[int, int]:
    """First and last tile along one axis whose pixels, with margin, overlap [low, high] px."""
    # Clamp before converting to integers: bounds may be infinite.
    first = math.floor(max(-1.0, min(float(count), (low - margin) / size)))
    last = math.floor(max(-1.0, min(float(count), (high + margin) / size)))
    return max(0, int(first)), min(count - 1, int(last))


@kernel
def _count_chunk(
    footprints: Records, screen: Screen, size: int, tile_columns: int, count: Counts, chunk: int
) -> None:
    # Skip hidden samples, and count the others in every tile that they touch.
    tile_rows = count.shape[1] // tile_columns
    for n in range(*_span(footprints.size, chunk)):
        record = footprints[n]
        if record["left"] > record["right"]:
            continue
        left, right = overlapping_tiles(
            record["left"], record["right"], screen.margin, size, tile_columns
        )
        top, bottom = overlapping_tiles(
            record["top"], record["bottom"], screen.margin, size, tile_rows
        )
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                count[chunk, row * tile_columns + column] += 1


@kernel
def _span(samples: int, chunk: int) -> tuple[int, int]:
    return samples * chunk // CHUNKS, samples * (chunk + 1) // CHUNKS


@kernel
def _deal_chunk(
    footprints: Records,
    screen: Screen,
    tiles: Tiles,
    position: Counts,
    smallest: Floats,
    chunk: int,
) -> None:
    # As in `_count_chunk`, write each sample to its tiles.
    size, columns, member, margin = tiles.size, tiles.columns, tiles.member, screen.margin
    tile_rows = position.shape[1] // columns
    for n in range(*_span(footprints.size, chunk)):
        record = footprints[n]
        if record["left"] > record["right"]:
            continue
        left, right = overlapping_tiles(record["left"], record["right"], margin, size, columns)
        top, bottom = overlapping_tiles(record["top"], record["bottom"], margin, size, tile_rows)
        for row in range(top, bottom + 1):
            for column in range(left, right + 1):
                tile = row * columns + column
                member[position[chunk, tile]] = n
                position[chunk, tile] += 1
                # Keep the smallest spacing, which decides the tile's grid.
                smallest[chunk, tile] = min(smallest[chunk, tile], record["spacing"])


@parallel_kernel
def count_members(
    counter: Counter,
    footprints: Records,
    screen: Screen,
    size: int,
    tile_columns: int,
    count: Counts,
) -> None:
    """Count the samples of each chunk in each tile, added to `count` (CHUNKS, T)."""
    for chunk in tasks(counter, CHUNKS):
        _count_chunk(footprints, screen, size, tile_columns, count, chunk)


@parallel_kernel
def deal_members(
    counter: Counter,
    footprints: Records,
    screen: Screen,
    tiles: Tiles,
    position: Counts,
    smallest: Floats,
) -> None:
    """Write each tile's samples, and the smallest spacing per chunk and tile (CHUNKS, T).

    `position` (CHUNKS, T) is where each chunk's samples of a tile begin.
    """
    for chunk in tasks(counter, CHUNKS):
        _deal_chunk(footprints, screen, tiles, position, smallest, chunk)
