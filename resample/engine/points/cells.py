"""The open sheets of a tile as cells of eight numbers, and what closes them.

What is added to a cell is rounded such that all sums are exact in float64: they do not depend on
the order of the samples, which so need not be sorted. One multiply-add of eight numbers serves a
cell.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.ellipsoids.rows import ALPHA, BLUE, DEPTH, FIRST, GREEN, RED, WEIGHT, index_of
from resample.engine.jit import kernel
from resample.engine.over import VISIBLE
from resample.types import Doubles, Floats, Single

SLOTS = 17  # sheets that may be open at a time: those that a run of neighbours reaches over
LINE = 8  # numbers in a cell: opacity, red, green, blue, depth, cover, and two zeros

# Steps of amounts and of their weights along a row. Sums are exact up to 2**12.
ROUND = 1.5 * 2.0 ** (52 - 24)  # added and taken away again, it leaves whole numbers of steps
ROUND_WEIGHT = 1.5 * 2.0 ** (52 - 17)

_NOWHERE = 1 << 30

Dirty = NDArray[np.int64]  # (SLOTS, rows, 2) cells touched: first column, one past the last


class Ring(NamedTuple):
    """How cells lie in memory: sheets, their rows, these one's columns."""

    rows: int
    columns: int
    around: int  # cells on each side of the canvas, which are not seen


class Scales(NamedTuple):
    """What the numbers of a cell are multiplied by to be what they say."""

    opacity: Single
    cover: Single
    front: Single  # depth of the sheet
    thickness: Single  # of the sheet


@kernel
def no_dirt(ring: Ring) -> Dirty:
    """No cells touched."""
    dirty = np.zeros((SLOTS, ring.rows, 2), np.int64)
    for slot in range(SLOTS):
        for row in range(ring.rows):
            dirty[slot, row, 0] = _NOWHERE
    return dirty


@kernel
def touch(dirty: Dirty, slot: int, top: int, bottom: int, left: int, right: int) -> None:
    """Note that cells of some rows and columns were touched, the last ones excluded."""
    for row in range(top, bottom):
        dirty[slot, row, 0] = min(dirty[slot, row, 0], left)
        dirty[slot, row, 1] = max(dirty[slot, row, 1], right)


@kernel
def empty_sheet(cells: Doubles, dirty: Dirty, slot: int, ring: Ring) -> None:
    """Empty the cells of a sheet that were touched."""
    for row in range(ring.rows):
        first, last = dirty[slot, row, 0], dirty[slot, row, 1]
        begin = np.uint64(8 * ((slot * ring.rows + row) * ring.columns + first))
        for n in range(np.uint64(8 * max(0, last - first))):
            cells[begin + n] = 0.0
        dirty[slot, row, 0], dirty[slot, row, 1] = _NOWHERE, 0


@kernel
def close_sheet(
    cells: Doubles,
    dirty: Dirty,
    slot: int,
    ring: Ring,
    scales: Scales,
    rows: Floats,
    opaque: Single,
) -> None:
    """Put a sheet behind what is painted on rows of sub-pixels, and empty its cells."""
    zero, one, far = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
    visible, around = np.float32(VISIBLE), ring.around
    for row in range(around, ring.rows - around):
        first = max(dirty[slot, row, 0], around)
        seen = min(dirty[slot, row, 1], ring.columns - around) - first
        base = index_of(row - around, first - around)
        begin = np.uint64(8 * ((slot * ring.rows + row) * ring.columns + first))
        for n in range(seen):
            cell, k = begin + np.uint64(8) * np.uint64(n), base + np.uint64(2 * n)
            total = scales.opacity * np.float32(cells[cell])
            before = one - rows[k + ALPHA]
            is_open = (total > zero) & (before > opaque)
            alpha = min(total, one)
            share = before * alpha / total if is_open else zero
            to_color = share * scales.opacity
            red = np.float32(cells[cell + np.uint64(1)])
            green = np.float32(cells[cell + np.uint64(2)])
            blue = np.float32(cells[cell + np.uint64(3)])
            behind = np.float32(cells[cell + np.uint64(4)])
            cover = np.float32(cells[cell + np.uint64(5)])
            depth = share * total * scales.front + to_color * behind * scales.thickness
            after = rows[k + ALPHA] + (before * alpha if is_open else zero)
            rows[k + RED] += max(zero, to_color * red)
            rows[k + GREEN] += max(zero, to_color * green)
            rows[k + BLUE] += max(zero, to_color * blue)
            rows[k + ALPHA] = after
            rows[k + DEPTH] += depth
            rows[k + WEIGHT] += cover * scales.cover if is_open else zero
            known = rows[k + FIRST]
            within = scales.opacity * behind / total if is_open else zero
            near = scales.front + scales.thickness * within
            rows[k + FIRST] = near if (known == far) & is_open & (after > visible) else known
    empty_sheet(cells, dirty, slot, ring)
