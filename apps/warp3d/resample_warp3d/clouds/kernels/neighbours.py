"""Nearest neighbours of points that lie along a Morton curve, found block by block.

Sixteen points that follow each other are a block, eight blocks one of the next size, and so on up
to one that holds all. Eight blocks list together what lies around them, as far as neighbours of the
eight before were; each of them takes of that list what lies around itself, and each of its points
holds what is within a bound of its own, put in order by counting, of each, how many are nearer.
Where that list has too few, or would have too many, the block and those beside it on the curve say
how far the nearest are at most, and all blocks are looked at whose boxes are not farther. Distances
and boxes are rounded alike, and rounding keeps order, so that what is found is exact, whatever was
guessed. Of points that are equally far the first along the curve is nearer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, kernel
from resample.engine.vectors import Vector
from resample.types import Doubles, Floats

Numbers = NDArray[np.int64]
Box = tuple[Vector, Vector]  # its corners

BLOCK = 16  # points
SHIFT = 3
FAN = 1 << SHIFT  # blocks of a larger one
GROUP = FAN * BLOCK  # points whose neighbours are looked for together
BEYOND = 2  # sizes larger is the block in which neighbours are looked for at first
DEEPEST = 12  # sizes of blocks: enough for 16 × 8¹¹ points
AROUND = 2048  # points around a group that are listed
NEAR = 512  # points around a block that are looked at together
HELD = 192  # points that may be a point's neighbours
LANES = 16  # numbers that are compared at a time
SPARE = 3  # points more than are wanted that a bound may have within it
LIKELY = 0.9  # of a bound with too many within it: the first that is tried
NARROWED = 8  # times at most that a bound is made closer


class PointBlocks(NamedTuple):
    """N points along a curve, all different, and the boxes around blocks of them."""

    place: Floats  # (N, 3)
    low: Floats  # (3, M) least coordinates of blocks, the smallest first
    high: Floats  # (3, M) greatest
    first: Numbers  # (sizes + 1,) where the blocks of a size begin


class Listed(NamedTuple):
    """Points to look at."""

    name: Numbers  # (M,) which points
    place: Doubles  # (3, M) where they are


class Search(NamedTuple):
    """What a thread looks for the neighbours of up to `GROUP` points with."""

    which: Numbers  # (GROUP,) the points
    found: Numbers  # (GROUP, k) their neighbours, the nearest first
    around: Listed  # `AROUND` points around them
    near: Listed  # `NEAR` points around those of a block
    place: Doubles  # (3, BLOCK) where these are
    bound: Doubles  # (BLOCK,) squares of distances that their neighbours do not exceed
    many: Numbers  # (BLOCK,) how many points are held
    held: Numbers  # (BLOCK, HELD) which points
    away: Doubles  # (BLOCK, HELD) squares of their distances
    rank: Numbers  # (HELD,) how many of them are nearer
    order: Numbers  # (HELD,) these points, the nearest first
    square: Doubles  # (HELD,) squares of their distances
    gap: Doubles  # (AROUND,) squares of distances
    picked: Numbers  # (AROUND + 1,) which of some are within a bound
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
    first = np.cumsum([0, *map(len, lows)]).astype(np.int64)
    none = np.full((FAN, 3), np.inf, np.float32)
    low, high = np.concatenate([*lows, none]), np.concatenate([*highs, -none])
    return PointBlocks(place, np.ascontiguousarray(low.T), np.ascontiguousarray(high.T), first)


@kernel
def search(count: int) -> Search:
    """Room to look for so many neighbours."""
    return Search(
        np.empty(GROUP, np.int64),
        np.empty((GROUP, count), np.int64),
        Listed(np.empty(AROUND, np.int64), np.empty((3, AROUND))),
        Listed(np.empty(NEAR, np.int64), np.empty((3, NEAR))),
        np.empty((3, BLOCK)),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty((BLOCK, HELD), np.int64),
        np.empty((BLOCK, HELD)),
        np.empty(HELD, np.int64),
        np.empty(HELD, np.int64),
        np.empty(HELD),
        np.empty(AROUND),
        np.empty(AROUND + 1, np.int64),
        np.empty((DEEPEST * FAN, 2), np.int64),
    )


@inner_kernel
def _between(low: float, high: float, start: float, stop: float) -> float:
    """Distance of two intervals."""
    return max(low - stop, start - high, 0.0)


@inner_kernel
def _apart(blocks: PointBlocks, first: int, box: Box, gap: Doubles) -> None:
    """Squares of the distances of `FAN` blocks, which follow each other, from a box."""
    (x0, y0, z0), (x1, y1, z1) = box
    low, high = blocks.low, blocks.high
    for n in range(FAN):
        m = first + n
        x = _between(float(low[0, m]), float(high[0, m]), x0, x1)
        y = _between(float(low[1, m]), float(high[1, m]), y0, y1)
        z = _between(float(low[2, m]), float(high[2, m]), z0, z1)
        gap[n] = x * x + y * y + z * z


@inner_kernel
def _take(
    blocks: PointBlocks, block: int, box: Box, far: float, count: int, into: Listed, gap: Doubles
) -> int:
    """Put those points of a block into a list that are not far from a box; how many it has."""
    (x0, y0, z0), (x1, y1, z1) = box
    start, taken = block * BLOCK, 0
    points, name, place = (
        blocks.place[start : start + BLOCK],
        into.name[count:],
        into.place[:, count:],
    )
    for n in range(len(points)):
        x = _between(float(points[n, 0]), float(points[n, 0]), x0, x1)
        y = _between(float(points[n, 1]), float(points[n, 1]), y0, y1)
        z = _between(float(points[n, 2]), float(points[n, 2]), z0, z1)
        gap[n] = x * x + y * y + z * z
    for n in range(len(points)):
        place[0, taken], place[1, taken], place[2, taken] = points[n, 0], points[n, 1], points[n, 2]
        name[taken] = start + n
        taken += int(gap[n] <= far)
    return count + taken


@inner_kernel
def _list(blocks: PointBlocks, box: Box, far: float, looking: Search) -> int:
    """List the points around that are not far from a box; how many, 0 if they are too many."""
    stack, gap = looking.stack, looking.square
    stack[0, 0], stack[0, 1], waiting, count = 0, blocks.first.size - 2, 1, 0
    while waiting > 0:
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        if size == 0:
            if count > AROUND - BLOCK:
                return 0
            count = _take(blocks, node, box, far, count, looking.around, looking.gap)
            continue
        before, child = blocks.first[size - 1], node * FAN
        _apart(blocks, before + child, box, gap)
        for n in range(min(FAN, blocks.first[size] - before - child)):
            stack[waiting, 0], stack[waiting, 1] = child + n, size - 1
            waiting += int(gap[n] <= far)
    return count


@inner_kernel
def _pick(gap: Doubles, count: int, bound: float, picked: Numbers) -> int:
    """Find which of some squares are not above a bound; how many."""
    total = 0
    for n in range(count):
        picked[total] = n
        total += int(gap[n] <= bound)
    return total


@inner_kernel
def _choose(box: Box, far: float, count: int, looking: Search) -> int:
    """List those around as near that are not far from a box; how many, 0 if they are too many."""
    (x0, y0, z0), (x1, y1, z1) = box
    place, gap, picked = looking.around.place, looking.gap, looking.picked
    for n in range(count):
        x = _between(place[0, n], place[0, n], x0, x1)
        y = _between(place[1, n], place[1, n], y0, y1)
        z = _between(place[2, n], place[2, n], z0, z1)
        gap[n] = x * x + y * y + z * z
    total = _pick(gap, count, far, picked)
    if total > NEAR:
        return 0
    name, near = looking.near.name, looking.near.place
    for k in range(total):
        n = picked[k]
        name[k] = looking.around.name[n]
        near[0, k], near[1, k], near[2, k] = place[0, n], place[1, n], place[2, n]
    return total


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
def _rank(away: Doubles, held: Numbers, many: int, rank: Numbers) -> None:
    """Count how many of the points that are held are nearer than each, or as near and before it."""
    lanes = (many + LANES - 1) // LANES * LANES
    for n in range(many, lanes):
        away[n] = np.inf
    for n in range(many):
        d, nearer = away[n], 0
        for m in range(lanes):
            nearer += int(away[m] < d)
        rank[n] = nearer
    total = 0
    for n in range(many):
        total += rank[n]
    if 2 * total == many * (many - 1):
        return  # none are equally far
    for n in range(many):
        d, who = away[n], held[n]
        for m in range(many):
            rank[m] += int((d == away[m]) & (who < held[m]))


@inner_kernel
def _settle(looking: Search, row: int, found: Numbers) -> None:
    """Put the nearest of the points that are held in order."""
    away, held, many = looking.away[row], looking.held[row], looking.many[row]
    rank, order, square = looking.rank, looking.order, looking.square
    _rank(away, held, many, rank)
    for n in range(many):
        order[rank[n]], square[rank[n]] = held[n], away[n]
    for n in range(found.size):
        found[n] = order[n]


@inner_kernel
def _let_go(looking: Search, row: int, found: Numbers) -> None:
    """Hold no points but the nearest."""
    _settle(looking, row, found)
    for n in range(found.size):
        looking.held[row, n], looking.away[row, n] = found[n], looking.square[n]
    looking.many[row], looking.bound[row] = found.size, looking.square[found.size - 1]


@inner_kernel
def _box(blocks: PointBlocks, which: Numbers, count: int) -> Box:
    """Corners of the box around some points."""
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for row in range(count):
        n = which[row]
        here = float(blocks.place[n, 0]), float(blocks.place[n, 1]), float(blocks.place[n, 2])
        low = min(low[0], here[0]), min(low[1], here[1]), min(low[2], here[2])
        high = max(high[0], here[0]), max(high[1], here[1]), max(high[2], here[2])
    return low, high


@inner_kernel
def _bound(blocks: PointBlocks, block: int, wanted: int) -> float:
    """Square of a distance that enough points are within, as blocks beside one on the curve say."""
    beside, square = 1 + wanted // BLOCK, 0.0
    begin = max(0, min(block - beside, blocks.first[1] - 2 * beside - 1))
    end = min(blocks.first[1], begin + 2 * beside + 1)
    for c in range(3):
        least, most = np.inf, -np.inf
        for n in range(begin, end):
            least = min(least, float(blocks.low[c, n]))
            most = max(most, float(blocks.high[c, n]))
        square += (most - least) * (most - least)
    return square


@inner_kernel
def _hold(looking: Search, row: int, count: int, found: Numbers) -> None:
    """Hold those of so many points near that may be neighbours."""
    gap, name, enough = looking.gap, looking.near.name, found.size + SPARE
    _measure(looking.near.place, _place(looking, row), count, gap)
    bound = looking.bound[row]
    inside = _within(gap, count, bound)
    if inside > enough:
        bound = _bounded(gap, count, found.size, LIKELY * bound, bound)
        looking.bound[row] = bound
    picked = looking.picked
    total = _pick(gap, count, bound, picked)
    many, away, held = looking.many[row], looking.away[row], looking.held[row]
    for k in range(total):
        if many == HELD:
            looking.many[row] = many
            _let_go(looking, row, found)
            many = looking.many[row]
        away[many], held[many] = gap[picked[k]], name[picked[k]]
        many += 1
    looking.many[row] = many


@inner_kernel
def _look(looking: Search, first: int, count: int, listed: int) -> float:
    """Look at the points near; gives the square of a distance that all neighbours are within."""
    most = 0.0
    for row in range(count):
        _hold(looking, row, listed, looking.found[first + row])
        most = max(most, looking.bound[row])
    return most


@inner_kernel
def _look_near(looking: Search, first: int, count: int, box: Box, around: int, far: float) -> float:
    """Find neighbours that are not far; gives what all are within, infinity if some are not."""
    listed, wanted = _choose(box, far, around, looking), looking.found.shape[1]
    if listed < wanted:
        return np.inf
    for row in range(count):
        looking.many[row], looking.bound[row] = 0, far
    most = _look(looking, first, count, listed)
    for row in range(count):
        if looking.many[row] < wanted:
            return np.inf
    return most


@inner_kernel
def _look_far(
    blocks: PointBlocks, block: int, looking: Search, first: int, count: int, box: Box
) -> float:
    """Find neighbours of points of a block, however far they are; gives what all are within."""
    stack, gap, listed = looking.stack, looking.square, 0
    farthest = _bound(blocks, block, looking.found.shape[1])
    for row in range(count):
        looking.many[row], looking.bound[row] = 0, farthest
    stack[0, 0], stack[0, 1], waiting, beyond = 0, blocks.first.size - 2, 1, -1
    while waiting > 0:
        if waiting == beyond and listed > 0:  # what is around the block has been listed
            farthest, listed, beyond = _look(looking, first, count, listed), 0, -1
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        if size == 0:
            listed = _take(blocks, node, box, farthest, listed, looking.near, looking.gap)
            if listed > NEAR - BLOCK:
                farthest, listed = _look(looking, first, count, listed), 0
            continue
        own = block >> (SHIFT * (size - 1))  # the child that holds the block: it comes first
        if size == BEYOND and node == own >> SHIFT:
            beyond = waiting
        before, child = blocks.first[size - 1], node * FAN
        _apart(blocks, before + child, box, gap)
        for n in range(min(FAN, blocks.first[size] - before - child)):
            stack[waiting, 0], stack[waiting, 1] = child + n, size - 1
            waiting += int((gap[n] <= farthest) & (child + n != own))
        if own >> SHIFT == node:
            stack[waiting, 0], stack[waiting, 1] = own, size - 1
            waiting += 1
    return _look(looking, first, count, listed)


@inner_kernel
def _of_one_block(which: Numbers, first: int, count: int) -> int:
    """How many points from the first on lie in one block."""
    last = first + 1
    while last < count and which[last] // BLOCK == which[first] // BLOCK:
        last += 1
    return last - first


@inner_kernel
def look_around(blocks: PointBlocks, count: int, guess: float, looking: Search) -> float:
    """Find the nearest points of some points, themselves among them.

    Parameters
    ----------
    blocks
        All points.
    count
        How many of `looking.which` there are; they follow each other along the curve, and should
        lie in `FAN` blocks.
    guess
        Square of a distance that they may be within; 0 if it is unknown. What is found does not
        depend on it.
    looking
        `found` is filled, (count, k). There are at least k points.

    Returns
    -------
    Square of a distance that they are within.
    """
    around, most, first = 0, 0.0, 0
    if guess > 0.0:
        around = _list(blocks, _box(blocks, looking.which, count), guess, looking)
    while first < count:
        some, which = _of_one_block(looking.which, first, count), looking.which[first:]
        for row in range(some):
            for c in range(3):
                looking.place[c, row] = blocks.place[which[row], c]
        box, bound = _box(blocks, which, some), np.inf
        if around > 0:
            bound = _look_near(looking, first, some, box, around, guess)
        if bound > guess:
            bound = _look_far(blocks, which[0] // BLOCK, looking, first, some, box)
        for row in range(some):
            _settle(looking, row, looking.found[first + row])
        most, first = max(most, bound), first + some
    return most
