import numpy as np
import pytest

from resample.engine.jit import kernel
from resample.engine.tiles import FEW, HALF, bits_of, member_of, paired, settle, sort_pairs

COLUMNS = 9  # numbers of what a sample looks like


def looks(rng, count, choices=None):
    """What samples are (N, 9): any numbers, or few so that there are ties."""
    size = (count, COLUMNS)
    found = rng.uniform(0, 5, size) if choices is None else rng.choice(choices, size)
    return found.astype(np.float32)


@kernel
def sorted_and_settled(bits, member, look, pair, number):
    """Sort members by their keys' bits, and settle ties."""
    for n in range(member.size):
        pair[0, n] = paired(bits[n], member[n])
    sort_pairs(pair[0], pair[1])
    first = 0
    for end in range(1, member.size + 1):
        if end < member.size and pair[0, end] >> HALF == pair[0, first] >> HALF:
            continue
        tied = pair[0, first:end].copy()
        own = np.empty((end - first, look.shape[1]), np.float32)
        for k in range(end - first):
            own[k] = look[member_of(tied[k])]
        turn = np.arange(end - first).astype(np.int32)
        settle(turn, own)
        for k in range(end - first):
            number[first + k] = member_of(tied[turn[k]])
        first = end


@kernel
def write_bits(key, bits):
    """Write the bits of keys, which are in the keys' order."""
    for n in range(key.size):
        bits[n] = bits_of(key[n])


def ordered(key, look, member):
    """Members in painting order: sorted by key, ties settled."""
    bits = np.empty(len(key), np.uint32)
    write_bits(key, bits)
    return in_order(bits[np.asarray(member, int)], member, look)


def in_order(bits, member, look):
    """Members sorted by bits, ties settled."""
    member = np.asarray(member, int)
    pair, number = np.empty((2, len(member)), np.uint64), np.empty(len(member), int)
    if len(member):
        sorted_and_settled(bits, member, look, pair, number)
    return number


def lexsorted(key, look, member):
    """The obvious twin; equal in all columns stay as they come, and cannot be told apart."""
    member = np.asarray(member)
    return member[np.lexsort((*look[member].T[::-1], np.asarray(key, np.float32)[member]))]


def values_of(key, look, member):
    return [(float(key[n]), *map(float, look[n])) for n in member]


SIZES = [0, 1, 2, 3, FEW - 1, FEW, FEW + 1, 300, 5000]


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("depths", [1, 3, 40, 6000])
def test_samples_are_ordered_by_depth_and_then_by_what_they_are(size, depths, rng):
    key = rng.choice(rng.normal(0, 100, depths).astype(np.float32), 6000)
    look, member = looks(rng, 6000), rng.choice(6000, size, replace=False)
    np.testing.assert_array_equal(ordered(key, look, member), lexsorted(key, look, member))


@pytest.mark.parametrize("size", [2, FEW, 300])
def test_exact_duplicates_end_side_by_side(size, rng):
    key = rng.choice([1.0, 2.0], 400).astype(np.float32)
    look, member = looks(rng, 400, choices=(0.0, 1.0)), rng.integers(0, 400, size)
    got, expected = ordered(key, look, member), lexsorted(key, look, member)
    assert values_of(key, look, got) == values_of(key, look, expected)
    np.testing.assert_array_equal(np.sort(got), np.sort(member))


@pytest.mark.parametrize("size", [20, 500])
def test_the_result_does_not_depend_on_the_order_of_members(size, rng):
    key = rng.choice(np.float32([-1.0, 0.0, 3.0]), size)
    look = looks(rng, size, choices=(0.0, 1.0, 2.0))
    first = ordered(key, look, np.arange(size))
    again = ordered(key, look, rng.permutation(size))
    assert values_of(key, look, first) == values_of(key, look, again)


@pytest.mark.parametrize("size", [9, 90])
def test_negative_tiny_huge_and_infinite_depths_are_in_order(size, rng):
    special = [-np.inf, -3e38, -1.0, -1e-45, 0.0, 1e-45, 1.0, 3e38, np.inf]
    key = np.tile(np.array(special, np.float32), size // 9)
    got = ordered(key, looks(rng, size), rng.permutation(size))
    np.testing.assert_array_equal(key[got], np.sort(key))


@pytest.mark.parametrize("column", range(COLUMNS))
def test_samples_that_differ_in_one_number_only_are_told_apart(column):
    """Spheres that the near plane cuts all stand in the middle of the screen."""
    look = np.zeros((2, COLUMNS), np.float32)
    look[:, column] = [1.0, 0.0]
    key = np.zeros(2, np.float32)
    np.testing.assert_array_equal(ordered(key, look, [0, 1]), ordered(key, look, [1, 0]))


@pytest.mark.parametrize("span", [1, 2, 2**11, 2**12 + 1, 2**22, 2**32])
@pytest.mark.parametrize("size", [1, FEW, FEW + 1, 3000])
def test_pairs_are_sorted_by_keys_of_any_span(size, span, rng):
    key = (2**32 - span + rng.integers(0, span, size)).astype(np.uint32)
    pair = (key.astype(np.uint64) << HALF) | np.arange(size, dtype=np.uint64)
    sort_pairs(pair, np.empty_like(pair))
    number = (pair & np.uint64(0xFFFFFFFF)).astype(int)
    np.testing.assert_array_equal(number, np.argsort(key, kind="stable"))
