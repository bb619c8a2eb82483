"""Nearest neighbours of points that lie along a Morton curve, found block by block.

Sixteen points that follow each other are a block, eight blocks one of the next size, and so on up
to one that holds all. Points of a block look for their neighbours together: in their own block and
those beside it on the curve first, which bounds how far the others are, then in all blocks whose
boxes are not farther. Distances and boxes are rounded alike, and rounding keeps order, so that what
is found is exact. Of points that are equally far the first along the curve is nearer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, kernel
from resample.engine.vectors import Vector
from resample.types import Doubles, Floats

Numbers = NDArray[np.int64]

BLOCK = 16  # points
FAN = 8  # blocks of a larger one
DEEPEST = 12  # sizes of blocks: enough for 16 × 8¹¹ points
NOBODY = 1 << 60  # comes after all points


class PointBlocks(NamedTuple):
    """N points along a curve, all different, and the boxes around blocks of them."""

    place: Floats  # (N, 3)
    low: Floats  # (M, 3) least coordinates of blocks, the smallest first
    high: Floats  # (M, 3) greatest
    first: Numbers  # (sizes + 1,) where the blocks of a size begin


class Search(NamedTuple):
    """What a thread looks for the neighbours of up to `BLOCK` points with."""

    which: Numbers  # (BLOCK,) the points
    place: Doubles  # (3, BLOCK) where they are
    square: Doubles  # (BLOCK, k) squares of distances, least first
    found: Numbers  # (BLOCK, k) who is that far
    near: Doubles  # (3, BLOCK) places of a block
    away: Doubles  # (BLOCK,) squares of their distances
    gap: Doubles  # (BLOCK,) squares of distances of points from a box
    stack: Numbers  # (DEEPEST * FAN, 2) blocks that wait, and their sizes


def blocks_of(place: Floats) -> PointBlocks:
    """PointBlocks of points (N, 3) of which there is one at least."""
    lows, highs, step = [place], [place], BLOCK
    while len(lows[-1]) > 1:
        starts = np.arange(0, len(lows[-1]), step)
        lows.append(np.minimum.reduceat(lows[-1], starts, axis=0))
        highs.append(np.maximum.reduceat(highs[-1], starts, axis=0))
        step = FAN
    lows, highs = lows[1:] or lows, highs[1:] or highs
    first = np.cumsum([0, *map(len, lows)])
    return PointBlocks(place, np.concatenate(lows), np.concatenate(highs), first.astype(np.int64))


@kernel
def search(count: int) -> Search:
    """Room to look for so many neighbours."""
    return Search(
        np.empty(BLOCK, np.int64),
        np.empty((3, BLOCK)),
        np.empty((BLOCK, count)),
        np.empty((BLOCK, count), np.int64),
        np.empty((3, BLOCK)),
        np.empty(BLOCK),
        np.empty(BLOCK),
        np.empty((DEEPEST * FAN, 2), np.int64),
    )


@inner_kernel
def _apart(blocks: PointBlocks, block: int, low: Vector, high: Vector) -> float:
    """Square of the distance of a block's box from another."""
    x = max(float(blocks.low[block, 0]) - high[0], low[0] - float(blocks.high[block, 0]), 0.0)
    y = max(float(blocks.low[block, 1]) - high[1], low[1] - float(blocks.high[block, 1]), 0.0)
    z = max(float(blocks.low[block, 2]) - high[2], low[2] - float(blocks.high[block, 2]), 0.0)
    return x * x + y * y + z * z


@inner_kernel
def _take(blocks: PointBlocks, block: int, looking: Search) -> int:
    """Places of a block's points, and far ones after them; gives how many there are."""
    start = block * BLOCK
    many: int = min(BLOCK, blocks.place.shape[0] - start)
    for j in range(many, BLOCK):
        for c in range(3):
            looking.near[c, j] = np.inf
    for j in range(many):
        for c in range(3):
            looking.near[c, j] = blocks.place[start + j, c]
    return many


@inner_kernel
def _measure(near: Doubles, here: Vector, away: Doubles) -> None:
    """Squares of distances of some places (3, BLOCK) from another."""
    for j in range(BLOCK):
        x, y, z = near[0, j] - here[0], near[1, j] - here[1], near[2, j] - here[2]
        away[j] = x * x + y * y + z * z


@inner_kernel
def _insert(square: Doubles, found: Numbers, row: int, d: float, n: int) -> None:
    """Put a point in its place among the nearest, whose last one is lost."""
    k = square.shape[1] - 1
    while k > 0 and (square[row, k - 1] > d or (square[row, k - 1] == d and found[row, k - 1] > n)):
        square[row, k], found[row, k] = square[row, k - 1], found[row, k - 1]
        k -= 1
    square[row, k], found[row, k] = d, n


@inner_kernel
def _place(looking: Search, row: int) -> Vector:
    return looking.place[0, row], looking.place[1, row], looking.place[2, row]


@inner_kernel
def _begin(blocks: PointBlocks, block: int, count: int, looking: Search) -> tuple[Vector, Vector]:
    """Find the nearest points in the own block; gives the corners of the box around `which`.

    The place of each is how many are nearer, or as near and before it.
    """
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    many, away = _take(blocks, block, looking), looking.away
    square, found, wanted = looking.square, looking.found, looking.square.shape[1]
    for row in range(count):
        for c in range(3):
            looking.place[c, row] = blocks.place[looking.which[row], c]
        here = _place(looking, row)
        low = (min(low[0], here[0]), min(low[1], here[1]), min(low[2], here[2]))
        high = (max(high[0], here[0]), max(high[1], here[1]), max(high[2], here[2]))
        _measure(looking.near, here, away)
        for n in range(many, wanted):
            square[row, n], found[row, n] = np.inf, NOBODY
        for n in range(many):
            before, d = 0, away[n]
            for m in range(BLOCK):
                before += int((away[m] < d) | ((away[m] == d) & (m < n)))
            if before < wanted:
                square[row, before], found[row, before] = d, block * BLOCK + n
    return low, high


@inner_kernel
def _scan(blocks: PointBlocks, block: int, count: int, looking: Search) -> None:
    """Look at all points of a block for those of `looking.which` that may be near one of them."""
    many, away, gap, at = _take(blocks, block, looking), looking.away, looking.gap, looking.place
    last, start = looking.square.shape[1] - 1, block * BLOCK
    for row in range(count):
        gap[row] = 0.0
    for c in range(3):
        low, high = float(blocks.low[block, c]), float(blocks.high[block, c])
        for row in range(count):
            by = max(low - at[c, row], at[c, row] - high, 0.0)
            gap[row] += by * by
    for row in range(count):
        worst = looking.square[row, last]
        if gap[row] > worst:
            continue
        _measure(looking.near, _place(looking, row), away)
        for j in range(many):
            d = away[j]
            if d <= worst and (d < worst or start + j < looking.found[row, last]):
                _insert(looking.square, looking.found, row, d, start + j)
                worst = looking.square[row, last]


@inner_kernel
def _farthest(count: int, looking: Search) -> float:
    """Greatest square of a distance that neighbours of any point may have."""
    last, most = looking.square.shape[1] - 1, 0.0
    for row in range(count):
        most = max(most, looking.square[row, last])
    return most


@inner_kernel
def look_around(blocks: PointBlocks, block: int, count: int, looking: Search) -> None:
    """Find the nearest points of some points of a block, themselves among them.

    Parameters
    ----------
    blocks
        All points.
    block
        The one that they are of.
    count
        How many of `looking.which` there are.
    looking
        `square` and `found` are filled, (count, k). There are at least k points.
    """
    low, high = _begin(blocks, block, count, looking)
    beside = 1 + looking.square.shape[1] // (2 * BLOCK)
    begin, end = max(0, block - beside), min(blocks.first[1], block + beside + 1)
    for other in range(begin, end):
        if other != block:
            _scan(blocks, other, count, looking)
    stack, farthest = looking.stack, _farthest(count, looking)
    stack[0, 0], stack[0, 1], waiting = 0, blocks.first.size - 2, 1
    while waiting > 0:
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        if size == 0:
            if (node < begin or node >= end) and _apart(blocks, node, low, high) <= farthest:
                _scan(blocks, node, count, looking)
                farthest = _farthest(count, looking)
            continue
        before = blocks.first[size - 1]
        for child in range(node * FAN, min(node * FAN + FAN, blocks.first[size] - before)):
            if _apart(blocks, before + child, low, high) <= farthest:
                stack[waiting, 0], stack[waiting, 1] = child, size - 1
                waiting += 1
