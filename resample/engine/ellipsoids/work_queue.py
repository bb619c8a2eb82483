"""Samples that a tile has taken and not painted yet: a queue, and the part whose turn it is.

They wait as pairs of key and number. What painting needs of them is computed once their order is
known, batch by batch, as columns of numbers (see `resample.engine.ellipsoids.outlines`).
"""

from typing import NamedTuple

import numpy as np

from resample.engine.ellipsoids.outlines import (
    BATCH,
    BLUE,
    EXTINCTION,
    GREEN,
    RED,
    SCRATCH_SIZE,
    SIZE,
    A,
    B,
    C,
    X,
    Y,
)
from resample.engine.ellipsoids.rows import Members
from resample.engine.jit import kernel, load_soon
from resample.engine.sorting import FEW, HALF, Pairs, bits_of, member_of, settle
from resample.types import Floats, Samples, Single

LINE = 16  # numbers in a line of the cache
TIE_BREAKERS = 9  # numbers that decide the order of samples of equal key


@kernel
def take(
    queue: Pairs, waiting: int, pair: Pairs, count: int, farthest: np.uint64
) -> tuple[int, np.uint64]:
    """Append the pairs that are not 0 to the queue; return its length, and the largest pair.

    The queue must have space for one more than all of them.
    """
    for n in range(count):
        # Write always and advance only if wanted: no branch to mispredict.
        found = pair[np.uint64(n)]
        queue[np.uint64(waiting)] = found
        waiting += 1 if found > np.uint64(0) else 0
        farthest = max(farthest, found)
    return waiting, farthest


@kernel
def prefetch(position: Floats, extinction: Floats, color: Floats, begin: int, count: int) -> None:
    """Prefetch samples of which all numbers will be needed soon; positions and colors are flat."""
    # Once per cache line.
    for n in range(3 * begin, 3 * (begin + count), LINE):
        load_soon(position, n)
        load_soon(color, n)
    for n in range(begin, begin + count, LINE):
        load_soon(extinction, n)


class WorkQueue(NamedTuple):
    """The queue of a tile, the samples whose turn it is, and scratch."""

    # Queue, part that is ready, and scratch of the sort.
    waiting: Pairs  # (M,)
    ready: Pairs  # (M,)
    other: Pairs  # (M,)
    offset: Members  # (M,) where in `scratch` each ready sample begins
    scratch: Floats  # (M / BATCH * ROOM,) batches of columns
    found: Pairs  # (BATCH,) scratch
    outline: Floats  # (ROOM,) scratch


@kernel
def new_queue(most: int) -> WorkQueue:
    """Allocate a pool for `most` samples, a multiple of BATCH."""
    # Samples without sizes have size 1.
    scratch = np.empty(most // BATCH * SCRATCH_SIZE, np.float32)
    for first in range(0, scratch.size, SCRATCH_SIZE):
        for n in range(BATCH):
            scratch[np.uint64(first + n) + SIZE] = np.float32(1.0)
    return WorkQueue(
        np.empty(most, np.uint64),
        np.empty(most, np.uint64),
        np.empty(most, np.uint64),
        np.empty(most, np.int32),
        scratch,
        np.empty(BATCH, np.uint64),
        np.empty(SCRATCH_SIZE, np.float32),
    )


@kernel
def enlarged(queue: WorkQueue, waiting: int) -> WorkQueue:
    """The pool, or one of twice the size if at least half of this one is taken."""
    if 2 * waiting <= queue.waiting.size:
        return queue
    # Only the queue is carried over.
    larger = new_queue(2 * queue.waiting.size)
    for n in range(queue.waiting.size):
        larger.waiting[n] = queue.waiting[n]
    return larger


@kernel
def part(queue: Pairs, waiting: int, limit: Single, ready: Pairs) -> int:
    """Move pairs whose key is below `limit` from the queue to `ready`; return how many stay."""
    behind = ~np.uint64(0) if limit == np.inf else np.uint64(bits_of(limit)) << HALF
    # Partition in place without branches: write to both, and advance one.
    stay = taken = 0
    for n in range(waiting):
        found = queue[np.uint64(n)]
        ready[np.uint64(taken)] = found
        queue[np.uint64(stay)] = found
        taken += 1 if found < behind else 0
        stay += 0 if found < behind else 1
    return stay


@kernel
def gather(ready: Pairs, samples: Samples, position: Floats, scratch: Floats) -> None:
    """Gather positions (3 n,), extinctions and colors of the samples of one batch."""
    extinction, color = samples.extinction, samples.color.reshape(-1)
    of_samples = samples.position.reshape(-1)
    for n in range(ready.size):
        k, sample = np.uint64(n), np.uint64(member_of(ready[n]))
        # Scattered reads, contiguous writes.
        first, to = np.uint64(3) * sample, np.uint64(3) * k
        position[to] = of_samples[first]
        position[to + np.uint64(1)] = of_samples[first + np.uint64(1)]
        position[to + np.uint64(2)] = of_samples[first + np.uint64(2)]
        scratch[k + EXTINCTION] = extinction[sample]
        scratch[k + RED] = color[first]
        scratch[k + GREEN] = color[first + np.uint64(1)]
        scratch[k + BLUE] = color[first + np.uint64(2)]


@kernel
def _is_before(scratch: Floats, first: int, second: int) -> bool:
    """Whether the first of two samples of equal key comes first; the first difference decides."""
    s, other = np.uint64(first), np.uint64(second)
    for number in (Y, X, A, B, C, EXTINCTION, RED, GREEN, BLUE):
        if scratch[s + number] != scratch[other + number]:
            return bool(scratch[s + number] < scratch[other + number])
    return False


@kernel
def _settle_few(scratch: Floats, offset: Members, first: int, last: int) -> None:
    """Sort few samples of equal key by insertion."""
    for n in range(first + 1, last):
        moved, place = offset[n], n
        while place > first and _is_before(scratch, moved, offset[place - 1]):
            offset[place] = offset[place - 1]
            place -= 1
        offset[place] = moved


@kernel
def _settle_many(scratch: Floats, offset: Members) -> None:
    # Copy what decides into rows, sort indices by it, and permute the offsets.
    looks, order = (
        np.empty((offset.size, TIE_BREAKERS), np.float32),
        np.empty(offset.size, np.int32),
    )
    for n in range(offset.size):
        s = np.uint64(offset[n])
        looks[n, 0], looks[n, 1] = scratch[s + Y], scratch[s + X]
        looks[n, 2], looks[n, 3], looks[n, 4] = scratch[s + A], scratch[s + B], scratch[s + C]
        looks[n, 5], looks[n, 6] = scratch[s + EXTINCTION], scratch[s + RED]
        looks[n, 7], looks[n, 8] = scratch[s + GREEN], scratch[s + BLUE]
        order[n] = n
    settle(order, looks)
    for n in range(order.size):
        order[n] = offset[order[n]]
    for n in range(order.size):
        offset[n] = order[n]


@kernel
def put_in_order(ready: Pairs, scratch: Floats, offset: Members) -> None:
    """Fill in where in `scratch` samples sorted by key are; other numbers break ties."""
    # Sorted by key alone, sample n is the nth of the batches.
    for n in range(ready.size):
        offset[n] = n // BATCH * SCRATCH_SIZE + n % BATCH
    # Sort each run of equal keys by what else is known, so that the input's order is irrelevant.
    start = 0
    while start < ready.size:
        end = start + 1
        while end < ready.size and ready[end] >> HALF == ready[start] >> HALF:
            end += 1
        if end - start > FEW:
            _settle_many(scratch, offset[start:end])
        elif end - start > 1:
            _settle_few(scratch, offset, start, end)
        start = end
