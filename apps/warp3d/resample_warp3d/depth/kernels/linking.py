"""Links between neighbours on one surface of a depth image, and its slopes.

Everything is measured in nearness, which is linear on planes as seen by a pinhole: on a plane the
second differences vanish, so a jump that the slope beside it explains is not an edge.
"""

import math

import numpy as np

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats, Single
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links

EXPLAINED: Single = np.float32(0.5)  # share of a step that the step beside it has to explain
HALF: Single = np.float32(0.5)
ONE: Single = np.float32(1)
NO_STEP: Single = np.float32(0)
OPEN = 128  # temporary bit of a link: neither a small step nor certainly an edge
STEEPEST: Single = np.float32(0.3)  # of the nearness: a larger step is an edge in any case


@kernel
def _is_explained(
    there: Single, here: Single, before: Single, earlier: Single, tolerance: Single
) -> bool:
    """Whether the steps that lead to a sample explain the one after it (0: unknown).

    The step before has to be explained itself, or two edges in a row would explain each other.
    """
    if not before > 0:
        return False
    # Compare the jump with the step before it, and that with the one before.
    rest = np.float32(1) - EXPLAINED
    jump, step = there - here, here - before
    if abs(jump - step) > rest * abs(jump) + tolerance:
        return False
    return bool(not earlier > 0 or abs(step - (before - earlier)) <= rest * abs(step) + tolerance)


@kernel
def _at(nearness: Floats, row: int, column: int) -> Single:
    """Nearness of a sample; 0 outside the frame."""
    height, width = nearness.shape
    if 0 <= row < height and 0 <= column < width:
        return nearness[row, column]
    return np.float32(0)


@kernel
def _is_linked(nearness: Floats, row: int, column: int, down: bool, allowed: Single) -> bool:
    """Whether steps on either side explain the step to the next sample."""
    dr, dc = (1, 0) if down else (0, 1)
    here, there = nearness[row, column], nearness[row + dr, column + dc]
    before, after = (
        _at(nearness, row - dr, column - dc),
        _at(nearness, row + 2 * dr, column + 2 * dc),
    )
    earlier = _at(nearness, row - 2 * dr, column - 2 * dc)
    later = _at(nearness, row + 3 * dr, column + 3 * dc)
    return _is_explained(there, here, before, earlier, allowed) or _is_explained(
        here, there, after, later, allowed
    )


@kernel
def _link_axis(nearness: Floats, row: int, down: bool, tolerance: Doubles, links: Links) -> None:
    """Link a row's samples to the right, or downward.

    Small and large steps are classified with SIMD, those between one by one.
    """
    dr, dc, bit = (1, 0, DOWN) if down else (0, 1, RIGHT)
    absolute, relative = tolerance[0], tolerance[1]
    # Classify all steps: linked, open, or an edge.
    for column in range(nearness.shape[1] - dc):
        here, there = nearness[row, column], nearness[row + dr, column + dc]
        most, jump = max(here, there), abs(there - here)
        is_there = (here > 0) & (there > 0)
        is_close = is_there & (jump <= np.float32(absolute + relative * most))
        is_open = is_there & (jump <= STEEPEST * most)
        found = bit if is_close else OPEN if is_open else 0
        links[row, column] |= np.uint8(found)
    # Decide open steps by those beside them.
    for column in range(nearness.shape[1] - dc):
        if links[row, column] & OPEN:
            most = max(nearness[row, column], nearness[row + dr, column + dc])
            allowed = np.float32(absolute + relative * most)
            links[row, column] ^= OPEN
            if _is_linked(nearness, row, column, down, allowed):
                links[row, column] |= bit


@parallel_kernel
def link_rows(counter: Counter, nearness: Floats, tolerance: Doubles, links: Links) -> None:
    """Find neighbours on one surface: the bits RIGHT and DOWN.

    `nearness`: (H, W); 0 where unknown. `tolerance`: (2,) a and b: jumps up to a + b δ are no
    edges. `links`: (H, W) filled.
    """
    for row in tasks(counter, nearness.shape[0]):
        links[row, :] = 0
        _link_axis(nearness, row, False, tolerance, links)
        if row + 1 < nearness.shape[0]:
            _link_axis(nearness, row, True, tolerance, links)


@parallel_kernel
def join_rows(counter: Counter, links: Links) -> None:
    """Set the opposite bits of all links; reads the bits RIGHT and DOWN, which stay."""
    for row in tasks(counter, links.shape[0]):
        for column in range(links.shape[1]):
            if column > 0 and links[row, column - 1] & RIGHT:
                links[row, column] |= LEFT
            if row > 0 and links[row - 1, column] & DOWN:
                links[row, column] |= UP


@kernel
def _line(
    values: Floats, links: Links, row: int, column: int, down: bool, reach: int
) -> tuple[float, float, int]:
    """Fit a line to a sample's surface: value there, slope, number of samples.

    Least squares over up to `reach` linked samples on each side.
    """
    forward, backward = (DOWN, UP) if down else (RIGHT, LEFT)
    dr, dc = (1, 0) if down else (0, 1)
    here = float(values[row, column])
    count, total, moment, first, second = 1, 0.0, 0.0, 0.0, 0.0

    # Follow the links to both sides, and sum up the normal equations.
    for side in range(2):
        bit, sign = (forward, 1) if side == 0 else (backward, -1)
        r, c = row, column
        for n in range(1, reach + 1):
            if not links[r, c] & bit:
                break
            r, c = r + sign * dr, c + sign * dc
            value = float(values[r, c]) - here
            count += 1
            total += value
            moment += sign * n * value
            first += sign * n
            second += n * n
    # Solve for slope and value at the sample.
    if count == 1:
        return here, 0.0, 1
    slope = (count * moment - first * total) / (count * second - first * first)
    return here + (total - slope * first) / count, slope, count


@parallel_kernel
def fit_rows(
    counter: Counter,
    values: Floats,
    links: Links,
    down: bool,
    reach: int,
    fitted: Floats,
    slope: Floats,
) -> None:
    """Fit lines along rows (or, `down`, columns) of surfaces; arrays are (H, W)."""
    for row in tasks(counter, values.shape[0]):
        for column in range(values.shape[1]):
            # Samples without depth stay so.
            if values[row, column] <= 0:
                fitted[row, column], slope[row, column] = np.float32(0), np.float32(0)
                continue
            # Keep the value where the fit leaves the range of nearness.
            value, change, _ = _line(values, links, row, column, down, reach)
            fitted[row, column] = np.float32(value) if value > 0 else values[row, column]
            slope[row, column] = np.float32(change)


@parallel_kernel
def slope_rows(counter: Counter, nearness: Floats, links: Links, slope: Floats) -> None:
    """Write the slopes (H, W, 2) between samples and their neighbours on the surface."""
    for row in tasks(counter, nearness.shape[0]):
        last_row, last_column = nearness.shape[0] - 1, nearness.shape[1] - 1
        above, below = max(row - 1, 0), min(row + 1, last_row)
        for column in range(nearness.shape[1]):
            # Difference along the row: central where both sides are linked, else one-sided.
            before, after = max(column - 1, 0), min(column + 1, last_column)
            bits, here = links[row, column], nearness[row, column]
            ahead = nearness[row, after] - here if bits & RIGHT != 0 else NO_STEP
            back = here - nearness[row, before] if bits & LEFT != 0 else NO_STEP
            is_both = (bits & RIGHT != 0) & (bits & LEFT != 0)
            slope[row, column, 0] = (HALF if is_both else ONE) * (ahead + back)
            # Difference along the column likewise.
            ahead = nearness[below, column] - here if bits & DOWN != 0 else NO_STEP
            back = here - nearness[above, column] if bits & UP != 0 else NO_STEP
            is_both = (bits & DOWN != 0) & (bits & UP != 0)
            slope[row, column, 1] = (HALF if is_both else ONE) * (ahead + back)


@kernel
def curvatures(values: Floats, links: Links, step: int, result: Doubles) -> None:
    """Second differences along rows, relative to nearness, of every `step`-th row and column.

    `result` is (H // step, W // step), NaN at edges.
    """
    for row in range(result.shape[0]):
        for column in range(result.shape[1]):
            r, c = row * step, column * step
            result[row, column] = math.nan
            if links[r, c] & LEFT and links[r, c] & RIGHT:
                around = values[r, c - 1] + values[r, c + 1]
                result[row, column] = around / values[r, c] - 2
