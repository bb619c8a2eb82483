"""Find the discs that a picture, or a part of it, shows."""

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.engine.tiles import overlapping_tiles
from resample.types import Record, Records

CHUNK = 4096  # discs that a thread takes at a time

Flags = NDArray[np.bool_]
Lattice = tuple[int, int, int]


@kernel
def _meets(record: Record, lattice: Lattice, first: int, last: int) -> bool:
    """Whether a disc touches one of some consecutive tiles."""
    if record["left"] > record["right"]:
        return False
    # Find the tiles that the bounds meet, and intersect them row by row with the span.
    rows, columns, size = lattice
    left, right = overlapping_tiles(record["left"], record["right"], 0.0, size, columns)
    top, bottom = overlapping_tiles(record["top"], record["bottom"], 0.0, size, rows)
    for row in range(max(top, first // columns), min(bottom, (last - 1) // columns) + 1):
        if max(left, first - row * columns) <= min(right, last - 1 - row * columns):
            return True
    return False


@kernel
def _find_chunk(
    records: Records, lattice: Lattice, span: tuple[int, int], flags: Flags, chunk: int
) -> None:
    """Test the discs of a chunk; see `find_overlapping`."""
    start = int(np.int64(chunk)) * CHUNK
    for n in range(start, min(start + CHUNK, flags.size)):
        flags[n] = _meets(records[n], lattice, span[0], span[1])


@parallel_kernel
def find_overlapping(
    counter: Counter, records: Records, lattice: Lattice, span: tuple[int, int], flags: Flags
) -> None:
    """Find the discs that touch a tile of a span: its first, and one past its last.

    `records`: (N,) of `SURFEL`. `lattice`: rows and columns of all tiles, and their size, px.
    `span`: two numbers of tiles. `flags`: (N,) filled.
    """
    for chunk in tasks(counter, (flags.size + CHUNK - 1) // CHUNK):
        _find_chunk(records, lattice, span, flags, chunk)
