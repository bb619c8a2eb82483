"""Straight edges of an interpolated grid, along which it shall not ring.

A separable kernel rings along a straight edge, within its limits, from where the edge ends. Where
samples hardly vary along an axis, pixels therefore stay near what the kernel makes of the samples
across it alone, the closer the less they vary. Few pixels lie there: where corners of samples leave
less tolerance than their limits do, the cells around them are marked. Edges that are too faint for
rings to be visible are let be.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step
from resample.engine.windows.boxes import Place, Plate
from resample.types import Floats, Single

TOLERANCE = 2.0  # multiple of what samples vary by along an edge that pixels may differ by
STRAIGHT = 1.0 / 128.0  # share of the limits' width that they may vary by before that fades
FADE = 256.0  # how fast
CHANNELS = 4  # that have marks of their own; others share these
ALONG_Y = CHANNELS  # bits from the mark of an edge along x to that of one along y

Marks = NDArray[np.uint8]  # of cells: a bit for each axis and channel
Corner = Any  # (column, row) among corners


@inner_step
def slack(varies: Single, low: Single, high: Single, faint: Single) -> Single:
    """How much less tolerance than limits a corner leaves; 0 or below: it is on no straight edge.

    Linear but for faint edges, so that between corners without slack there is none.
    """
    height = high - low
    fainter = max(faint + faint - height, np.float32(0))
    wanted = np.float32(1.0 + FADE * STRAIGHT) * (height - fainter)
    return wanted - np.float32(TOLERANCE + FADE) * varies


@inner_step
def tolerance_of(varies: Single, low: Single, high: Single, faint: Single) -> Single:
    """Tolerance around what samples across an edge make, by how much they vary along it.

    Edges of a height of `faint` are left alone, those of twice that are not.
    """
    height, zero = high - low, np.float32(0)
    beyond = max(varies - np.float32(STRAIGHT) * height, zero)
    fainter = max(faint + faint - height, zero)
    return np.float32(TOLERANCE) * varies + np.float32(FADE) * beyond + fainter


@inner_step
def towards(value: Single, straight: Single, tolerance: Single) -> Single:
    """What brings a value to within some tolerance around another."""
    return min(max(value, straight - tolerance), straight + tolerance) - value


@inner_step
def both(one: Single, other: Single) -> Single:
    """Two changes at once; of two in one direction, the larger."""
    zero = np.float32(0)
    return max(one, other, zero) + min(one, other, zero)


@inner_step
def _step(flat: Floats, at: Place, along: Place, across: Place) -> Single:
    """Larger of the steps along an axis on both sides of a corner."""
    other = at - across
    return max(abs(flat[at] - flat[at - along]), abs(flat[other] - flat[other - along]))


@inner_step
def _varies(flat: Floats, at: Place, along: Place, across: Place) -> Single:
    """How much samples around a corner vary along an axis, on the side where it is less.

    Samples on one side suffice, as edges end.
    """
    before, after = _step(flat, at - along, along, across), _step(flat, at + along, along, across)
    return max(_step(flat, at, along, across), min(before, after))


@inner_step
def varies_between(flat: Floats, at: Place, steps: tuple[Place, Place], is_along_x: bool,
                   x: Single, y: Single) -> Single:  # fmt: skip
    """How much samples vary along an axis, between four corners of which `at` is the first."""
    along, across = (steps[0], steps[1]) if is_along_x else (steps[1], steps[0])
    below = at + steps[1]
    left, right = (
        _varies(flat, at, along, across),
        _varies(flat, at + steps[0], along, across),
    )
    upper = left + x * (right - left)
    left, right = (
        _varies(flat, below, along, across),
        _varies(flat, below + steps[0], along, across),
    )
    return upper + y * (left + x * (right - left) - upper)


@inner_step
def mark_of(channel: int, is_along_x: bool) -> int:
    """Mark of a channel that an edge along an axis has."""
    return 1 << ((channel & (CHANNELS - 1)) + (0 if is_along_x else ALONG_Y))


@inner_step
def cell_of(wide: int, column: int, row: int) -> int:
    """Index of the cell after a corner; the one before each row tells whether any is marked."""
    return (row + 1) * (wide + 1) + column + 1


@inner_kernel
def mark_row(
    plain: Plate,
    corner: Corner,
    wide: int,
    limits: tuple[Floats, Floats, Floats],
    row: int,
    faint: Single,
    marks: Marks,
) -> bool:
    """Mark the cells around corners of a row that are on straight edges.

    Parameters
    ----------
    corner
        Column and row of the first corner in the plain grid.
    limits
        Least and greatest of all corners, and a bound of each one's `slack`.
    row
        The row among the corners.
    faint
        Height of edges that are let be.

    Returns
    -------
    Whether any is marked.
    """
    channels, low, high, bound = plain.channels, *limits
    across, down = np.uint64(channels), np.uint64(plain.stride * channels)
    first = np.uint64((corner[1] * plain.stride + corner[0]) * channels - plain.before)
    start, found = np.uint64(row * wide * channels), False
    for n in range(wide * channels):
        # Most corners are ruled out by the samples next to them.
        k = start + np.uint64(n)
        if bound[k] > np.float32(0):
            at, mark = first + np.uint64(n), 0
            column, channel = divmod(n, channels)
            if slack(_varies(plain.flat, at, across, down), low[k], high[k], faint) > np.float32(0):
                mark |= mark_of(channel, True)
            if slack(_varies(plain.flat, at, down, across), low[k], high[k], faint) > np.float32(0):
                mark |= mark_of(channel, False)
            if mark:
                _mark_around(marks, wide, column, row, mark)
                found = True
    return found


@inner_step
def _mark_around(marks: Marks, wide: int, column: int, row: int, mark: int) -> None:
    """Mark the four cells around a corner, and both rows of cells."""
    for at in (cell_of(wide, column - 1, row - 1), cell_of(wide, column - 1, row)):
        marks[at] |= mark
        marks[at + 1] |= mark
        marks[at - column] = 1
