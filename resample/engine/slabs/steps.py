"""Checkpoints of slabs between steps, besides the rows of sub-pixels.

See `resample.engine.ellipsoids.steps`. A sum of all samples is saved as it is. Of slabs that cut
splats, which are many, nothing is saved: samples in slabs that are still open are added once more,
in the same order as before.
"""

import numpy as np

from resample.engine.ellipsoids.steps import KEPT, NEW, Carried, in_steps
from resample.engine.jit import kernel
from resample.engine.slabs.fields import START
from resample.engine.slabs.sums import PLANES, Canvas, Ring, stride_of, sum_at, touch
from resample.engine.sorting import HALF, Pairs, bits_of

FIELD_STATE = START  # numbers of a ray's state that are saved


@kernel
def begin_of_step(first: int, carried: Carried) -> int:
    """First slab that was not composited in an earlier step; `first` if there are no steps."""
    if not in_steps(carried):
        return first
    return carried.step.done


@kernel
def end_of_step(last: int, carried: Carried) -> int:
    """First slab that is not composited in this step; `last` if there are no more steps."""
    if not in_steps(carried):
        return last
    return min(last, carried.step.due)


@kernel
def is_added_again(pair: np.uint64, carried: Carried) -> bool:
    """Whether a sample was added in an earlier step."""
    if not in_steps(carried):
        return False
    # Pairs sort by key: compare with the step's first key.
    return bool(pair < np.uint64(bits_of(carried.step.first)) << HALF)


@kernel
def end_of_added_again(ready: Pairs, first: int, carried: Carried) -> int:
    """One past the last of sorted samples that was added in an earlier step."""
    last = first
    while last < ready.size and is_added_again(ready[last], carried):
        last += 1
    return last


@kernel
def take_up_slabs(
    canvas: Canvas, ring: Ring, is_one_sum: bool, tile: int, carried: Carried
) -> None:
    """Resume a tile: restore the saved state of rays and the sum of all samples."""
    # A new tile has nothing saved.
    if not in_steps(carried) or carried.state[tile] == NEW:
        return
    if is_one_sum:
        touch(canvas.dirty, 0, 0, canvas.height, 0, canvas.width)
    _move(canvas, ring, is_one_sum, tile, carried, False)


@kernel
def lay_down_slabs(
    canvas: Canvas, ring: Ring, is_one_sum: bool, tile: int, carried: Carried
) -> None:
    """Checkpoint the state of rays and the sum of all samples until the next step."""
    if in_steps(carried):
        _move(canvas, ring, is_one_sum, tile, carried, True)


@kernel
def _move(
    canvas: Canvas, ring: Ring, is_one_sum: bool, tile: int, carried: Carried, is_saved: bool
) -> None:
    """Save the state of rays and the sum of all samples, or restore them."""
    # They stand behind what `checkpoint` saves of the sub-pixels, and `resume` restores.
    height, width, number = canvas.height, canvas.width, carried.number
    place = carried.each * carried.start[tile] + len(KEPT) * height * width
    # Move the state of each ray of a field.
    if canvas.state.size > 0:
        for row in range(height):
            for column in range(width):
                for n in range(FIELD_STATE):
                    if is_saved:
                        number[place + n] = canvas.state[row, column, n]
                    else:
                        canvas.state[row, column, n] = number[place + n]
                place += FIELD_STATE
    # Move the one sum.
    if is_one_sum:
        stride = stride_of(ring)
        for row in range(height):
            for column in range(width):
                k = sum_at(ring, 0, row >> 1, column) + np.uint64(row & 1)
                for n in range(PLANES):
                    if is_saved:
                        number[place + n] = canvas.sums[k + np.uint64(n) * stride]
                    else:
                        canvas.sums[k + np.uint64(n) * stride] = number[place + n]
                place += PLANES
