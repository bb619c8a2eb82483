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
SMOOTHED, SURE = 2, 5.0  # times, and standard deviations of a count, before a peak is one

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


class Peak(NamedTuple):
    """A material in a distribution, between two valleys."""

    before: float  # values: of the valley
    value: float  # of the peak
    after: float  # of the valley

    def share(self, levels: Levels) -> float:
        """Share of the voxels between the valleys."""
        return levels.share(self.before, self.after)


def peak_between(levels: Levels, low: float, high: float, dip: float, each: int = 1) -> Peak | None:
    """Peak between what is most frequent up to a value and another value; None: there is none.

    Edges of denser things are blurred into all values below theirs, which makes no peak.

    Parameters
    ----------
    levels
        Values.
    low
        What is most frequent up to there, the surroundings, lies before the peak.
    high
        The valley behind it is no farther.
    dip
        Share of the peak's height that the valley before it has at most; half that of the one
        behind.
    each
        Voxels that one of the sample stands for.
    """
    edges = np.linspace(levels.value[0], levels.value[-1], BINS + 1)
    count, _ = np.histogram(levels.value, edges, weights=levels.number)
    for _ in range(SMOOTHED):
        padded = np.pad(count, 1, mode="edge")
        count = (padded[:-2] + 2 * padded[1:-1] + padded[2:]) / 4
    center = (edges[:-1] + edges[1:]) / 2
    until = int(np.searchsorted(center, high))
    around = int(np.argmax(count[: max(1, int(np.searchsorted(center, low)))]))
    found: list[tuple[float, Peak]] = []
    for n in range(around + 1, until - 1):
        if not count[n - 1] <= count[n] > count[n + 1]:
            continue
        first = around + int(np.argmin(count[around:n]))
        last = n + int(np.argmin(count[n:until]))
        noise = SURE * np.sqrt(count[n] * each)
        if count[first] <= min(dip * count[n], count[n] - noise) and count[last] <= count[n] / 2:
            found.append((float(count[n]), Peak(*center[[first, n, last]].tolist())))
    return max(found)[1] if found else None
