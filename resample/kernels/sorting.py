"""Put a tile's samples in painting order, whatever order they came in."""

import numpy as np
from numpy.typing import NDArray

from resample.kernels.jit import kernel
from resample.types import Record, Records, Single

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
def _looks(record: Record) -> tuple[Single, ...]:
    """What samples at the same depth can differ in; what stands first decides first."""
    return (
        record["y"],
        record["x"],
        record["a"],
        record["b"],
        record["c"],
        record["extinction"],
        record["red"],
        record["green"],
        record["blue"],
    )


@kernel
def is_before(footprints: Records, first: int, second: int) -> bool:
    """A strict order of samples of equal key that only looks at what they are."""
    return _looks(footprints[first]) < _looks(footprints[second])


@kernel
def _sift(footprints: Records, run: Indices, root: int, size: int) -> None:
    """Restore the heap below `root`: no child after its parent."""
    while 2 * root + 1 < size:
        child = 2 * root + 1
        if child + 1 < size and is_before(footprints, run[child], run[child + 1]):
            child += 1
        if not is_before(footprints, run[root], run[child]):
            return
        run[root], run[child] = run[child], run[root]
        root = child


@kernel
def _settle(footprints: Records, run: Indices) -> None:
    """Heap sort of samples with equal keys."""
    ordered = True
    for n in range(1, run.size):
        if is_before(footprints, run[n], run[n - 1]):
            ordered = False
            break
    if ordered:
        return
    for root in range(run.size // 2 - 1, -1, -1):
        _sift(footprints, run, root, run.size)
    for size in range(run.size - 1, 0, -1):
        run[0], run[size] = run[size], run[0]
        _sift(footprints, run, 0, size)


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
    other_key, other_member = np.zeros_like(key), np.zeros_like(member)
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
            key[:] = other_key
            member[:] = other_member


@kernel
def put_in_order(member: Indices, key_bits: Keys, footprints: Records) -> None:
    """Sort `member` by key (float32 bits), and samples of equal key by `is_before`."""
    key = np.zeros(member.size, np.uint32)
    for n in range(member.size):
        key[n] = _ascending(key_bits[member[n]])
    if member.size <= FEW:
        _insert(key, member)
    else:
        _count_digits(key, member)
    start = 0
    for n in range(1, member.size + 1):
        if n == member.size or key[n] != key[start]:
            if n - start > 1:
                _settle(footprints, member[start:n])
            start = n
