"""Distributions of values, Otsu's thresholds, and peaks.

Otsu, A Threshold Selection Method from Gray-Level Histograms, 1979: maximize the variance between
classes, which minimizes the variance within them.
"""

from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles

BINS = 128  # bins for the search of thresholds
SMOOTHED, SURE = 2, 5.0  # ratio, and standard deviations of a count, that make a peak

Counts = NDArray[np.int64]


class Histogram(NamedTuple):
    """A distribution of values, of a sample of voxels for types of many values."""

    value: Doubles  # (K,) ascending
    number: Counts  # (K,) of voxels that have them, > 0

    def between(self, first: int, last: int) -> "Histogram":
        """Return the levels from one index to another, both included; negative from the end."""
        part = slice(first, last + 1 or None)
        return Histogram(self.value[part], self.number[part])

    def share(self, low: float, high: float) -> float:
        """Return the share of voxels in a range, both ends included."""
        inside = (self.value >= low) & (self.value <= high)
        return float(self.number[inside].sum() / max(self.number.sum(), 1))


def otsu(levels: Histogram, classes: int = 2) -> list[float]:
    """Return ascending thresholds between classes; values above one are of the next class.

    `classes`: 2 or 3. Result: one less than classes; none if there are fewer values than classes.
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
        """Return weight times squared mean of classes of bins."""
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

    def share(self, levels: Histogram) -> float:
        """Share of voxels between the valleys."""
        return levels.share(self.before, self.after)


def peak_between(
    levels: Histogram, low: float, high: float, dip: float, each: int = 1
) -> Peak | None:
    """Find a peak between the most frequent value of a range and another value; or None.

    Blurred edges of denser objects spread over all lower values, and make no peak.

    `high`: upper limit of the valley behind the peak. `each`: voxels per voxel of the sample.
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
