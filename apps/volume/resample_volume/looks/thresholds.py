"""Distributions of values, and what splits one into classes: Otsu's thresholds.

Otsu, A Threshold Selection Method from Gray-Level Histograms, 1979: classes whose means differ the
most, which is the same as classes that are the most even in themselves.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles

BINS = 128  # that thresholds are looked for among

Counts = NDArray[np.int64]


class Levels(NamedTuple):
    """A distribution, of a sample of the voxels where values are many."""

    value: Doubles  # (K,) ascending
    number: Counts  # (K,) of voxels that have them, > 0

    def between(self, first: int, last: int) -> "Levels":
        """Those from one index to another, both included; from the end where it is negative."""
        part = slice(first, last + 1 or None)
        return Levels(self.value[part], self.number[part])

    def share(self, low: float, high: float) -> float:
        """Share of the voxels whose values are in a range, both ends included."""
        inside = (self.value >= low) & (self.value <= high)
        return float(self.number[inside].sum() / max(self.number.sum(), 1))


def otsu(levels: Levels, classes: int = 2) -> list[float]:
    """Thresholds between classes, ascending; what is above one belongs to the class after it.

    Parameters
    ----------
    levels
        Values.
    classes
        2 or 3.

    Returns
    -------
    One less than there are classes; none where values are fewer than classes.
    """
    value, count = levels
    if value.size < classes:
        return []
    if value.size > BINS:
        edges = np.linspace(value[0], value[-1], BINS + 1)
        code = np.clip(np.searchsorted(edges, value, side="right") - 1, 0, BINS - 1)
        center, border = (edges[:-1] + edges[1:]) / 2, edges[1:]
        weight = np.bincount(code, count, BINS)
    else:
        center, weight = value, count.astype(np.float64)
        border = np.append((value[:-1] + value[1:]) / 2, value[-1])
    zero = np.concatenate([[0.0], np.cumsum(weight)])
    first = np.concatenate([[0.0], np.cumsum(weight * (center - center[0]))])

    def spread(start: Counts, end: Counts) -> Doubles:
        """Weight times squared mean of classes of bins."""
        mass = zero[end] - zero[start]
        part = (first[end] - first[start]) ** 2
        return np.where(mass > 0, part / np.maximum(mass, 1.0), 0.0)

    cut = np.array(list(combinations(range(1, center.size), classes - 1)))
    limits = np.column_stack([0 * cut[:, 0], cut, 0 * cut[:, 0] + center.size])
    total = sum(spread(limits[:, n], limits[:, n + 1]) for n in range(classes))
    best = cut[int(np.argmax(total))]
    return [float(border[n - 1]) for n in best]
