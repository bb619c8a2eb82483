"""Sums per sub-pixel of the open slabs of a tile, in pairs of rows as in `ellipsoids.rows`.

A slab sums the weights of its splats and four weighted numbers: red, green, blue and depth, or the
gradient and the value of a field. Slabs form a ring buffer; those of one pair of rows are adjacent.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.rows import COLUMNS, Groups
from resample.engine.jit import kernel, lane_step
from resample.engine.roles import lane_role, plays
from resample.types import MOST_COLUMNS, Doubles, Ellipsoid, Floats, Place, Single, View

NARROW = 72  # sub-pixels in a row of most tiles
PLANES = 5  # sums per sub-pixel
_NOWHERE = 1 << 30

# (slots, 4) bounds of the touched sub-pixels: first pair of rows and one past the last; columns too
Dirty = NDArray[np.int64]


class Narrow(NamedTuple):
    """A ring of slabs for tiles of at most NARROW columns."""

    slots: int  # slabs that are open at a time


class Wide(NamedTuple):
    """A ring of slabs for tiles of at most MOST_COLUMNS columns."""

    slots: int


Ring = Narrow | Wide


@lane_role
def stride_of(ring: Ring) -> np.uint64:
    """Distance between the planes of sums: weight, first, second, third and fourth."""
    raise NotImplementedError


@plays(stride_of, Narrow)
def _narrow(ring):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.uint64(2 * (NARROW + COLUMNS))


@plays(stride_of, Wide)
def _wide(ring):  # type: ignore[no-untyped-def]  # noqa: ARG001
    return np.uint64(2 * (MOST_COLUMNS + COLUMNS))


class Canvas(NamedTuple):
    """The sub-pixels of a tile, and the sums of the slabs behind them."""

    rows: Floats  # see `ellipsoids.rows`
    open_groups: Groups
    along: Floats  # radii per scene unit of depth on a ray, |w|; indexed like planes of `rows`
    sums: Floats
    dirty: Dirty
    across: Floats  # (MOST_TAPS,) scratch for a point's weights along x
    down: Floats  # (MOST_TAPS,) and along y
    work: Floats  # scratch, see `integrals`
    state: Floats  # (h, w, 10) of fields, see `fields`; or empty
    height: int
    width: int


class SphereCut(NamedTuple):
    """Parameters for integrating spheres that planes cut."""

    place: Place
    camera: View
    ellipsoid: Ellipsoid
    planes: Doubles  # (M, 5)
    partial: Floats


class Slab(NamedTuple):
    """An open slab: its number, its slot in the ring, and the depths of its front and back."""

    number: int
    slot: int
    front: float
    back: float


class Contribution(NamedTuple):
    """Contribution of a splat per unit of its line integral."""

    weight: Single
    first: Single
    second: Single
    third: Single
    fourth: Single


@lane_step
def add_contribution(
    sums: Floats, k: np.uint64, ring: Ring, part: Single, contribution: Contribution
) -> None:
    """Add a line integral times a splat's contribution to a sub-pixel; `k` is its first sum."""
    # One sum per plane; strides are known when compiled, so that loops of this become lanes.
    stride = stride_of(ring)
    sums[k] += part * contribution.weight
    sums[k + stride] += part * contribution.first
    sums[k + np.uint64(2) * stride] += part * contribution.second
    sums[k + np.uint64(3) * stride] += part * contribution.third
    sums[k + np.uint64(4) * stride] += part * contribution.fourth


@kernel
def sum_at(ring: Ring, slot: int, pair: int, column: int) -> np.uint64:
    """Index of a sub-pixel's first sum, of the upper row of a pair."""
    # The order is pair of rows, slot, plane, column; the two rows of a pair alternate.
    line = np.uint64((pair * ring.slots + slot) * PLANES)
    return np.uint64(line * stride_of(ring) + np.uint64(2 * column))


@kernel
def no_dirt(slots: int) -> Dirty:
    """Bounds of no touched sub-pixels."""
    dirty = np.zeros((slots, 4), np.int64)
    for slot in range(slots):
        dirty[slot, 0] = dirty[slot, 2] = _NOWHERE
    return dirty


@kernel
def touch(dirty: Dirty, slot: int, top: int, bottom: int, left: int, right: int) -> None:
    """Extend a slab's dirty rectangle; the last row and column are excluded."""
    # Rows are tracked in pairs, columns one by one.
    k = np.uint64(slot)
    dirty[k, 0], dirty[k, 1] = min(dirty[k, 0], top >> 1), max(dirty[k, 1], (bottom + 1) >> 1)
    dirty[k, 2], dirty[k, 3] = min(dirty[k, 2], left), max(dirty[k, 3], right)


@kernel
def clean(dirty: Dirty, slot: int) -> tuple[int, int, int, int]:
    """Return a slab's dirty rectangle, as pairs of rows and columns, and reset it."""
    first, last, left, right = dirty[slot, 0], dirty[slot, 1], dirty[slot, 2], dirty[slot, 3]
    dirty[slot, 0], dirty[slot, 1] = _NOWHERE, 0
    dirty[slot, 2], dirty[slot, 3] = _NOWHERE, 0
    return first, last, left, right


@kernel
def empty_slab(sums: Floats, dirty: Dirty, ring: Ring, slot: int) -> None:
    """Clear a slab without compositing it."""
    # Whole lines of the dirty pairs of rows are contiguous, all planes included.
    first, last, _, _ = clean(dirty, slot)
    for pair in range(first, last):
        begin = sum_at(ring, slot, pair, 0)
        for n in range(np.uint64(PLANES) * stride_of(ring)):
            sums[begin + np.uint64(n)] = 0.0


@kernel
def empty(sums: Floats, dirty: Dirty, ring: Ring) -> None:
    """Clear all slabs."""
    for slot in range(ring.slots):
        empty_slab(sums, dirty, ring, slot)


@kernel
def new_sums(ring: Ring, pairs: int) -> Floats:
    """Allocate empty slabs with `pairs` pairs of rows."""
    return aligned(int(np.uint64(ring.slots * pairs * PLANES) * stride_of(ring)))


@kernel
def aligned(count: int) -> Floats:
    """Allocate zeros that begin at a cache line."""
    # Skip to the next multiple of 64 bytes.
    room = np.zeros(count + 16, np.float32)
    first = (-room.ctypes.data % 64) // 4
    return room[first : first + count]
