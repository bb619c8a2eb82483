"""Statistics of all values in bricks, found in one pass by one or several processes.

Each process scans some layers of bricks. Results are ends, counts and values themselves, so that
parts joined in their order are bit-identical to a single scan.
"""

from collections.abc import Iterable
from functools import partial
from itertools import combinations, product
from math import prod
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.outofcore.bricks import BrickArray, Step, spans
from resample.outofcore.passes import PassContext, in_order, passed
from resample.progress import report
from resample.types import Doubles

SAMPLED = 2e6  # sample size for the distribution of floating-point values
LITTLE = 1 << 21  # values that NumPy counts in the time that OpenCV takes to import
LEAST = 1 << 23  # voxels; a scan of fewer takes less than a second, and is not stored
PARTS = 16  # least size for several processes


class BrickStats(NamedTuple):
    """Statistics of the values of bricks."""

    least: Doubles  # (Z, Y, X) of each brick's finite values; inf where there is none
    greatest: Doubles  # (Z, Y, X) likewise; -inf
    infinite: int  # voxels
    missing: int  # voxels
    some: NDArray[Any]  # a regular sample, see `step_of`
    border: NDArray[Any]  # (N,) all values on the six sides
    beyond: NDArray[Any]  # finite values outside the range of `some`; empty for types of few values
    codes: NDArray[np.int64] | None  # counts of each value, by its bits, for types of few values


def scanned(bricks: BrickArray, helpers: PassContext | None = None) -> BrickStats:
    """Scan all values; each brick is read once, some of floating-point values twice."""
    layers, context = bricks.count[0], helpers or PassContext()
    parts = spans(layers, 1 if context.executor is None else PARTS)
    found: list[tuple[BrickStats, list[NDArray[Any]]]] = []
    for stats, sides, reads in passed(partial(_scan_layers, bricks), parts, context):
        found.append((stats, sides))
        bricks.reads += reads
        report(parts[len(found) - 1][1], layers)
    least, greatest, some = (np.concatenate([part[n] for part, _ in found]) for n in (0, 1, 4))
    codes = [part.codes for part, _ in found if part.codes is not None]
    every = [found[0][1][0], found[-1][1][1]]  # below and above; then those around
    every += [np.concatenate([sides[n] for _, sides in found]) for n in range(2, 6)]
    infinite = sum(part.infinite for part, _ in found)
    missing = sum(part.missing for part, _ in found)
    border = np.concatenate([side.ravel() for side in every])
    beyond = _outliers(bricks, (least, greatest), some, context)
    total = np.sum(codes, axis=0) if codes else None
    return BrickStats(least, greatest, infinite, missing, some, border, beyond, total)


def _scan_layers(
    bricks: BrickArray, span: tuple[int, int]
) -> tuple[BrickStats, list[NDArray[Any]], int]:
    """Scan layers of bricks: statistics, two sides along z, y and x (z: outer layers), reads."""
    own, (first, last), (_, down, across) = bricks.anew(), span, bricks.count
    indices = list(product(range(first, last), range(down), range(across)))
    low, high = bricks.box(indices[0])[0].start, bricks.box(indices[-1])[0].stop
    shape, step = (high - low, *bricks.shape[1:]), step_of(prod(bricks.shape))
    planes = range(-(-low // step), -(-high // step))
    some = np.empty((len(planes), *(-(-size // step) for size in shape[1:])), bricks.dtype)
    sides = [np.empty(shape[:n] + shape[n + 1 :], bricks.dtype) for n in (0, 0, 1, 1, 2, 2)]
    least, greatest = np.full((2, last - first, down, across), [[[[np.inf]]], [[[-np.inf]]]])
    few = are_few(bricks.dtype)
    codes = np.zeros(1 << 8 * bricks.dtype.itemsize, np.int64) if few else None

    def scan(index: Step) -> tuple[int, int, NDArray[np.int64] | None]:
        values, box = own.brick(index), own.box(index)
        at = (index[0] - first, *index[1:])
        least[at], greatest[at], infinite, missing = extent(values)
        # Copy a brick's values into a regular sample that begins at a plane
        starts = [-(-part.start // step) for part in box]
        firsts = [n * step - part.start for n, part in zip(starts, box, strict=True)]
        found = values[tuple(slice(first, None, step) for first in firsts)]
        starts[0] -= planes.start
        ends = [n + size for n, size in zip(starts, found.shape, strict=True)]
        some[tuple(map(slice, starts, ends))] = found
        inner = (slice(box[0].start - low, box[0].stop - low), *box[1:])
        for axis, end in product(range(3), (0, 1)):
            if inner[axis].start == 0 if end == 0 else inner[axis].stop == shape[axis]:
                others = tuple(part for n, part in enumerate(inner) if n != axis)
                sides[2 * axis + end][others] = values.take(-end, axis)
        return infinite, missing, count_codes(values) if few else None

    infinite = missing = 0
    for n, (more, none, counted) in enumerate(in_order(scan, indices)):
        report(n + 1, len(indices))
        infinite, missing = infinite + more, missing + none
        if codes is not None and counted is not None:
            codes += counted
    for side, is_outer in ((0, low == 0), (1, high == bricks.shape[0])):
        sides[side] = sides[side] if is_outer else sides[side][:0]
    nothing = some[:0].ravel()
    stats = BrickStats(least, greatest, infinite, missing, some, nothing, nothing, codes)
    return stats, sides, own.reads


def _outliers(
    bricks: BrickArray, ends: tuple[Doubles, Doubles], some: NDArray[Any], context: PassContext
) -> NDArray[Any]:
    """Return finite values outside the range of a sample, from bricks with such ends."""
    if are_few(bricks.dtype):
        return some[:0].ravel()
    low, high, *_ = extent(some)
    chosen = [tuple(map(int, at)) for at in np.argwhere((ends[0] < low) | (ends[1] > high))]
    parts = [chosen[first:last] for first, last in spans(len(chosen), PARTS)]
    found = [some[:0].ravel()]
    for values, reads in passed(partial(_scan_outside, bricks, (low, high)), parts, context):
        found.append(values)
        bricks.reads += reads
        report(len(found) - 1, len(parts))
    return np.concatenate(found)


def _scan_outside(
    bricks: BrickArray, ends: tuple[float, float], chosen: list[Step]
) -> tuple[NDArray[Any], int]:
    """Return finite values of some bricks outside a range, and the number of bricks read."""
    own, (low, high) = bricks.anew(), ends

    def scan(index: Step) -> NDArray[Any]:
        values = own.brick(index)
        return np.asarray(values[((values < low) | (values > high)) & np.isfinite(values)])

    return np.concatenate(list(in_order(scan, chosen))), own.reads


def step_of(size: int) -> int:
    """Return the stride of a sample of about this size."""
    return max(1, int(np.cbrt(size / SAMPLED)))


def are_few(dtype: np.dtype[Any]) -> bool:
    """Return whether a type has few possible values."""
    return dtype.kind in "iu" and dtype.itemsize <= 2


def count_codes(values: NDArray[Any], *, of: int | None = None) -> NDArray[np.int64]:
    """Count each of few possible values, by its bits."""
    size = 1 << (values.dtype.itemsize * 8)
    code = np.ascontiguousarray(values).view(f"u{values.dtype.itemsize}").reshape(1, -1)
    if of is not None and of <= LITTLE:
        return np.bincount(code[0], minlength=size)
    import cv2

    count = cv2.calcHist([code], [0], None, [size], [0, size])
    return np.asarray(count.ravel().astype(np.int64))


def extent(values: NDArray[Any]) -> tuple[float, float, int, int]:
    """Return the least and greatest finite value, and counts of infinite and missing ones."""
    if values.dtype.kind in "iu":
        return float(values.min()), float(values.max()), 0, 0
    is_finite = np.isfinite(values)
    known = values if is_finite.all() else values[is_finite]
    missing = int(np.isnan(values).sum()) if known.size < values.size else 0
    infinite = values.size - known.size - missing
    if not known.size:
        return np.inf, -np.inf, infinite, missing
    return float(known.min()), float(known.max()), infinite, missing


def finite_outside(
    parts: Iterable[NDArray[Any]], low: float, high: float
) -> tuple[NDArray[Any], int]:
    """Return finite values (N,) of parts outside a range, and the number of infinite ones."""
    found, infinite = [np.zeros(0)], 0
    for part in parts:
        outside = part[(part < low) | (part > high)]
        finite = outside[np.isfinite(outside)]
        infinite += outside.size - finite.size
        found.append(np.asarray(finite, np.float64))
    return np.concatenate(found), infinite


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
    """Return ascending thresholds between 2 or 3 classes; none if there are fewer values."""
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
    """Find a peak between the most frequent value of a range and another; or None.

    Blurred edges of denser objects spread over all lower values, and make no peak. `each` is the
    number of voxels per voxel of the sample.
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
