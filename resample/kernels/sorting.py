"""Put a tile's samples in painting order, whatever order they came in."""

import numpy as np
from numpy.typing import NDArray

from resample.kernels.jit import kernel
from resample.types import Floats, Records, Single

Indices = NDArray[np.int32]
Keys = NDArray[np.uint32]

FEW = 48  # up to here insertion beats counting digits
DIGIT = 2048  # 11 bits: three passes over 32


@kernel
def _ascending(bits: np.uint32) -> np.uint32:
    """Map a float32's bits to an integer that sorts as the float does."""
    if bits >> np.uint32(31):
        return np.uint32(~bits)
    return np.uint32(bits | np.uint32(0x80000000))


@kernel
def _is_before(looks: Floats, first: int, second: int) -> bool:
    """Whether a row of `looks` (N, K) comes before another: what stands first decides first."""
    for column in range(looks.shape[1]):
        if looks[first, column] != looks[second, column]:
            return bool(looks[first, column] < looks[second, column])
    return False


@kernel
def _sift(looks: Floats, run: Indices, root: int, size: int) -> None:
    """Restore the heap below `root`: no child after its parent."""
    while 2 * root + 1 < size:
        child = 2 * root + 1
        if child + 1 < size and _is_before(looks, run[child], run[child + 1]):
            child += 1
        if not _is_before(looks, run[root], run[child]):
            return
        run[root], run[child] = run[child], run[root]
        root = child


@kernel
def settle(run: Indices, looks: Floats) -> None:
    """Put rows of `looks` (N, K), of which `run` holds numbers, in ascending order: heap sort."""
    ordered = True
    for n in range(1, run.size):
        if _is_before(looks, run[n], run[n - 1]):
            ordered = False
            break
    if ordered:
        return
    for root in range(run.size // 2 - 1, -1, -1):
        _sift(looks, run, root, run.size)
    for size in range(run.size - 1, 0, -1):
        run[0], run[size] = run[size], run[0]
        _sift(looks, run, 0, size)


@kernel
def _insert(key: Keys, member: Indices) -> None:
    for n in range(1, key.size):
        k, m = key[n], member[n]
        place = n
        while place > 0 and key[place - 1] > k:
            key[place], member[place] = key[place - 1], member[place - 1]
            place -= 1
        key[place], member[place] = k, m


@kernel
def _count_digits(key: Keys, member: Indices) -> None:
    """Stable sort by 11-bit digits, least significant first."""
    other_key, other_member = np.empty(key.size, np.uint32), np.empty(key.size, np.int32)
    for shift in (0, 11, 22):
        position = np.zeros(DIGIT + 1, np.int64)
        for n in range(key.size):
            position[((key[n] >> np.uint32(shift)) & np.uint32(DIGIT - 1)) + 1] += 1
        if position[((key[0] >> np.uint32(shift)) & np.uint32(DIGIT - 1)) + 1] < key.size:
            for digit in range(DIGIT):
                position[digit + 1] += position[digit]
            for n in range(key.size):
                digit = (key[n] >> np.uint32(shift)) & np.uint32(DIGIT - 1)
                other_key[position[digit]] = key[n]
                other_member[position[digit]] = member[n]
                position[digit] += 1
            for n in range(key.size):
                key[n], member[n] = other_key[n], other_member[n]


@kernel
def bits_of(key: Single) -> np.uint32:
    """Integer that sorts as a float32 does."""
    return _ascending(np.float32(key).view(np.uint32))


@kernel
def sort_by_key(key: Keys, member: Indices) -> None:
    """Sort `member` by `key`, and `key` with it."""
    if member.size <= FEW:
        _insert(key, member)
    else:
        _count_digits(key, member)


@kernel
def end_of_ties(key: Keys, start: int) -> int:
    """One past the last of those that have the key of `start`."""
    end = start + 1
    while end < key.size and key[end] == key[start]:
        end += 1
    return end


@kernel
def _settle_records(footprints: Records, member: Indices) -> None:
    """Put samples that lie at the same depth in order by what they differ in."""
    looks, order = np.empty((member.size, 9), np.float32), np.empty(member.size, np.int32)
    for n in range(member.size):
        record = footprints[member[n]]
        looks[n, 0], looks[n, 1] = record["y"], record["x"]
        looks[n, 2], looks[n, 3], looks[n, 4] = record["a"], record["b"], record["c"]
        looks[n, 5], looks[n, 6] = record["extinction"], record["red"]
        looks[n, 7], looks[n, 8] = record["green"], record["blue"]
        order[n] = n
    settle(order, looks)
    for n in range(order.size):
        order[n] = member[order[n]]
    for n in range(order.size):
        member[n] = order[n]


@kernel
def put_in_order(member: Indices, key_bits: Keys, footprints: Records) -> None:
    """Sort `member` by key (float32 bits), and samples of equal key by what they are."""
    key = np.zeros(member.size, np.uint32)
    for n in range(member.size):
        key[n] = _ascending(key_bits[member[n]])
    sort_by_key(key, member)
    start = 0
    while start < member.size:
        end = end_of_ties(key, start)
        if end - start > 1:
            _settle_records(footprints, member[start:end])
        start = end
