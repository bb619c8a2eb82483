"""Nearest neighbours of points along a Morton curve, block by block, and discs from them.

Sixteen consecutive points are a block, eight blocks one of the next size, and so on up to one that
holds all. Eight blocks share a list of the points around them, within the distance at which the
previous eight found theirs. Each block filters that list by its own box; each of its points keeps
candidates within its own bound, and ranks them by counting how many are nearer. Where the list has
too few points, or would have too many, the block and its neighbours on the curve bound the
distance, and the tree of blocks is searched within that. Distances and boxes are rounded alike, and
rounding is monotonic: results are exact for any guess. Of equally distant points the first along
the curve counts as nearer.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, inner_kernel, kernel, parallel_kernel, tasks
from resample.engine.vectors import Vector
from resample.types import Doubles, Floats
from resample_points.kernels.cells import Nearest, measure, no_lines

Numbers = NDArray[np.int64]
Box = tuple[Vector, Vector]  # least and greatest corner

BLOCK = 16  # points
SHIFT = 3
FAN = 1 << SHIFT  # children of a block
GROUP = FAN * BLOCK  # points with a joint search for neighbours
BLOCK_MARGIN = 2  # size of the block around which the search first stays
DEEPEST = 12  # sizes of blocks: enough for 16 × 8¹¹ points
AROUND = 2048  # points around a group, in a list
NEAR = 512  # points around a block, in a list
HELD = 192  # candidates of a point
LANES = 16  # numbers that are compared at a time
SPARE = 3  # points within a bound beyond those wanted
LIKELY = 0.9  # of a bound with too many points within it: the first guess of a closer one
NARROWED = 8  # steps at most that narrow a bound


class PointBlocks(NamedTuple):
    """N points along a curve, all different, and the boxes around blocks of them."""

    place: Floats  # (N, 3)
    low: Floats  # (3, M) least coordinates of blocks, the smallest first
    high: Floats  # (3, M) greatest
    first: Numbers  # (sizes + 1,) where the blocks of a size begin


class Listed(NamedTuple):
    """List of points to visit."""

    name: Numbers  # (M,) which points
    place: Doubles  # (3, M) their places


class Search(NamedTuple):
    """Scratch of a thread that searches the neighbours of up to `GROUP` points."""

    which: Numbers  # (GROUP,) the points
    found: Numbers  # (GROUP, k) their neighbours, the nearest first
    around: Listed  # `AROUND` points around them
    near: Listed  # `NEAR` points around a block's
    place: Doubles  # (3, BLOCK) places of a block's points
    bound: Doubles  # (BLOCK,) squares of distances that their neighbours do not exceed
    many: Numbers  # (BLOCK,) number of candidates
    held: Numbers  # (BLOCK, HELD) candidates
    away: Doubles  # (BLOCK, HELD) squares of their distances
    rank: Numbers  # (HELD,) number of candidates that are nearer
    order: Numbers  # (HELD,) candidates, the nearest first
    square: Doubles  # (HELD,) squares of their distances
    gap: Doubles  # (AROUND,) squares of distances
    picked: Numbers  # (AROUND + 1,) indices of squares within a bound
    stack: Numbers  # (DEEPEST * FAN, 2) blocks to visit, and their sizes


def blocks_of(place: Floats) -> PointBlocks:
    """Build the tree of blocks around at least one point (N, 3)."""
    # Reduce the boxes of points to blocks of 16, then by eights up to one that holds all.
    lows, highs, step = [place], [place], BLOCK
    while len(lows[-1]) > 1:
        starts = np.arange(0, len(lows[-1]), step)
        lows.append(np.minimum.reduceat(lows[-1], starts, axis=0))
        highs.append(np.maximum.reduceat(highs[-1], starts, axis=0))
        step = FAN
    # Pad with empty boxes, so that eight can be read from any child on.
    lows, highs = lows[1:] or lows, highs[1:] or highs
    first = np.cumsum([0, *map(len, lows)]).astype(np.int64)
    none = np.full((FAN, 3), np.inf, np.float32)
    low, high = np.concatenate([*lows, none]), np.concatenate([*highs, -none])
    return PointBlocks(place, np.ascontiguousarray(low.T), np.ascontiguousarray(high.T), first)


@kernel
def search(count: int) -> Search:
    """Allocate a search of so many neighbours."""
    return Search(
        # Points and their neighbours.
        np.empty(GROUP, np.int64),
        np.empty((GROUP, count), np.int64),
        # Points around the group and around a block.
        Listed(np.empty(AROUND, np.int64), np.empty((3, AROUND))),
        Listed(np.empty(NEAR, np.int64), np.empty((3, NEAR))),
        # Candidates of a block's points.
        np.empty((3, BLOCK)),
        np.empty(BLOCK),
        np.empty(BLOCK, np.int64),
        np.empty((BLOCK, HELD), np.int64),
        np.empty((BLOCK, HELD)),
        # Sorting, filtering, and the stack of the tree.
        np.empty(HELD, np.int64),
        np.empty(HELD, np.int64),
        np.empty(HELD),
        np.empty(AROUND),
        np.empty(AROUND + 1, np.int64),
        np.empty((DEEPEST * FAN, 2), np.int64),
    )


@inner_kernel
def _between(low: float, high: float, start: float, stop: float) -> float:
    """Distance between two intervals; 0 if they overlap."""
    return max(low - stop, start - high, 0.0)


@inner_kernel
def _apart(blocks: PointBlocks, first: int, box: Box, gap: Doubles) -> None:
    """Squared distances of `FAN` consecutive blocks from a box."""
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
    """Append a block's points near a box to a list; return its length."""
    (x0, y0, z0), (x1, y1, z1) = box
    start, taken = block * BLOCK, 0
    points, name, place = (
        blocks.place[start : start + BLOCK],
        into.name[count:],
        into.place[:, count:],
    )
    # Measure all distances, which vectorizes.
    for n in range(len(points)):
        x = _between(float(points[n, 0]), float(points[n, 0]), x0, x1)
        y = _between(float(points[n, 1]), float(points[n, 1]), y0, y1)
        z = _between(float(points[n, 2]), float(points[n, 2]), z0, z1)
        gap[n] = x * x + y * y + z * z
    # Write every point, and advance only past those within: no branch.
    for n in range(len(points)):
        place[0, taken], place[1, taken], place[2, taken] = points[n, 0], points[n, 1], points[n, 2]
        name[taken] = start + n
        taken += int(gap[n] <= far)
    return count + taken


@inner_kernel
def _list(blocks: PointBlocks, box: Box, far: float, looking: Search) -> int:
    """List the points near a box; count them, 0 if there are too many."""
    stack, gap = looking.stack, looking.square
    stack[0, 0], stack[0, 1], waiting, count = 0, blocks.first.size - 2, 1, 0
    # Descend from the root.
    while waiting > 0:
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        # Take the points of the smallest blocks.
        if size == 0:
            if count > AROUND - BLOCK:
                return 0
            count = _take(blocks, node, box, far, count, looking.around, looking.gap)
            continue
        # Push the children that are near enough.
        before, child = blocks.first[size - 1], node * FAN
        _apart(blocks, before + child, box, gap)
        for n in range(min(FAN, blocks.first[size] - before - child)):
            stack[waiting, 0], stack[waiting, 1] = child + n, size - 1
            waiting += int(gap[n] <= far)
    return count


@inner_kernel
def _pick(gap: Doubles, count: int, bound: float, picked: Numbers) -> int:
    """Find the indices of squares within a bound, branch-free; return their number."""
    total = 0
    for n in range(count):
        picked[total] = n
        total += int(gap[n] <= bound)
    return total


@inner_kernel
def _choose(box: Box, far: float, count: int, looking: Search) -> int:
    """Filter the group's list by a block's box; count, 0 if there are too many."""
    (x0, y0, z0), (x1, y1, z1) = box
    place, gap, picked = looking.around.place, looking.gap, looking.picked
    # Measure the distances from the box.
    for n in range(count):
        x = _between(place[0, n], place[0, n], x0, x1)
        y = _between(place[1, n], place[1, n], y0, y1)
        z = _between(place[2, n], place[2, n], z0, z1)
        gap[n] = x * x + y * y + z * z
    total = _pick(gap, count, far, picked)
    if total > NEAR:
        return 0
    # Copy the points within.
    name, near = looking.near.name, looking.near.place
    for k in range(total):
        n = picked[k]
        name[k] = looking.around.name[n]
        near[0, k], near[1, k], near[2, k] = place[0, n], place[1, n], place[2, n]
    return total


@inner_kernel
def _measure(near: Doubles, here: Vector, count: int, gap: Doubles) -> None:
    """Squared distances of listed points from one place."""
    for n in range(count):
        x, y, z = near[0, n] - here[0], near[1, n] - here[1], near[2, n] - here[2]
        gap[n] = x * x + y * y + z * z


@inner_kernel
def _within(gap: Doubles, count: int, bound: float) -> int:
    """Count the squares within a bound."""
    total = 0
    for n in range(count):
        total += int(gap[n] <= bound)
    return total


@inner_kernel
def _bounded(gap: Doubles, count: int, wanted: int, guess: float, far: float) -> float:
    """Narrow a bound to few more squares than wanted; `far` if that has too few."""
    low, few, high, many = 0.0, 0, far, count
    bound = guess
    # Narrow the bracket until few more than wanted are inside.
    for _ in range(NARROWED):
        inside = _within(gap, count, bound)
        if inside < wanted:
            low, few = bound, inside
        else:
            high, many = bound, inside
            if many <= wanted + SPARE:
                break
        # Interpolate linearly between the counts.
        bound = low + (high - low) * (wanted + 0.5 * SPARE - few) / max(1, many - few)
        if not low < bound < high:
            break
    return high


@inner_kernel
def _place(looking: Search, row: int) -> Vector:
    """Place of one of a block's points."""
    return looking.place[0, row], looking.place[1, row], looking.place[2, row]


@inner_kernel
def _rank(away: Doubles, held: Numbers, many: int, rank: Numbers) -> None:
    """Rank candidates by distance; equal distances rank by the order along the curve."""
    # Fill the last lane with infinity.
    lanes = (many + LANES - 1) // LANES * LANES
    for n in range(many, lanes):
        away[n] = np.inf
    # Count the nearer ones of each, by all pairs: branch-free for SIMD.
    for n in range(many):
        d, nearer = away[n], 0
        for m in range(lanes):
            nearer += int(away[m] < d)
        rank[n] = nearer
    # If all ranks differ, none are equally far: their sum is 0 + … + (many − 1).
    total = 0
    for n in range(many):
        total += rank[n]
    if 2 * total == many * (many - 1):
        return
    # Break ties by the order along the curve.
    for n in range(many):
        d, who = away[n], held[n]
        for m in range(many):
            rank[m] += int((d == away[m]) & (who < held[m]))


@inner_kernel
def _settle(looking: Search, row: int, found: Numbers) -> None:
    """Sort a point's candidates; write the nearest as its neighbours."""
    away, held, many = looking.away[row], looking.held[row], looking.many[row]
    rank, order, square = looking.rank, looking.order, looking.square
    _rank(away, held, many, rank)
    for n in range(many):
        order[rank[n]], square[rank[n]] = held[n], away[n]
    for n in range(found.size):
        found[n] = order[n]


@inner_kernel
def _box(blocks: PointBlocks, which: Numbers, count: int) -> Box:
    """Box around some points."""
    low, high = (np.inf, np.inf, np.inf), (-np.inf, -np.inf, -np.inf)
    for row in range(count):
        n = which[row]
        here = float(blocks.place[n, 0]), float(blocks.place[n, 1]), float(blocks.place[n, 2])
        low = min(low[0], here[0]), min(low[1], here[1]), min(low[2], here[2])
        high = max(high[0], here[0]), max(high[1], here[1]), max(high[2], here[2])
    return low, high


@inner_kernel
def _bound(blocks: PointBlocks, block: int, wanted: int) -> float:
    """Squared distance within which a block's neighbours on the curve are enough."""
    # Take so many blocks beside it that all points in their box are enough.
    beside, square = 1 + wanted // BLOCK, 0.0
    begin = max(0, min(block - beside, blocks.first[1] - 2 * beside - 1))
    end = min(blocks.first[1], begin + 2 * beside + 1)
    # The box's diagonal bounds all distances.
    for c in range(3):
        least, most = np.inf, -np.inf
        for n in range(begin, end):
            least = min(least, float(blocks.low[c, n]))
            most = max(most, float(blocks.high[c, n]))
        square += (most - least) * (most - least)
    return square


@inner_kernel
def _hold(looking: Search, row: int, count: int, found: Numbers) -> None:
    """Add a block's listed points to the candidates of one of its points."""
    # Measure the distances, and narrow the bound if too many are within.
    gap, name, enough = looking.gap, looking.near.name, found.size + SPARE
    _measure(looking.near.place, _place(looking, row), count, gap)
    bound = looking.bound[row]
    inside = _within(gap, count, bound)
    if inside > enough:
        bound = _bounded(gap, count, found.size, LIKELY * bound, bound)
        looking.bound[row] = bound
    # Add those within the bound; when the list is full, keep only the nearest.
    picked = looking.picked
    total = _pick(gap, count, bound, picked)
    many, away, held = looking.many[row], looking.away[row], looking.held[row]
    for k in range(total):
        if many == HELD:
            looking.many[row] = many
            _settle(looking, row, found)
            for n in range(found.size):
                looking.held[row, n], looking.away[row, n] = found[n], looking.square[n]
            looking.bound[row], many = looking.square[found.size - 1], found.size
        away[many], held[many] = gap[picked[k]], name[picked[k]]
        many += 1
    looking.many[row] = many


@inner_kernel
def _search(looking: Search, first: int, count: int, listed: int) -> float:
    """Visit the points near; return the squared distance that bounds all neighbours."""
    most = 0.0
    for row in range(count):
        _hold(looking, row, listed, looking.found[first + row])
        most = max(most, looking.bound[row])
    return most


@inner_kernel
def _search_near(
    looking: Search, first: int, count: int, box: Box, around: int, far: float
) -> float:
    """Find neighbours in the group's list; return their bound, inf if too few."""
    # Filter the list by the block's box.
    listed, wanted = _choose(box, far, around, looking), looking.found.shape[1]
    if listed < wanted:
        return np.inf
    # Start without candidates, within the guess.
    for row in range(count):
        looking.many[row], looking.bound[row] = 0, far
    most = _search(looking, first, count, listed)
    # A point with too few candidates needs a wider search.
    for row in range(count):
        if looking.many[row] < wanted:
            return np.inf
    return most


@inner_kernel
def _search_far(
    blocks: PointBlocks, block: int, looking: Search, first: int, count: int, box: Box
) -> float:
    """Find the neighbours of a block's points in the whole tree; return their bound."""
    # Start with the bound from neighbouring blocks, and without candidates.
    stack, gap, listed = looking.stack, looking.square, 0
    farthest = _bound(blocks, block, looking.found.shape[1])
    for row in range(count):
        looking.many[row], looking.bound[row] = 0, farthest

    # Descend from the root, nearest child first.
    stack[0, 0], stack[0, 1], waiting, beyond = 0, blocks.first.size - 2, 1, -1
    while waiting > 0:
        # Once the surroundings of the block have been listed, tighten the bound before going on.
        if waiting == beyond and listed > 0:
            farthest, listed, beyond = _search(looking, first, count, listed), 0, -1
        waiting -= 1
        node, size = stack[waiting, 0], stack[waiting, 1]
        # List the points of the smallest blocks; visit them when the list is full.
        if size == 0:
            listed = _take(blocks, node, box, farthest, listed, looking.near, looking.gap)
            if listed > NEAR - BLOCK:
                farthest, listed = _search(looking, first, count, listed), 0
            continue
        # Note where the surroundings of the block begin on the stack.
        own = block >> (SHIFT * (size - 1))
        if size == BLOCK_MARGIN and node == own >> SHIFT:
            beyond = waiting
        # Push the children within the bound; the one that holds the block comes last, to be first.
        before, child = blocks.first[size - 1], node * FAN
        _apart(blocks, before + child, box, gap)
        for n in range(min(FAN, blocks.first[size] - before - child)):
            stack[waiting, 0], stack[waiting, 1] = child + n, size - 1
            waiting += int((gap[n] <= farthest) & (child + n != own))
        if own >> SHIFT == node:
            stack[waiting, 0], stack[waiting, 1] = own, size - 1
            waiting += 1
    return _search(looking, first, count, listed)


@inner_kernel
def nearest_neighbours(blocks: PointBlocks, count: int, guess: float, looking: Search) -> float:
    """Find the nearest neighbours of some points, themselves included.

    `blocks`: all points. `count`: number of points in `looking.which`; they are consecutive along
    the curve, and should lie in `FAN` blocks. `guess`: square of a distance that neighbours are
    probably within; 0 if unknown. Results do not depend on it. `looking`: `found` is filled,
    (count, k). There are at least k points. Result: square of a distance that all neighbours are
    within.
    """
    # List the points around the group within the guess.
    around, most, first = 0, 0.0, 0
    if guess > 0.0:
        around = _list(blocks, _box(blocks, looking.which, count), guess, looking)
    while first < count:
        # Take the points of one block.
        some, which = 1, looking.which[first:]
        while first + some < count and which[some] // BLOCK == which[0] // BLOCK:
            some += 1
        for row in range(some):
            for c in range(3):
                looking.place[c, row] = blocks.place[which[row], c]
        # Search the list, and the whole tree if the guess was too small.
        box, bound = _box(blocks, which, some), np.inf
        if around > 0:
            bound = _search_near(looking, first, some, box, around, guess)
        if bound > guess:
            bound = _search_far(blocks, which[0] // BLOCK, looking, first, some, box)
        # Sort the candidates.
        for row in range(some):
            _settle(looking, row, looking.found[first + row])
        most, first = max(most, bound), first + some
    return most


BATCH_SIZE = 2048  # points that a thread takes at a time
MARGIN = 1.15  # factor from the squared distance that was enough to the next guess


@parallel_kernel
def measure_all(
    counter: Counter,
    blocks: PointBlocks,
    least: int,
    most: int,
    normal: Floats,
    axes: Floats,
    spacing: Floats,
    nearest: Nearest,
) -> None:
    """Measure the normals and discs of all points.

    `blocks`: N points along a Morton curve. `least`, `most`: at most N neighbours, each point
    included as its own first one; `most` for points around which the least leave a gap. `normal`:
    (N, 3) scaled to unit length; filled where it is 0, with an arbitrary sign. `axes`, `spacing`:
    filled, see `measure`. `nearest`: (N, least − 1) filled: the neighbours of each point, without
    itself.
    """
    place, is_last = blocks.place, least == most
    for chunk in tasks(counter, (place.shape[0] + BATCH_SIZE - 1) // BATCH_SIZE):
        few, many = search(least), search(most)
        lines, likely, wider = no_lines(), 0.0, 0.0
        start = int(np.int64(chunk)) * BATCH_SIZE
        for first in range(start, min(start + BATCH_SIZE, place.shape[0]), GROUP):
            # Find few neighbours of a group of points.
            count, gaps = min(GROUP, place.shape[0] - first), 0
            for row in range(count):
                few.which[row] = first + row
            likely = MARGIN * nearest_neighbours(blocks, count, likely, few)
            # Measure the points, and collect those with a gap around.
            for row in range(count):
                for k in range(nearest.shape[1]):
                    nearest[first + row, k] = few.found[row, k + 1]
                is_open = measure(place, few.found, row, is_last, lines, normal, axes, spacing)
                if is_open and not is_last:
                    many.which[gaps] = first + row
                    gaps += 1
            # Measure these with more neighbours.
            if gaps > 0:
                wider = MARGIN * nearest_neighbours(blocks, gaps, wider, many)
                for row in range(gaps):
                    measure(place, many.found, row, True, lines, normal, axes, spacing)
