"""Transfer functions derived from the data."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.painting.choices import Projection
from resample_volume.classification.transfer import (
    Color,
    Transfer,
    TransferFunction,
    from_points,
    spread,
)
from resample_volume.classification.value_statistics import LUNG, Survey, tissue, with_lungs
from resample_volume.data.scanning import Peak, are_few, peak_between, step_of
from resample_volume.data.values import values_of
from resample_volume.types import Volume

WHITE, SAND, CLAY = (1.0, 1.0, 1.0), (0.95, 0.85, 0.6), (0.7, 0.5, 0.35)
RAMP: list[tuple[float, Color, float]] = [(0.0, CLAY, 0.0), (0.2, SAND, 0.5), (1.0, WHITE, 0.8)]

# Thin soft material is a veil in front of dense material.
SOFT, VEIL = (0.45, 0.62, 0.4), 0.15
SOLID = 0.5  # fraction of a body's voxels whose neighbours are all of it
DIP = 0.9  # greatest valley before a soft material's peak, of the peak's height
MOST_SOFT = 3.0  # ratio to dense voxels: a larger one is an embedding medium
MOST_AROUND = 0.01  # share of the border that may be soft: more is the surroundings

# Values on both sides of zero, which is transparent. Colors are full from where they are seen on: a
# pale rim would hide what it surrounds.
COLD, COOL, WARM, HOT = (0.23, 0.3, 0.75), (0.5, 0.67, 0.98), (0.96, 0.62, 0.48), (0.75, 0.08, 0.15)
OTHER_SIDE = 0.15  # least extent of the smaller side, of the larger
NEAR_ZERO = 0.1  # of the larger side, within which half of all voxels must be
NOISE, LEAST_START, MOST_START = 4.0, 0.08, 0.35  # standard deviations; of the larger side

# Thin, faint structure away from dense material, such as small vessels: noise is `SURE` standard
# deviations from what is around it, and never less than a fraction of the range.
SURE, LEAST_NOISE = 5.0, 0.02
APART, FRIENDS = 2, 4  # voxels between dense and faint ones; least faint ones in 3 x 3 x 3
WIDTH, MOSTLY = 4, 0.5  # voxels; fraction of what is faint that must be as thin along two axes
LEAST_FAINT = 2e-5  # of all voxels
FAINT = 0.4  # its opacity
# Hot spots in a body of a value of its own, as of positron emission: dense voxels are few.
BODY, MOST_HOT, BODY_DEPTH = (0.45, 0.55, 0.7), 0.02, 0.7  # color; share; the body's opacity
MOST_CUT = 0.2  # share of the border at which the body is cut

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
    """Return a transfer function for unknown data, without padding and outliers.

    Values below Otsu's threshold (1979) are transparent; above it opacity rises quickly to a half
    per voxel. It is reversed if the volume's border is above the threshold. Floating-point values
    around zero are shown on both sides of it.
    """
    import cv2

    low, high = known.span
    if not low < high or not known.levels.value.size:
        return from_points([(0.0, SAND, 0.5)])
    if volume.values.dtype.kind == "f" and is_signed(known):
        return _signed(known)
    some = _codes(values_of(volume.values).sample(), known)
    if not some.size:  # the rest lies between the samples
        some = _codes(known.levels.value, known)
    threshold, _ = cv2.threshold(some, 0, 255, cv2.THRESH_BINARY | cv2.THRESH_OTSU)
    around = _codes(values_of(volume.values).border(), known)
    is_dense = bool(around.size) and np.mean(around > threshold) >= SURROUNDING
    if is_dense and np.mean(some <= threshold) >= LEAST_WITHIN:
        dense = ramp(1 - threshold / 256)  # reversed, it shows low values
        color, opacity = dense.color[::-1], dense.opacity[::-1]
        return TransferFunction(1 - dense.value[::-1], color, opacity, normalized=True)
    limit = low + (high - low) * threshold / 255
    # A soft material below the threshold has a peak of its own, and is not the surroundings.
    soft = peak_between(known.levels, limit, limit, DIP, _each(volume))
    if soft is not None:
        is_much = soft.share(known.levels) > MOST_SOFT * known.levels.share(limit, high)
        first, last = ((end - low) / (high - low) * 255 for end in (soft.before, soft.after))
        is_soft = (around >= first) & (around <= last)
        if is_much or (around.size and np.mean(is_soft) > MOST_AROUND):
            soft = None
    if soft is not None:
        before, peak, after = ((value - low) / (high - low) for value in soft)
        dense = ramp((threshold + 1) / 256)
        points = [(before, SOFT, 0.0), (peak, SOFT, VEIL), (after, SOFT, VEIL)]
        start = max(float(dense.value[0]), after)
        points += [(start, CLAY, VEIL), *((max(start, v), c, o) for v, c, o in _points(dense)[1:])]
        return from_points(points, normalized=True)
    if (body := _body(volume, known, limit)) is not None:
        # Hot spots in a body; the body is a veil as deep as it is large.
        before, peak, _ = ((value - low) / (high - low) for value in body)
        across = np.cbrt(
            body.share(known.levels) / known.levels.share(low, high) * volume.values.size
        )
        veil = 1 - (1 - BODY_DEPTH) ** (1 / max(1.0, float(across)))
        hot = ramp((threshold + 1) / 256)
        points = [(before, BODY, 0.0), (peak, BODY, veil)]
        points += [(max(peak, v), c, max(o, VEIL)) for v, c, o in _points(hot)]
        return from_points(points, normalized=True)
    faint = _faint(values_of(volume.values).sample(), known, limit)
    dense = ramp((threshold + 1) / 256)
    if faint is None:
        return dense
    start, typical = ((value - low) / (high - low) for value in faint)
    end = max(float(dense.value[0]), typical)
    points = [(start, CLAY, 0.0), (typical, CLAY, FAINT), (end, CLAY, FAINT)]
    points += [(max(end, v), c, max(o, FAINT)) for v, c, o in _points(dense)]
    return from_points(points, normalized=True)


def is_signed(known: Survey) -> bool:
    """Return whether values spread to both sides of zero, around which most are."""
    limit, smaller = max(-known.low, known.high), min(-known.low, known.high)
    if smaller < OTHER_SIDE * limit or not known.levels.value.size:
        return False
    return known.levels.share(-NEAR_ZERO * limit, NEAR_ZERO * limit) >= 0.5 * known.levels.share(
        known.low, known.high
    )


def _signed(known: Survey) -> TransferFunction:
    """Return blue below zero, red above, and nothing around it, where there may be noise."""
    limit = max(-known.low, known.high)
    away = known.levels.value != 0  # what is outside of a measured region
    size = np.abs(known.levels.value[away])
    order = np.argsort(size)
    total = np.cumsum(known.levels.number[away][order])
    typical = size[order][np.searchsorted(total, total[-1] / 2)]
    start = limit * float(np.clip(NOISE * typical / 0.6745 / limit, LEAST_START, MOST_START))
    soon = start + RAMP[1][0] * (limit - start)
    return from_points(
        [
            (-limit, COLD, RAMP[2][2]),
            (-soon, COOL, RAMP[1][2]),
            (-start, COOL, 0.0),
            (start, WARM, 0.0),
            (soon, WARM, RAMP[1][2]),
            (limit, HOT, RAMP[2][2]),
        ]
    )


def _body(volume: Volume, known: Survey, threshold: float) -> Peak | None:
    """Find the body around few hot spots: a peak between the surroundings and the threshold."""
    if known.levels.share(threshold, known.high) > MOST_HOT:
        return None
    below = known.levels.between(0, int(np.searchsorted(known.levels.value, threshold)))
    body = peak_between(below, threshold, threshold, DIP, _each(volume))
    values = values_of(volume.values)
    if body is None or np.mean(values.border() >= body.before) > MOST_CUT:
        return None
    inside = values.sample() >= body.before
    solid = np.count_nonzero(_joined(inside, 1, np.logical_and))
    return body if solid >= SOLID * np.count_nonzero(inside) else None


def _faint(some: NDArray[Any], known: Survey, threshold: float) -> tuple[float, float] | None:
    """Find structure below a threshold that is not an edge: its halfway and typical values."""
    values = some if some.dtype.itemsize <= 2 else np.asarray(some, np.float64)
    dense = values > threshold
    rest = values[(values >= known.low) & ~dense][::7].astype(np.float64)
    if not rest.size or rest.min() == rest.max() or not dense.any():
        return None
    middle = float(np.median(rest))
    away = np.abs(rest - middle)
    # Where most are equal, as below a limit of the scanner, noise is what differs.
    noise = float(np.median(away if np.median(away) else away[away > 0])) / 0.6745
    start = middle + SURE * max(noise, LEAST_NOISE / SURE * (known.high - known.low))
    if start >= threshold:
        return None
    faint = (values > start) & ~_joined(dense, APART, np.logical_or)
    is_faint = faint & (_joined(faint.astype(np.uint8), 1, np.add) > FRIENDS)
    outside = values <= start
    count = np.zeros(outside.shape, np.uint8)
    for axis in range(3):
        along, total = np.moveaxis(outside, axis, 0), np.moveaxis(count, axis, 0)
        total[WIDTH:-WIDTH] += along[: -2 * WIDTH] & along[2 * WIDTH :]
    is_thin = is_faint & (count >= 2)
    thin = np.count_nonzero(is_thin)
    if thin < max(LEAST_FAINT * values.size, MOSTLY * np.count_nonzero(is_faint)):
        return None
    typical = float(np.median(values[is_thin]))
    return max(start, (middle + typical) / 2), typical


def _joined(values: NDArray[Any], reach: int, join: np.ufunc) -> NDArray[Any]:
    """Join values of cubes that reach some voxels from their middle to each side."""
    for axis in range(3):
        along = np.moveaxis(values, axis, 0)
        total = along.copy(order="K")
        for away in range(1, reach + 1):
            join(total[away:], along[:-away], out=total[away:])
            join(total[:-away], along[away:], out=total[:-away])
        values = np.moveaxis(total, 0, axis)
    return values


def _each(volume: Volume) -> int:
    """Return the voxels per voxel of the sample with known values."""
    return 1 if are_few(volume.values.dtype) else step_of(volume.values.size) ** 3


def _points(transfer: TransferFunction) -> list[tuple[float, Color, float]]:
    rows = zip(transfer.value, transfer.color, transfer.opacity, strict=True)
    return [(float(value), tuple(color), float(opacity)) for value, color, opacity in rows]


def _codes(values: NDArray[Any], known: Survey) -> NDArray[np.uint8]:
    """Quantize values of the robust range to 0 to 255."""
    low, high = known.span
    some = np.asarray(values, np.float64)
    some = some[(some >= low) & (some <= high)]
    return np.round((some - low) * (255 / (high - low))).astype(np.uint8)


def levels(
    volume: Volume, known: Survey, projection: Projection, window: tuple[float, float] | None
) -> Transfer:
    """Return gray levels for a projection of values; of means, over the range of means."""
    if window is not None:
        return spread(LEVELS, window)
    if projection is Projection.AVERAGE:
        return spread(LEVELS, range_of_means(volume, known))
    return LEVELS if known.is_plain else spread(LEVELS, known.span)


def range_of_means(volume: Volume, known: Survey) -> tuple[float, float]:
    """Return the range of the means along all lines parallel to a volume's axes.

    The brightest lines are left out: they run along a wall, unlike most rays.
    """
    deep, down, across = volume.values.shape
    sides = ((down, across), (deep, across), (deep, down))
    total, count = ([np.zeros(size) for size in sides] for _ in range(2))
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
