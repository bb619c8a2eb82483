"""Looks that are made from the data: for volumes of which nothing is known, and for means."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.painting.choices import Projection
from resample_volume.data.bricks import sampled
from resample_volume.data.glances.looking import are_few, step_of
from resample_volume.data.thresholds import Peak, peak_between
from resample_volume.looks.materials import spread
from resample_volume.looks.surveys import Survey, rim
from resample_volume.looks.tissues import LUNG, tissue, with_lungs
from resample_volume.looks.transfer import Color, Transfer, TransferFunction, from_points
from resample_volume.types import Volume

WHITE, SAND, CLAY = (1.0, 1.0, 1.0), (0.95, 0.85, 0.6), (0.7, 0.5, 0.35)
RAMP: list[tuple[float, Color, float]] = [(0.0, CLAY, 0.0), (0.2, SAND, 0.5), (1.0, WHITE, 0.8)]

# What is thin and soft is seen through, before what is dense.
SOFT, VEIL = (0.45, 0.62, 0.4), 0.15
DIP = 0.9  # of a soft material's peak, that the valley before it has at most
MOST_SOFT = 3.0  # times as many voxels as dense ones: more are what these are embedded in
MOST_AROUND = 0.01  # of the rim, that may be soft: more are the surroundings

# HU where flesh begins and where lungs end; and what lungs are: a peak with clear valleys, a large
# part, seldom at the rim.
FLESH, FOAM = -300.0, -450.0
CLEAR, LEAST_LUNG, MOST_LUNG_AROUND = 0.5, 0.03, 0.1

SURROUNDING = 0.97  # of a volume's rim: where so much is dense, the surroundings are
BRIGHT = 99.5  # percentile of the means along lines that is white
LEAST_WITHIN = 0.01  # of all voxels, that then must not be

# Values as gray levels, which is how they are read where they are not classified. Nothing is made
# of the least value: in a picture on black that is no difference, and most voxels may have it.
LEVELS = from_points(
    [(0.0, (0.0,) * 3, 0.0), (0.001, (0.001,) * 3, 1.0), (1.0, (1.0,) * 3, 1.0)], normalized=True
)


def ramp(start: float = 0.0) -> TransferFunction:
    """Solid from soon after a fraction of the range on, transparent below it."""
    places = [(start + place * (1 - start), color, opacity) for place, color, opacity in RAMP]
    return from_points([*places[:-1], (1.0, WHITE, 0.8)], normalized=True)


def tomographic(volume: Volume, known: Survey) -> TransferFunction:
    """Transfer function for Hounsfield units: `ct`, which shows lungs where these have a peak."""
    added = known.units.added or 0.0
    low, high = (end + added for end in LUNG)
    lungs = peak_between(known.levels, low, FLESH + added, CLEAR, _each(volume))
    if lungs is None or not low <= lungs.value <= high:
        return tissue("ct", added)
    around = np.asarray(rim(volume.values), np.float64)
    is_around = np.mean((around >= lungs.before) & (around <= lungs.after)) > MOST_LUNG_AROUND
    if is_around or lungs.share(known.levels) < LEAST_LUNG:
        return tissue("ct", added)
    return with_lungs(lungs.before, lungs.value, min(lungs.after, FOAM + added), added)


def automatic(volume: Volume, known: Survey) -> TransferFunction:
    """Transfer function for data of which nothing is known.

    What is below Otsu's threshold (1979), the value that splits the histogram into the two most
    even classes, is transparent; from there on opacity rises quickly to a half per voxel. Where
    all around the volume is above it, it is the other way round. Padding and strays are left out.
    """
    import cv2

    low, high = known.span
    if not low < high or not known.levels.value.size:
        return from_points([(0.0, SAND, 0.5)])
    some = _codes(sampled(volume.values), known)
    if not some.size:  # what is there lies between the samples
        some = _codes(known.levels.value, known)
    threshold, _ = cv2.threshold(some, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    around = _codes(rim(volume.values), known)
    is_dense = bool(around.size) and np.mean(around > threshold) >= SURROUNDING
    if is_dense and np.mean(some <= threshold) >= LEAST_WITHIN:
        return _reversed(ramp(1 - threshold / 256))
    soft = _soft(known, _each(volume), around, low + (high - low) * threshold / 255)
    return ramp((threshold + 1) / 256) if soft is None else _with_soft(soft, known, threshold)


def _soft(known: Survey, each: int, around: NDArray[np.uint8], threshold: float) -> Peak | None:
    """Material below a threshold that has a peak of its own and surrounds nothing; or None."""
    low, high = known.span
    soft = peak_between(known.levels, threshold, threshold, DIP, each)
    if soft is None or soft.share(known.levels) > MOST_SOFT * known.levels.share(threshold, high):
        return None
    first, last = ((value - low) / (high - low) * 255 for value in (soft.before, soft.after))
    is_soft = (around >= first) & (around <= last)
    return None if around.size and np.mean(is_soft) > MOST_AROUND else soft


def _each(volume: Volume) -> int:
    """Voxels that one of those stands for whose values are known."""
    return 1 if are_few(volume.values.dtype) else step_of(volume.values.size) ** 3


def _with_soft(soft: Peak, known: Survey, threshold: float) -> TransferFunction:
    """Dense things as in `ramp`, and a soft one as a veil."""
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
    """Values of the robust range as 0 to 255."""
    low, high = known.span
    some = np.asarray(values, np.float64)
    some = some[(some >= low) & (some <= high)]
    return np.round((some - low) * (255 / (high - low))).astype(np.uint8)


def _reversed(transfer: TransferFunction) -> TransferFunction:
    """Transfer function of fractions that shows what is low instead of what is high."""
    color, opacity = transfer.color[::-1], transfer.opacity[::-1]
    return TransferFunction(1 - transfer.value[::-1], color, opacity, normalized=True)


def levels(
    volume: Volume, known: Survey, projection: Projection, window: tuple[float, float] | None
) -> Transfer:
    """Values as gray levels, for a projection that measures them.

    Means along rays reach over less than the data, since most of a ray is in what surrounds
    things; they get the range of the means along the volume's own axes.

    Parameters
    ----------
    volume
        Whose values.
    known
        Of them.
    projection
        Which measures.
    window
        Values of black and of white, if these are chosen.
    """
    if window is not None:
        return spread(LEVELS, window)
    if projection is Projection.AVERAGE:
        return spread(LEVELS, range_of_means(volume, known))
    return LEVELS if known.is_plain else spread(LEVELS, known.span)


def range_of_means(volume: Volume, known: Survey) -> tuple[float, float]:
    """Values between which means lie: of all lines through a volume along one of its axes.

    The brightest lines are not asked for: they follow a wall, and most views do not.
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
