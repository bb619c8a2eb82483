"""Transfer functions derived from the data."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.painting.choices import Projection
from resample_volume.classification.materials import spread
from resample_volume.classification.surveys import LUNG, Survey, tissue, with_lungs
from resample_volume.classification.transfer import Color, Transfer, TransferFunction, from_points
from resample_volume.data.scanning import are_few, step_of
from resample_volume.data.thresholds import Peak, peak_between
from resample_volume.data.values import values_of
from resample_volume.types import Volume

WHITE, SAND, CLAY = (1.0, 1.0, 1.0), (0.95, 0.85, 0.6), (0.7, 0.5, 0.35)
RAMP: list[tuple[float, Color, float]] = [(0.0, CLAY, 0.0), (0.2, SAND, 0.5), (1.0, WHITE, 0.8)]

# Thin soft material is a veil in front of dense material.
SOFT, VEIL = (0.45, 0.62, 0.4), 0.15
DIP = 0.9  # greatest valley before a soft material's peak, of the peak's height
MOST_SOFT = 3.0  # ratio to dense voxels: a larger one is an embedding medium
MOST_AROUND = 0.01  # share of the border that may be soft: more is the surroundings

# HU where flesh begins and where lungs end; lungs are a peak with clear valleys, a large share of
# voxels, rarely at the border.
FLESH, FOAM = -300.0, -450.0
CLEAR, LEAST_LUNG, MOST_LUNG_AROUND = 0.5, 0.03, 0.1

SURROUNDING = 0.97  # share of a volume's border from which the surroundings count as dense
BRIGHT = 99.5  # percentile of the means along lines for white
LEAST_WITHIN = 0.01  # share of all voxels above which they are not

# Gray levels, for projections of values. The least value is transparent: on black that makes no
# difference, and most voxels may have it.
LEVELS = from_points(
    [(0.0, (0.0,) * 3, 0.0), (0.001, (0.001,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True
)


def ramp(start: float = 0.0) -> TransferFunction:
    """Return a ramp: transparent below a fraction of the range, opaque soon above it."""
    places = [(start + place * (1 - start), color, opacity) for place, color, opacity in RAMP]
    return from_points([*places[:-1], (1.0, WHITE, 0.8)], normalized=True)


def tomographic(volume: Volume, known: Survey) -> TransferFunction:
    """Return `ct` for Hounsfield units, with lungs if these have a peak."""
    added = known.units.added or 0.0
    low, high = (end + added for end in LUNG)
    lungs = peak_between(known.levels, low, FLESH + added, CLEAR, _each(volume))
    if lungs is None or not low <= lungs.value <= high:
        return tissue("ct", added)
    around = np.asarray(values_of(volume.values).border(), np.float64)
    is_around = np.mean((around >= lungs.before) & (around <= lungs.after)) > MOST_LUNG_AROUND
    if is_around or lungs.share(known.levels) < LEAST_LUNG:
        return tissue("ct", added)
    return with_lungs(lungs.before, lungs.value, min(lungs.after, FOAM + added), added)


def automatic(volume: Volume, known: Survey) -> TransferFunction:
    """Return a transfer function for unknown data.

    Values below Otsu's threshold (1979), which splits the histogram into the two most homogeneous
    classes, are transparent; above it opacity rises quickly to a half per voxel. If the volume's
    border lies above it, this is reversed. Padding and outliers are left out.
    """
    import cv2

    low, high = known.span
    if not low < high or not known.levels.value.size:
        return from_points([(0.0, SAND, 0.5)])
    some = _codes(values_of(volume.values).sample(), known)
    if not some.size:  # the rest lies between the samples
        some = _codes(known.levels.value, known)
    threshold, _ = cv2.threshold(some, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    around = _codes(values_of(volume.values).border(), known)
    is_dense = bool(around.size) and np.mean(around > threshold) >= SURROUNDING
    if is_dense and np.mean(some <= threshold) >= LEAST_WITHIN:
        return _reversed(ramp(1 - threshold / 256))
    soft = _soft(known, _each(volume), around, low + (high - low) * threshold / 255)
    return ramp((threshold + 1) / 256) if soft is None else _with_soft(soft, known, threshold)


def _soft(known: Survey, each: int, around: NDArray[np.uint8], threshold: float) -> Peak | None:
    """Find a material below a threshold with its own peak that is not the surroundings."""
    low, high = known.span
    soft = peak_between(known.levels, threshold, threshold, DIP, each)
    if soft is None or soft.share(known.levels) > MOST_SOFT * known.levels.share(threshold, high):
        return None
    first, last = ((value - low) / (high - low) * 255 for value in (soft.before, soft.after))
    is_soft = (around >= first) & (around <= last)
    return None if around.size and np.mean(is_soft) > MOST_AROUND else soft


def _each(volume: Volume) -> int:
    """Return the voxels per voxel of the sample with known values."""
    return 1 if are_few(volume.values.dtype) else step_of(volume.values.size) ** 3


def _with_soft(soft: Peak, known: Survey, threshold: float) -> TransferFunction:
    """Return dense material as in `ramp`, with the soft one as a veil."""
    low, high = known.span
    before, peak, after = ((value - low) / (high - low) for value in soft)
    dense = ramp((threshold + 1) / 256)
    points = [(before, SOFT, 0.0), (peak, SOFT, VEIL), (after, SOFT, VEIL)]
    start = max(float(dense.value[0]), after)
    points += [(start, CLAY, VEIL), *((max(start, v), c, o) for v, c, o in _points(dense)[1:])]
    return from_points(points, normalized=True)


def _points(transfer: TransferFunction) -> list[tuple[float, Color, float]]:
    rows = zip(transfer.value, transfer.color, transfer.opacity, strict=True)
    return [(float(value), tuple(color), float(opacity)) for value, color, opacity in rows]


def _codes(values: NDArray[Any], known: Survey) -> NDArray[np.uint8]:
    """Quantize values of the robust range to 0 to 255."""
    low, high = known.span
    some = np.asarray(values, np.float64)
    some = some[(some >= low) & (some <= high)]
    return np.round((some - low) * (255 / (high - low))).astype(np.uint8)


def _reversed(transfer: TransferFunction) -> TransferFunction:
    """Reverse a transfer function of fractions, so that it shows low values."""
    color, opacity = transfer.color[::-1], transfer.opacity[::-1]
    return TransferFunction(1 - transfer.value[::-1], color, opacity, normalized=True)


def levels(
    volume: Volume, known: Survey, projection: Projection, window: tuple[float, float] | None
) -> Transfer:
    """Return gray levels for a projection of values.

    Means along rays span less than the data, since rays mostly pass the surroundings; their range
    is that of the means along the volume's axes.
    """
    if window is not None:
        return spread(LEVELS, window)
    if projection is Projection.AVERAGE:
        return spread(LEVELS, range_of_means(volume, known))
    return LEVELS if known.is_plain else spread(LEVELS, known.span)


def range_of_means(volume: Volume, known: Survey) -> tuple[float, float]:
    """Return the range of the means along all lines parallel to a volume's axes.

    The brightest lines do not count: they run along a wall, unlike most rays.
    """
    total = [np.zeros(size) for size in _sides(volume.values)]
    count = [np.zeros(size) for size in _sides(volume.values)]
    for z, part in enumerate(volume.values):
        value = np.asarray(part, np.float64)
        inside = (value >= known.low) & (value <= known.high)
        value = np.where(inside, value, 0.0)
        for sums, terms in ((total, value), (count, inside)):
            sums[0] += terms
            sums[1][z] = terms.sum(axis=0)
            sums[2][z] = terms.sum(axis=1)
    ends = [sums[n > 0] / n[n > 0] for sums, n in zip(total, count, strict=True)]
    mean = np.concatenate([part.ravel() for part in ends])
    low, high = np.percentile(mean, [0, BRIGHT]) if mean.size else (0.0, 0.0)
    if low < high:
        return float(low), float(high)
    return known.low, max(known.high, float(np.nextafter(known.low, np.inf)))


def _sides(values: NDArray[Any]) -> list[tuple[int, int]]:
    z, y, x = values.shape
    return [(y, x), (z, x), (z, y)]
