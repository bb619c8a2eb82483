"""Edges of depth: changes between surfaces, at once or over several samples.

A run is a sequence of steps to neighbours that all lead up, or all down: the steepest and adjacent
ones that are not much smaller. An edge is a run that the slopes beyond its ends do not explain.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats

Marks = NDArray[np.uint8]

UP, DOWN = 1, 2  # direction of an edge's step: to something nearer, or farther
SLIGHT = 0.004  # of the nearness: a smaller step is not the steepest of an edge
AROUND = 2  # steps on each side among which an edge's is the steepest
EVEN = 0.03  # of the nearness: largest slope of a surface, per sample
TIE = 1.0001  # factor within which steps count as equal
REACH = 10  # px on each side of an edge
MOST = 4.0  # times an edge's mean change of color that a single one counts
FEWEST = 4  # samples that a slope needs
BENT = 5  # samples that a bend needs


class Edges(NamedTuple):
    """Thresholds of edges."""

    run: int  # samples of a run on each side of its steepest step, at most
    share: float  # of the steepest step; smaller steps are not part of the run
    least: float  # jump of nearness, relative
    step: float  # and absolute, on top


@kernel
def _is_steepest(step: Doubles, n: int) -> bool:
    """Whether no step nearby in the same direction is larger."""
    most, up = abs(step[n]) * TIE, step[n] > 0
    for k in range(max(0, n - AROUND), min(step.size, n + AROUND + 1)):
        if (step[k] > 0) == up and abs(step[k]) > most:
            return False
    return True


@kernel
def _ends(step: Doubles, n: int, edges: Edges) -> tuple[int, int]:
    """First and last step of the run around a step."""
    up, least = step[n] > 0, edges.share * abs(step[n])
    first, last = n, n
    # Grow to both sides while steps have the same sign and are large enough.
    while first > 0 and n - first < edges.run:
        before = step[first - 1]
        if (before > 0) != up or abs(before) <= least:
            break
        first -= 1
    while last < step.size - 1 and last - n < edges.run:
        after = step[last + 1]
        if (after > 0) != up or abs(after) <= least:
            break
        last += 1
    return first, last


@kernel
def _slope(step: Doubles, first: int, last: int) -> float:
    """Larger slope beyond a run's ends, among slopes of the same direction."""
    up, found = step[first] > 0, 0.0
    # Average two steps on each side.
    if first >= 2:
        before = 0.5 * (step[first - 1] + step[first - 2])
        if (before > 0) == up:
            found = max(found, abs(before))
    if last + 2 < step.size:
        after = 0.5 * (step[last + 1] + step[last + 2])
        if (after > 0) == up:
            found = max(found, abs(after))
    return found


@kernel
def _mark_line(nearness: Floats, line: int, down: bool, edges: Edges, mark: Marks) -> None:
    """Mark the edges of one row or column."""
    step = np.empty((nearness.shape[0] if down else nearness.shape[1]) - 1)
    for n in range(step.size):
        if down:
            here, there = nearness[n, line], nearness[n + 1, line]
        else:
            here, there = nearness[line, n], nearness[line, n + 1]
        step[n] = np.float64(there) - here if here > 0 and there > 0 else 0.0
    # Start runs at the steepest steps.
    for n in range(step.size):
        here = nearness[n, line] if down else nearness[line, n]
        there = nearness[n + 1, line] if down else nearness[line, n + 1]
        most = np.float64(max(here, there))
        if abs(step[n]) <= SLIGHT * most or not _is_steepest(step, n):
            continue
        # Accept runs with a larger jump than the slopes beside them explain.
        first, last = _ends(step, n, edges)
        jump = abs(step[first : last + 1].sum())
        explained = min(_slope(step, first, last), EVEN * most) * (last - first + 1)
        if jump - explained < edges.least * most + edges.step:
            continue
        # Mark all steps of the run.
        for k in range(first, last + 1):
            if down:
                mark[k, line, 1] = UP if step[n] > 0 else DOWN
            else:
                mark[line, k, 0] = UP if step[n] > 0 else DOWN


@parallel_kernel
def mark_edges(counter: Counter, nearness: Floats, edges: Edges, mark: Marks) -> None:
    """Mark the steps of edges.

    `nearness`: (H, W); 0 where unknown. `edges`: thresholds of edges. `mark`: (H, W, 2) zeros;
    filled with `UP` or `DOWN` where the step right, or down, is an edge's.
    """
    height, width = nearness.shape
    for task in tasks(counter, height + width):
        if task < height:
            _mark_line(nearness, task, False, edges, mark)
        else:
            _mark_line(nearness, task - height, True, edges, mark)


BESIDE, BETWEEN = 1, 2


@parallel_kernel
def classify(counter: Counter, nearness: Floats, mark: Marks, kind: Marks) -> None:
    """Classify samples: 0 away from edges, `BESIDE` one, or `BETWEEN` two surfaces.

    Those between two surfaces belong to neither (flying pixels); unknown samples count as such. A
    sample to which edges lead up from both sides is not between them but part of a thin object.
    """
    for row in tasks(counter, nearness.shape[0]):
        for column in range(nearness.shape[1]):
            found = 0 if nearness[row, column] > 0 else BETWEEN
            for axis in range(2):
                # Read the steps after and before the sample along the axis.
                after = mark[row, column, axis]
                before = 0
                if axis == 0 and column > 0:
                    before = mark[row, column - 1, 0]
                if axis == 1 and row > 0:
                    before = mark[row - 1, column, 1]
                if after or before:
                    found = max(found, BESIDE)
                # Two steps in the same direction lead through the sample.
                if after and after == before:
                    found = BETWEEN
            kind[row, column] = found


@kernel
def _change(color: Floats, row: int, column: int, down: bool) -> float:
    """Absolute change of color from a sample to the next, all channels added up."""
    dr, dc = (1, 0) if down else (0, 1)
    total = 0.0
    for n in range(color.shape[2]):
        total += abs(np.float64(color[row + dr, column + dc, n]) - color[row, column, n])
    return total


@kernel
def profile_edges(
    color: Floats, mark: NDArray[np.uint8], profile: Doubles, even: Doubles, count: Doubles
) -> None:
    """Add up the changes of color beside edges of a single step.

    `color`: (H, W, C). `mark`: (H, W, 2) of `ramps.mark_edges`. `profile`: (4, 2 REACH + 1) added
    to: changes from the far side to the near one; the edge itself is in the middle. Edges with the
    near side at the right, left, below and above. `even`: the same, with all edges counting alike.
    `count`: (4,) edges, added to.
    """
    change = np.empty(2 * REACH + 1)
    for row in range(mark.shape[0]):
        for column in range(mark.shape[1]):
            for axis in range(2):
                kind = mark[row, column, axis]
                at, size = (column, mark.shape[1]) if axis == 0 else (row, mark.shape[0])
                # Skip steps that are not edges, and edges near the frame's border.
                if kind == 0 or at < REACH or at + REACH + 1 >= size:
                    continue
                # Read the changes from the far side to the near one.
                which, sign = 2 * axis + (0 if kind == UP else 1), 1 if kind == UP else -1
                for n in range(-REACH, REACH + 1):
                    r, c = (row, column + sign * n) if axis == 0 else (row + sign * n, column)
                    change[n + REACH] = _change(color, r, c, axis == 1)
                mean = change.mean() + 1e-3
                for n in range(2 * REACH + 1):
                    profile[which, n] += change[n]
                    even[which, n] += min(change[n] / mean, MOST)
                count[which] += 1.0


class Bends(NamedTuple):
    """Options of the measurement."""

    length: int  # samples on each side, at most
    steepest: float  # of the nearness, change per sample
    bent: float  # of the nearness, change of the slope per sample; 0: planes


@kernel
def _reach(
    nearness: Floats, band: Marks, row: int, column: int, step: tuple[int, int], most: int
) -> int:
    """Count the samples in a direction up to the band, the border or unknown ones."""
    height, width = nearness.shape
    for n in range(1, most + 1):
        r, c = row + n * step[0], column + n * step[1]
        if not (0 <= r < height and 0 <= c < width) or band[r, c] or not nearness[r, c] > 0:
            return n - 1
    return most


@kernel
def _parabola(
    nearness: Floats, row: int, column: int, step: tuple[int, int], reach: tuple[int, int],
    bends: Bends,
) -> tuple[float, float]:  # fmt: skip
    """Fit a parabola through a sample along an axis; return its slope and bend."""
    back, ahead = reach
    here = np.float64(nearness[row, column])
    # Sum up the normal equations of slope and bend.
    squares, cubes, fourths, first, second = 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(-back, ahead + 1):
        value = nearness[row + n * step[0], column + n * step[1]] - here
        half = 0.5 * n * n
        squares, cubes, fourths = squares + n * n, cubes + n * half, fourths + half * half
        first, second = first + n * value, second + half * value
    # Fit a line, or a parabola if there are enough samples.
    slope, bend = first / squares, 0.0
    determinant = squares * fourths - cubes * cubes
    if bends.bent > 0.0 and back + ahead + 1 >= BENT and determinant > 1e-9:
        slope = (first * fourths - second * cubes) / determinant
        bend = (second * squares - first * cubes) / determinant
    # Limit both.
    steep, bent = bends.steepest * here, bends.bent * here
    return min(max(slope, -steep), steep), min(max(bend, -bent), bent)


@parallel_kernel
def measure_slopes(
    counter: Counter, nearness: Floats, band: Marks, bends: Bends, slope: Floats
) -> None:
    """Write slopes (H, W, 4) of surfaces along rows and columns, and their changes.

    0 where `band` (H, W) is not 0, and where a surface is too small.
    """
    for row in tasks(counter, nearness.shape[0]):
        for column in range(nearness.shape[1]):
            for n in range(4):
                slope[row, column, n] = np.float32(0)
            # Skip samples near edges and unknown ones.
            if band[row, column] or not nearness[row, column] > 0:
                continue
            # Fit along both axes, within the surface.
            for axis in range(2):
                step, back = ((0, 1), (0, -1)) if axis == 0 else ((1, 0), (-1, 0))
                reach = (
                    _reach(nearness, band, row, column, back, bends.length),
                    _reach(nearness, band, row, column, step, bends.length),
                )
                if reach[0] + reach[1] + 1 >= FEWEST:
                    found = _parabola(nearness, row, column, step, reach, bends)
                    slope[row, column, axis] = np.float32(found[0])
                    slope[row, column, 2 + axis] = np.float32(found[1])
