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


class Edges(NamedTuple):
    """Thresholds of edges."""

    run: int  # samples of a run on each side of its steepest step, at most
    share: float  # of the steepest step; smaller steps are not part of the run
    least: float  # jump of nearness, relative
    step: float  # and absolute, on top


@kernel
def _steps(nearness: Floats, line: int, down: bool, step: Doubles) -> None:
    """Write the steps between samples of a row, or column; 0 beside unknown ones."""
    for n in range(step.size):
        if down:
            here, there = nearness[n, line], nearness[n + 1, line]
        else:
            here, there = nearness[line, n], nearness[line, n + 1]
        step[n] = np.float64(there) - here if here > 0 and there > 0 else 0.0


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
    """Larger slope beyond a run's ends, of those in the same direction."""
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
    _steps(nearness, line, down, step)
    # Start runs at the steepest steps.
    for n in range(step.size):
        here = nearness[n, line] if down else nearness[line, n]
        there = nearness[n + 1, line] if down else nearness[line, n + 1]
        most = np.float64(max(here, there))
        if abs(step[n]) <= SLIGHT * most or not _is_steepest(step, n):
            continue
        # Accept runs whose jump exceeds what the slopes beside them explain.
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

    Parameters
    ----------
    nearness
        (H, W); 0 where unknown.
    edges
        Thresholds of edges.
    mark
        (H, W, 2) zeros; filled with `UP` or `DOWN` where the step right, or down, is an edge's.
    """
    height, width = nearness.shape
    for task in tasks(counter, height + width):
        if task < height:
            _mark_line(nearness, task, False, edges, mark)
        else:
            _mark_line(nearness, task - height, True, edges, mark)


@kernel
def _classify_row(nearness: Floats, mark: Marks, row: int, kind: Marks) -> None:
    """Classify a row of samples; see `classify`."""
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


BESIDE, BETWEEN = 1, 2


@parallel_kernel
def classify(counter: Counter, nearness: Floats, mark: Marks, kind: Marks) -> None:
    """Classify samples: 0 away from edges, `BESIDE` one, or `BETWEEN` two surfaces.

    Those between two surfaces belong to neither (flying pixels); unknown samples count as such. A
    sample to which edges lead up from both sides is not between them but part of a thin object.
    """
    for row in tasks(counter, nearness.shape[0]):
        _classify_row(nearness, mark, row, kind)
