"""The open sheets of a tile as cells of eight sums, and the compositing of sheets.

Amounts are rounded such that all sums are exact in float64. They do not depend on the order of the
samples, which therefore need not be sorted. A cell is updated by one multiply-add of eight numbers.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.compositing import VISIBLE
from resample.engine.ellipsoids.rows import ALPHA, BLUE, DEPTH, FIRST, GREEN, RED, WEIGHT, index_of
from resample.engine.jit import kernel
from resample.types import Doubles, Floats, Single

SLOTS = 17  # sheets that may be open at a time: those that a run of neighbours spans
LINE = 8  # numbers in a cell: opacity, red, green, blue, depth, cover, and two zeros

# Quanta of amounts and of weights along a row. Sums are exact up to 2**12.
ROUND = 1.5 * 2.0 ** (52 - 24)  # adding and subtracting it rounds to whole quanta
ROUND_WEIGHT = 1.5 * 2.0 ** (52 - 17)

_NOWHERE = 1 << 30

Dirty = NDArray[np.int64]  # (SLOTS, rows, 2) touched cells: first column, one past the last


class Ring(NamedTuple):
    """Layout of cells in memory: slots of sheets, their rows, and columns of these."""

    rows: int
    columns: int
    around: int  # cells of margin on each side of the canvas


class Scales(NamedTuple):
    """Factors that turn the sums of a cell into what they stand for."""

    opacity: Single
    cover: Single
    front: Single  # depth of the sheet
    thickness: Single  # of the sheet


@kernel
def no_dirt(ring: Ring) -> Dirty:
    """Bounds of no touched cells."""
    dirty = np.zeros((SLOTS, ring.rows, 2), np.int64)
    for slot in range(SLOTS):
        for row in range(ring.rows):
            dirty[slot, row, 0] = _NOWHERE
    return dirty


@kernel
def touch(dirty: Dirty, slot: int, top: int, bottom: int, left: int, right: int) -> None:
    """Extend the dirty columns of some rows; the last row and column are excluded."""
    for row in range(top, bottom):
        dirty[slot, row, 0] = min(dirty[slot, row, 0], left)
        dirty[slot, row, 1] = max(dirty[slot, row, 1], right)


@kernel
def empty_sheet(cells: Doubles, dirty: Dirty, slot: int, ring: Ring) -> None:
    """Clear the touched cells of a sheet."""
    # Only the dirty columns of each row hold anything.
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
    """Composite a sheet under what is painted on rows of sub-pixels, and clear its cells."""
    zero, one, far = np.float32(0.0), np.float32(1.0), np.float32(np.inf)
    visible, around = np.float32(VISIBLE), ring.around
    # Visit the dirty cells of each row that lie on the canvas.
    for row in range(around, ring.rows - around):
        first = max(dirty[slot, row, 0], around)
        seen = min(dirty[slot, row, 1], ring.columns - around) - first
        base = index_of(row - around, first - around)
        begin = np.uint64(8 * ((slot * ring.rows + row) * ring.columns + first))
        for n in range(seen):
            cell, k = begin + np.uint64(8) * np.uint64(n), base + np.uint64(2 * n)
            # Composite where something was added and the sub-pixel is not opaque yet.
            total = scales.opacity * np.float32(cells[cell])
            before = one - rows[k + ALPHA]
            is_open = (total > zero) & (before > opaque)
            # Opacities of points add up; where they exceed 1, they share the sub-pixel.
            alpha = min(total, one)
            share = before * alpha / total if is_open else zero
            to_color = share * scales.opacity
            # Scale the sums, the depth relative to the sheet's front.
            red = np.float32(cells[cell + np.uint64(1)])
            green = np.float32(cells[cell + np.uint64(2)])
            blue = np.float32(cells[cell + np.uint64(3)])
            behind = np.float32(cells[cell + np.uint64(4)])
            cover = np.float32(cells[cell + np.uint64(5)])
            depth = share * total * scales.front + to_color * behind * scales.thickness
            # Accumulate light, opacity, depth and coverage.
            after = rows[k + ALPHA] + (before * alpha if is_open else zero)
            rows[k + RED] += max(zero, to_color * red)
            rows[k + GREEN] += max(zero, to_color * green)
            rows[k + BLUE] += max(zero, to_color * blue)
            rows[k + ALPHA] = after
            rows[k + DEPTH] += depth
            rows[k + WEIGHT] += cover * scales.cover if is_open else zero
            # Note the depth where the sub-pixel first becomes visible.
            known = rows[k + FIRST]
            within = scales.opacity * behind / total if is_open else zero
            near = scales.front + scales.thickness * within
            rows[k + FIRST] = near if (known == far) & is_open & (after > visible) else known
    empty_sheet(cells, dirty, slot, ring)
