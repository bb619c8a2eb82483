"""Assignment of samples to the tiles of the screen that they touch."""

import math

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Floats, Records, Screen, Single, Tiles

Indices = NDArray[np.int32]
Keys = NDArray[np.uint32]
Pairs = NDArray[np.uint64]  # a key's bits above a sample's number of 32 bits

FEW = 48  # numbers up to which insertion sort beats radix sort
MOST_BITS = 11  # of a digit: at most three passes over 32 bits
HALF = np.uint64(32)  # bits
LOWER = np.uint64(0xFFFFFFFF)


@kernel
def _is_before(looks: Floats, first: int, second: int) -> bool:
    """Whether one row of `looks` (N, K) comes before another, in lexicographic order."""
    for column in range(looks.shape[1]):
        if looks[first, column] != looks[second, column]:
            return bool(looks[first, column] < looks[second, column])
    return False


@kernel
def _sift(looks: Floats, run: Indices, root: int, size: int) -> None:
    """Restore the heap below `root`: no child comes after its parent."""
    while 2 * root + 1 < size:
        # Take the later child, and swap it up if it comes after its parent.
        child = 2 * root + 1
        if child + 1 < size and _is_before(looks, run[child], run[child + 1]):
            child += 1
        if not _is_before(looks, run[root], run[child]):
            return
        run[root], run[child] = run[child], run[root]
        root = child


@kernel
def settle(run: Indices, looks: Floats) -> None:
    """Sort row numbers `run` by their rows of `looks` (N, K): heap sort."""
    # Mostly the run is sorted already.
    ordered = True
    for n in range(1, run.size):
        if _is_before(looks, run[n], run[n - 1]):
            ordered = False
            break
    if ordered:
        return
    # Build the heap, then move its root to the end, again and again.
    for root in range(run.size // 2 - 1, -1, -1):
        _sift(looks, run, root, run.size)
    for size in range(run.size - 1, 0, -1):
        run[0], run[size] = run[size], run[0]
        _sift(looks, run, 0, size)


@kernel
def _move(pair: Pairs, to: Pairs, low: np.uint64, shift: np.uint64, position: Indices) -> None:
    """Counting sort by one digit; `position` is scratch, one longer than the digit's values."""
    mask = np.uint64(position.size - 2)
    # Count the values of the digit, and sum up to where each begins.
    for digit in range(position.size):
        position[digit] = 0
    for n in range(pair.size):
        position[(((pair[n] - low) >> shift) & mask) + np.uint64(1)] += 1
    for digit in range(1, position.size):
        position[digit] += position[digit - 1]
    # Move each pair to its place, in order.
    for n in range(pair.size):
        digit = ((pair[n] - low) >> shift) & mask
        to[np.uint64(position[digit])] = pair[n]
        position[digit] += 1


@kernel
def sort_pairs(pair: Pairs, other: Pairs) -> None:
    """Sort by the upper 32 bits, stably; `other` is scratch of the same size.

    Radix sort with digits of a width that fits the range of these bits, least significant first.
    """
    if pair.size <= FEW:
        # Insertion sort; stable.
        for n in range(1, pair.size):
            moved, place = pair[n], n
            while place > 0 and pair[place - 1] >> HALF > moved >> HALF:
                pair[place] = pair[place - 1]
                place -= 1
            pair[place] = moved
        return
    # Find the range of the keys.
    low = high = pair[0]
    for n in range(1, pair.size):
        low, high = min(low, pair[n]), max(high, pair[n])
    low >>= HALF
    # Choose the digits: as few passes as possible, of equal width.
    span, bits = (high >> HALF) - low, 1
    while span >> np.uint64(bits):
        bits += 1
    passes = (bits + MOST_BITS - 1) // MOST_BITS
    width = (bits + passes - 1) // passes
    position = np.empty((1 << width) + 1, np.int32)
    # Sort by digit after digit, back and forth between the arrays.
    for digit in range(passes):
        shift = HALF + np.uint64(digit * width)
        if digit % 2 == 0:
            _move(pair, other, low << HALF, shift, position)
        else:
            _move(other, pair, low << HALF, shift, position)
    # Copy back after an odd number of passes.
    if passes % 2 == 1:
        for n in range(pair.size):
            pair[n] = other[n]


@kernel
def paired(bits: np.uint32, member: int) -> np.uint64:
    """Pack a key and a sample's number into one integer."""
    return np.uint64(bits) << HALF | np.uint64(np.uint32(member))


@kernel
def bits_of(key: Single) -> np.uint32:
    """Integer of the same order as a float32."""
    bits = np.float32(key).view(np.uint32)
    return np.uint32(~bits) if bits >> np.uint32(31) else np.uint32(bits | np.uint32(0x80000000))


@kernel
def member_of(pair: np.uint64) -> np.int64:
    """Sample's number in a pair."""
    return np.int64(pair & LOWER)


@kernel
def settle_ties(pair: Pairs, position: Floats, color: Floats, extinction: Floats) -> None:
    """Order samples of equal keys by their appearance, whatever order they came in.

    `pair`: (N,) keys and indices, ascending. `position`, `color`, `extinction`: (N, 3), (N, 3) and
    (N,) of the samples.
    """
    first = 0
    for end in range(1, pair.size + 1):
        if end < pair.size and pair[end] >> HALF == pair[first] >> HALF:
            continue
        # Most ties are of two samples in different places.
        m, n = member_of(pair[first]), member_of(pair[end - 1])
        if end - first == 2 and position[m, 0] != position[n, 0]:
            if position[m, 0] > position[n, 0]:
                pair[first], pair[end - 1] = pair[end - 1], pair[first]
        elif end - first > 1:
            tied = pair[first:end].copy()
            looks = np.empty((end - first, 7), np.float32)
            for k in range(end - first):
                n = member_of(tied[k])
                looks[k, :3], looks[k, 3:6], looks[k, 6] = position[n], color[n], extinction[n]
            turn = np.arange(end - first).astype(np.int32)
            settle(turn, looks)
            pair[first:end] = tied[turn]
        first = end


CHUNKS = 64  # fixed, so that the members' order never depends on the number of threads

Counts = NDArray[np.int64]


@kernel
def overlapping_tiles(
    low: float, high: float, margin: float, size: int, count: int
) -> tuple[int, int]:
    """First and last tile along one axis with pixels, margin included, in [low, high] px."""
    # Clamp before converting to integers: bounds may be infinite.
    first = math.floor(max(-1.0, min(float(count), (low - margin) / size)))
    last = math.floor(max(-1.0, min(float(count), (high + margin) / size)))
    return max(0, int(first)), min(count - 1, int(last))


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
    tile_rows, margin = count.shape[1] // tile_columns, screen.margin
    for chunk in tasks(counter, CHUNKS):
        first, last = footprints.size * chunk // CHUNKS, footprints.size * (chunk + 1) // CHUNKS
        for n in range(first, last):
            # Skip hidden samples, and count the others in every tile that they touch.
            record = footprints[n]
            low, high = record["left"], record["right"]
            if low > high:
                continue
            left, right = overlapping_tiles(low, high, margin, size, tile_columns)
            low, high = record["top"], record["bottom"]
            top, bottom = overlapping_tiles(low, high, margin, size, tile_rows)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    count[chunk, row * tile_columns + column] += 1


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
    size, columns, member, margin = tiles.size, tiles.columns, tiles.member, screen.margin
    tile_rows = position.shape[1] // columns
    for chunk in tasks(counter, CHUNKS):
        first, last = footprints.size * chunk // CHUNKS, footprints.size * (chunk + 1) // CHUNKS
        for n in range(first, last):
            # As in `count_members`, write each sample to its tiles.
            record = footprints[n]
            low, high = record["left"], record["right"]
            if low > high:
                continue
            left, right = overlapping_tiles(low, high, margin, size, columns)
            low, high = record["top"], record["bottom"]
            top, bottom = overlapping_tiles(low, high, margin, size, tile_rows)
            for row in range(top, bottom + 1):
                for column in range(left, right + 1):
                    tile = row * columns + column
                    member[position[chunk, tile]] = n
                    position[chunk, tile] += 1
                    # Keep the smallest spacing, which decides the tile's grid.
                    smallest[chunk, tile] = min(smallest[chunk, tile], record["spacing"])
