"""Nearest neighbours of points that lie along a Morton curve, found block by block.

Sixteen points that follow each other are a block, eight blocks one of the next size, and so on up
to one that holds all. Points of a block look for their neighbours together. Their own block and
those beside it on the curve say how far the nearest are at most; then come all blocks whose boxes
are not farther. What is not farther of their points is held, and put in order by counting, of each,
how many are nearer. Distances and boxes are rounded alike, and rounding keeps order, so that what
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
SHIFT = 3
FAN = 1 << SHIFT  # blocks of a larger one
AROUND = 2  # sizes larger is the block in which neighbours are looked for at first
DEEPEST = 12  # sizes of blocks: enough for 16 × 8¹¹ points
LISTED = 512  # points that are looked at together
HELD = 192  # points that may be a point's neighbours
LANES = 32  # numbers that are compared at a time
SPARE = 3  # points more than are wanted that a bound may have within it
NARROWED = 8  # times at most that a bound is made closer


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
    found: Numbers  # (BLOCK, k) their neighbours, the nearest first
    bound: Doubles  # (BLOCK,) squares of distances that these do not exceed
    many: Numbers  # (BLOCK,) how many points are held
    held: Numbers  # (BLOCK, HELD) which points
    away: Doubles  # (BLOCK, HELD) squares of their distances
    rank: Numbers  # (HELD,) how many of them are nearer
    order: Numbers  # (HELD,) these points, the nearest first
    square: Doubles  # (HELD,) squares of their distances
    listed: Numbers  # (LISTED,) points to look at
    near: Doubles  # (3, LISTED) where they are
    gap: Doubles  # (LISTED,) squares of distances
    picked: Numbers  # (LISTED + 1,) which of the listed are within a bound
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
        np.empty((BLOCK, count), np.int64),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty((BLOCK, HELD), np.int64),
        np.empty((BLOCK, HELD)),
        np.empty(HELD, np.int64),
        np.empty(HELD, np.int64),
        np.empty(HELD),
        np.empty(LISTED, np.int64),
        np.empty((3, LISTED)),
        np.empty(LISTED),
        np.empty(LISTED + 1, np.int64),
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
def _take(
    blocks: PointBlocks, block: int, box: tuple[Vector, Vector], far: float, listed: int, s: Search
) -> int:
    """Put those points of a block into the list that are not far from a box; how many it has."""
    start, (low, high), near, names = block * BLOCK, box, s.near, s.listed
    for n in range(start, min(start + BLOCK, blocks.place.shape[0])):
        x, y, z = blocks.place[n, 0], blocks.place[n, 1], blocks.place[n, 2]
        near[0, listed], near[1, listed], near[2, listed], names[listed] = x, y, z, n
        dx = max(low[0] - x, x - high[0], 0.0)
        dy = max(low[1] - y, y - high[1], 0.0)
        dz = max(low[2] - z, z - high[2], 0.0)
        listed += int(dx * dx + dy * dy + dz * dz <= far)
    return listed


@inner_kernel
def _measure(near: Doubles, here: Vector, count: int, gap: Doubles) -> None:
    """Squares of distances of listed points from another."""
    for n in range(count):
        x, y, z = near[0, n] - here[0], near[1, n] - here[1], near[2, n] - here[2]
        gap[n] = x * x + y * y + z * z


@inner_kernel
def _within(gap: Doubles, count: int, bound: float) -> int:
    """How many of some squares are not above a bound."""
    total = 0
    for n in range(count):
        total += int(gap[n] <= bound)
    return total


@inner_kernel
def _bounded(gap: Doubles, count: int, wanted: int, guess: float, far: float) -> float:
    """A bound that enough squares are within, and not many more; `far` if that has too few."""
    low, few, high, many = 0.0, 0, far, count
    bound = guess
    for _ in range(NARROWED):
        inside = _within(gap, count, bound)
        if inside < wanted:
            low, few = bound, inside
        else:
            high, many = bound, inside
            if many <= wanted + SPARE:
                break
        bound = low + (high - low) * (wanted + 0.5 * SPARE - few) / max(1, many - few)
        if not low < bound < high:
            break
    return high


@inner_kernel
def _place(looking: Search, row: int) -> Vector:
    return looking.place[0, row], looking.place[1, row], looking.place[2, row]


@inner_kernel
def _rank(away: Doubles, held: Numbers, row: int, many: int, rank: Numbers) -> None:
    """Count how many of the points that are held are nearer than each, or as near and before it."""
    lanes = (many + LANES - 1) // LANES * LANES
    for n in range(many, lanes):
        away[row, n] = np.inf
    for n in range(many):
        d, nearer = away[row, n], 0
        for m in range(lanes):
            nearer += int(away[row, m] < d)
        rank[n] = nearer
    total = 0
    for n in range(many):
        total += rank[n]
    if 2 * total == many * (many - 1):
        return  # none are equally far
    for n in range(many):
        d, who = away[row, n], held[row, n]
        for m in range(many):
            rank[m] += int((d == away[row, m]) & (who < held[row, m]))


@inner_kernel
def _settle(looking: Search, row: int) -> None:
    """Put the nearest of the points that are held in order."""
    wanted = looking.found.shape[1]
    _rank(looking.away, looking.held, row, looking.many[row], looking.rank)
    for n in range(looking.many[row]):
        rank = looking.rank[n]
        looking.order[rank] = looking.held[row, n]
        looking.square[rank] = looking.away[row, n]
    for n in range(wanted):
        looking.found[row, n] = looking.order[n]


@inner_kernel
def _let_go(looking: Search, row: int) -> None:
    """Hold no points but the nearest."""
    wanted = looking.found.shape[1]
    _settle(looking, row)
    for n in range(wanted):
        looking.held[row, n], looking.away[row, n] = looking.found[row, n], looking.square[n]
    looking.many[row], looking.bound[row] = wanted, looking.square[wanted - 1]


@inner_kernel
def _begin(
    blocks: PointBlocks, begin: int, end: int, count: int, looking: Search
) -> tuple[Vector, Vector]:
    """Bound how far neighbours are by some blocks; gives the corners of the box around `which`."""
    low, high, far = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf), 0.0
    listed, near, wanted = 0, looking.near, looking.found.shape[1]
    for n in range(begin * BLOCK, min(end * BLOCK, blocks.place.shape[0])):
        for c in range(3):
            near[c, listed] = blocks.place[n, c]
        listed += 1
    for row in range(count):
        looking.many[row] = 0
        for c in range(3):
            looking.place[c, row] = blocks.place[looking.which[row], c]
        here = _place(looking, row)
        low = min(low[0], here[0]), min(low[1], here[1]), min(low[2], here[2])
        high = max(high[0], here[0]), max(high[1], here[1]), max(high[2], here[2])
    for c in range(3):
        least, most = low[c], high[c]
        for block in range(begin, end):
            least = min(least, float(blocks.low[block, c]))
            most = max(most, float(blocks.high[block, c]))
        far += (most - least) * (most - least)
    guess = far
    for row in range(count):
        _measure(near, _place(looking, row), listed, looking.gap)
        guess = _bounded(looking.gap, listed, wanted, guess, far)
        looking.bound[row] = guess
    return low, high


@inner_kernel
def _hold(looking: Search, row: int, listed: int) -> None:
    """Hold those of the listed points that may be neighbours."""
    gap, names, wanted = looking.gap, looking.listed, looking.found.shape[1]
    _measure(looking.near, _place(looking, row), listed, gap)
    bound = looking.bound[row]
    inside = _within(gap, listed, bound)
    if inside > wanted + SPARE:
        bound = _bounded(gap, listed, wanted, 0.9 * bound, bound)
        looking.bound[row] = bound
        inside = _within(gap, listed, bound)
    many, picked, total = looking.many[row], looking.picked, 0
    for n in range(listed):
        picked[total] = n
        total += int(gap[n] <= bound)
    for k in range(inside):
        if many > HELD - 1:
            looking.many[row] = many
            _let_go(looking, row)
            many = looking.many[row]
        n = picked[k]
        looking.away[row, many], looking.held[row, many] = gap[n], names[n]
        many += 1
    looking.many[row] = many


@inner_kernel
def _look(count: int, listed: int, looking: Search) -> float:
    """Look at the listed points; gives the square of a distance that all neighbours are within."""
    most = 0.0
    for row in range(count):
        _hold(looking, row, listed)
        most = max(most, looking.bound[row])
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
        `found` is filled, (count, k). There are at least k points.
    """
    beside = 3 + looking.found.shape[1] // (2 * BLOCK)
    begin = max(0, min(block - beside, blocks.first[1] - 2 * beside - 1))
    end = min(blocks.first[1], begin + 2 * beside + 1)
    low, high = _begin(blocks, begin, end, count, looking)
    stack, farthest, listed = looking.stack, 0.0, 0
    for row in range(count):
        farthest = max(farthest, looking.bound[row])
    stack[0, 0], stack[0, 1], waiting, beyond = 0, blocks.first.size - 2, 1, -1
    while waiting > 0:
        if waiting == beyond and listed > 0:  # what is around the block has been listed
            farthest, listed, beyond = _look(count, listed, looking), 0, -1
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        if size == 0:
            listed = _take(blocks, node, (low, high), farthest, listed, looking)
            if listed > LISTED - BLOCK:
                farthest, listed = _look(count, listed, looking), 0
            continue
        own = block >> (SHIFT * (size - 1))  # the child that holds the block: it comes first
        if size == AROUND and node == own >> SHIFT:
            beyond = waiting
        before = blocks.first[size - 1]
        for child in range(node * FAN, min(node * FAN + FAN, blocks.first[size] - before)):
            if child != own and _apart(blocks, before + child, low, high) <= farthest:
                stack[waiting, 0], stack[waiting, 1] = child, size - 1
                waiting += 1
        if own >> SHIFT == node:
            stack[waiting, 0], stack[waiting, 1] = own, size - 1
            waiting += 1
    _look(count, listed, looking)
    for row in range(count):
        _settle(looking, row)
