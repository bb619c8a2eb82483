"""Transfer functions by name: presets, tissues, colormaps, files, or found in the data."""

import os
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from resample.messages import choices_in, parts_of
from resample.painting.choices import Projection
from resample_volume.classification import TISSUES
from resample_volume.classification.scales import on_scale
from resample_volume.classification.transfer import (
    SUFFIXES,
    Color,
    Faded,
    Materials,
    Point,
    Region,
    RegionTransfer,
    Transfer,
    TransferFunction,
    from_points,
    spread,
)
from resample_volume.classification.value_statistics import LUNG, Survey, survey, tissue, with_lungs
from resample_volume.data.scanning import Peak, are_few, peak_between, step_of
from resample_volume.data.values import values_of
from resample_volume.types import Volume

WHITE, SAND, CLAY = (1.0, 1.0, 1.0), (0.95, 0.85, 0.6), (0.7, 0.5, 0.35)
RAMP: list[tuple[float, Color, float]] = [(0.0, CLAY, 0.0), (0.2, SAND, 0.5), (1.0, WHITE, 0.8)]

# Thin soft material is a veil in front of dense material.
SOFT, VEIL = (0.45, 0.62, 0.4), 0.15
SOLID = 0.5  # fraction of a body's voxels with all neighbours in it
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
# deviations from its surroundings, and never less than a fraction of the range.
SURE, LEAST_NOISE = 5.0, 0.02
APART, FRIENDS = 2, 4  # voxels between dense and faint ones; least faint ones in 3 x 3 x 3
WIDTH, MOSTLY = 4, 0.5  # voxels; fraction of faint structure that must be as thin along two axes
LEAST_FAINT = 2e-5  # of all voxels
FAINT = 0.4  # its opacity
# Hot spots in a uniform body, as in positron emission: dense voxels are few.
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
    # Do values spread to both sides of zero, around which most are?
    limit, smaller = max(-low, high), min(-low, high)
    if volume.values.dtype.kind == "f" and smaller >= OTHER_SIDE * limit:
        near = known.levels.share(-NEAR_ZERO * limit, NEAR_ZERO * limit)
        if near >= 0.5 * known.levels.share(low, high):
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
        share = body.share(known.levels) / known.levels.share(low, high)
        across = np.cbrt(share * volume.values.size)
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


def _signed(known: Survey) -> TransferFunction:
    """Return blue below zero, red above, and nothing around it, where there may be noise."""
    limit = max(-known.low, known.high)
    away = known.levels.value != 0  # voxels outside of a measured region
    size = np.abs(known.levels.value[away])
    order = np.argsort(size)
    total = np.cumsum(known.levels.number[away][order])
    typical = size[order][np.searchsorted(total, total[-1] / 2)]
    start = limit * float(np.clip(NOISE * typical / 0.6745 / limit, LEAST_START, MOST_START))
    soon = start + RAMP[1][0] * (limit - start)
    below = [(-limit, COLD, RAMP[2][2]), (-soon, COOL, RAMP[1][2]), (-start, COOL, 0.0)]
    above = [(start, WARM, 0.0), (soon, WARM, RAMP[1][2]), (limit, HOT, RAMP[2][2])]
    return from_points(below + above)


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
    """Return gray levels for a projection of values; of means, over the range of means.

    These are the means along all lines parallel to a volume's axes, without the brightest, which
    run along a wall, unlike most rays.
    """
    if window is not None:
        return spread(LEVELS, window)
    if projection is not Projection.AVERAGE:
        return LEVELS if known.is_plain else spread(LEVELS, known.span)
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
    low, high = np.percentile(mean, [0, BRIGHT]).tolist() if mean.size else (0.0, 0.0)
    if not low < high:
        low, high = known.low, max(known.high, float(np.nextafter(known.low, np.inf)))
    return spread(LEVELS, (low, high))


BLACK, RED, BLUE = (0.0, 0.0, 0.0), (0.85, 0.12, 0.08), (0.15, 0.25, 0.55)
GLASS, AMBER = (0.55, 0.65, 0.75), (1.0, 0.6, 0.2)

# `auto` for generated volumes with a look of their own.
GENERATED_VOLUMES = {
    "checker-box": "checker",
    "vessel-tree": "vessels",
    "marschner-lobb": "viridis:opacity=0.9,low=0.5",
}

# fmt: off
PRESETS: dict[str, Callable[[], Transfer]] = {
    # CT of a head: soft tissue lies near a quarter of the range, bone from two fifths on.
    "bone": partial(from_points, [
        (0.32, (0.55, 0.25, 0.15), 0.0), (0.4, (0.85, 0.65, 0.45), 0.25),
        (0.5, (0.95, 0.88, 0.75), 0.7), (1.0, WHITE, 0.95)], normalized=True),
    # Angiography: brighter and denser toward the axis of a vessel.
    "vessels": partial(from_points, [
        (0.08, (0.45, 0.02, 0.02), 0.0), (0.2, (0.8, 0.15, 0.1), 0.3),
        (0.5, (0.95, 0.4, 0.3), 0.7), (1.0, (1.0, 0.9, 0.75), 0.9)], normalized=True),
    # The block as glass around its denser parts.
    "engine": partial(from_points, [
        (70, GLASS, 0.0), (130, GLASS, 0.04), (175, GLASS, 0.04), (195, AMBER, 0.7)]),
    # A translucent shell around white meat, as in the paper's Figure 8f; the resin ends at 30.
    "lobster": partial(from_points, [
        (30, RED, 0.0), (45, RED, 0.05), (95, RED, 0.12), (115, WHITE, 0.4), (150, WHITE, 0.8)]),
    "checker": partial(from_points, [(64, BLUE, 1.0), (128, BLUE, 1.0), (128, SAND, 1.0)]),
    "gray": partial(from_points, [(0.0, BLACK, 0.0), (1.0, WHITE, 1.0)], normalized=True),
    # Boundaries of thin, medium and dense material, in data of any kind.
    "surfaces": partial(RegionTransfer, (
        Region((0.05, 0.4), BLUE, 0.06, (0.2, 1.0), (0.03, 0.2)),
        Region((0.3, 0.7), SAND, 0.5, (0.25, 1.0), (0.05, 0.25)),
        Region((0.6, 1.0), AMBER, 0.7, (0.1, 1.0), (0.05, 0.2))), normalized=True),
    # The paper's Figure 9: 1,160,038, 114,695 and 190,815 voxels are not transparent.
    "paper-engine": partial(from_points, [(71, WHITE, 0.0), (71, WHITE, 0.3)]),
    "paper-aneurism": partial(from_points, [(25, WHITE, 0.0), (25, WHITE, 0.3)]),
    "paper-lobster": partial(from_points, [
        (65, RED, 0.0), (65, RED, 0.1), (95, RED, 0.1), (115, WHITE, 0.3), (222, WHITE, 0.3),
        (222, WHITE, 0.0)]),
}
# fmt: on


NUMBER = r"[-+]?[0-9]*\.?[0-9]+(?:e[-+]?[0-9]+)?"
RANGE = re.compile(rf"({NUMBER})?\.\.({NUMBER})?", re.IGNORECASE)  # of values: 300..900, 500..
JOINT = re.compile(r"(?<![0-9][eE])\+(?!1024\b)")  # between materials, not in 1e+5 or hu+1024
BETWEEN = re.compile(r",(?!\s*(?:opacity|low|color|gradient)=)")  # looks of channels
# Points of value, color as displayed, and opacity: 40,red,0 90,white,0.5 or 40/red/0,90/white/0.5.
POINT, SLASHED = (rf"{NUMBER}{by}[^/,:+\s]+{by}{NUMBER}" for by in ",/")
POINTS = re.compile(rf"{POINT}(?:\s+{POINT})*|{SLASHED}(?:,{SLASHED})*", re.IGNORECASE)
ADJUSTMENTS = ("opacity", "low", "color", "gradient")  # in the order in which they are applied
SOFT_ENDS = 0.1  # of a range of values, over which its opacity rises and falls
# Colormaps of two colors with a neutral middle: it is transparent, and zero if there is one.
DIVERGING = re.compile(
    "(PiYG|PRGn|BrBG|PuOr|RdGy|RdBu|RdYlBu|RdYlGn|Spectral|coolwarm|bwr|seismic|berlin|managua|"
    "vanimo)(_r)?"
)

Window = tuple[float, float]  # least and greatest value


@dataclass(frozen=True)
class Names:
    """Resolver of names of transfer functions, with or without a volume."""

    volume: Volume | None = None
    known: Survey | None = None  # statistics of the volume's values
    window: Window | None = None  # range for functions of fractions

    def transfer(self, name: str) -> Transfer:
        """Return the transfer function of one material or of several, joined by +."""
        words = [name] if is_file(name) else JOINT.split(name)
        parts = tuple(self._part(word.strip()) for word in words)
        if len(parts) == 1 and not isinstance(parts[0], Faded):
            return parts[0]
        return Materials(parts)

    def _part(self, name: str) -> Transfer:
        if is_file(name):
            from resample_volume.classification.files import read_transfer

            return self._placed(read_transfer(Path(name)), name)
        base, _, text = name.partition(":")
        transfer = self._base(base)
        try:
            changes = dict(choices_in(text))
            if unknown := [key for key in changes if key not in ADJUSTMENTS]:
                known = ", ".join(ADJUSTMENTS)
                raise ValueError(f"unknown parameter {unknown[0]!r}; known: {known}")
            for key in ADJUSTMENTS:
                if key in changes:
                    transfer = _adjusted(transfer, key, changes[key])
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        is_placed = base == "auto" and not transfer.normalized
        return transfer if is_placed else self._placed(transfer, name)

    def _placed(self, transfer: Transfer, name: str) -> Transfer:
        """Rescale fractions to the window, or to the robust range."""
        if self.window is not None:
            if not transfer.normalized:
                raise ValueError(
                    f"the window applies to looks of fractions, but {name} is in data units "
                    "already; leave one of them out, or take gray, auto or a colormap"
                )
            return spread(transfer, self.window)
        if self.volume is not None and self.volume.scale:
            transfer = on_scale(transfer, self.volume.scale)
        if self.known is None or self.known.is_plain:
            return transfer
        return spread(transfer, self.known.span)

    def _base(self, name: str) -> Transfer:
        """Return the transfer function before its parameters are applied."""
        if name == "auto" and self.volume is not None and self.known is not None:
            if self.window is not None:
                return ramp()
            is_ct = self.known.units.added is not None
            return (tomographic if is_ct else automatic)(self.volume, self.known)
        if ends := RANGE.fullmatch(name):
            return _of_range(name, *ends.groups())
        if POINTS.fullmatch(name):
            return from_points([_point(part) for part in name.split("," if "/" in name else None)])
        added = None if self.known is None else self.known.units.added
        if name in TISSUES and self.window is None:
            if added is not None:
                return tissue(name, added)
            if self.known is None and name not in PRESETS:
                return tissue(name)
        if name in PRESETS:
            return PRESETS[name]()
        if name in TISSUES:
            if self.window is not None or self.volume is None or self.known is None:
                raise ValueError(
                    f"{name} is in Hounsfield units, which a window would rescale; leave one out"
                )
            raise ValueError(
                f"{name} is a look for Hounsfield units, but {self.volume.name} holds "
                f"{self.known.low:g} to {self.known.high:g} and does not look like it; give its "
                "units, hu or hu+1024, or take auto or a range of values such as 300..900"
            )
        import matplotlib

        if name not in matplotlib.colormaps:
            from difflib import get_close_matches

            near = get_close_matches(name, [*PRESETS, *TISSUES, *matplotlib.colormaps], 1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ValueError(
                f"unknown transfer function {name!r}; {hint}known: {', '.join(PRESETS)}; in "
                "Hounsfield "
                f"units {', '.join(TISSUES)}; the name of a matplotlib colormap, a range of values "
                "such as 300..900, points such as '40,red,0 90,white,0.5', or a .json or .toml "
                "file will do"
            )
        found = colormap(name)
        if not DIVERGING.fullmatch(name):
            return found
        found = replace(found, opacity=(2 * found.value - 1) ** 2)  # noise stays faint
        if self.window is None and self.known is not None and self.known.low < 0 < self.known.high:
            limit = max(-self.known.low, self.known.high)
            return spread(found, (-limit, limit))
        return found


def transfer_for(name: str, volume: Volume, window: Window | None = None) -> Transfer:
    """Return a transfer function by name or from a file; `auto` adapts to the volume.

    Fractions are of the robust range. Tissues need Hounsfield units, stated or guessed.
    """
    is_plain = name == "auto" and window is None
    if is_plain and volume.colors is not None and volume.colors.shape[-1] == 4:
        dtype = volume.values.dtype  # values are opacities
        most = float(np.iinfo(dtype).max) if dtype.kind in "iu" else 1.0
        return from_points([(0.0, WHITE, 0.0), (most, WHITE, 1.0)])
    own = GENERATED_VOLUMES.get(volume.name) if is_plain and not volume.scale else None
    if own is not None:
        return load_transfer(own)
    return Names(volume, survey(volume), window).transfer(name)


def load_transfer(name: str | Path) -> Transfer:
    """Return a transfer function by name or from a file.

    Parameters
    ----------
    name
        One of `PRESETS`; one of `TISSUES`, which are in Hounsfield units; a range of data
        values such as `300..900`, soft at its borders; points of value, color and opacity such as
        `40,tomato,0 120,#ffcc00,0.4`, linear between them; a matplotlib colormap, over the range of
        the data and with an opacity that rises from 0 to 1, of diverging ones (RdBu, coolwarm) from
        0 in the middle, which is zero if values have both signs; or a .json or .toml file.
        After all but a file `:opacity=0.2,low=0.3` multiplies all opacities (0..1) and makes
        transparent values below a limit (for functions of fractions 0..1 of the data's range);
        `color=tomato` takes one color, and `gradient=0.1,0.5` fades homogeneous regions, as in
        `classify`. Several materials are joined by +: `skin:opacity=0.1+bone`.

    Raises
    ------
    ValueError
        The name or a parameter is unknown, or the file's content is invalid.
    OSError
        The file cannot be read.

    Examples
    --------
    >>> from resample_volume import load_transfer
    >>> load_transfer("300..900:opacity=0.2").value.tolist()
    [300.0, 360.0, 840.0, 900.0]
    >>> load_transfer("40,tomato,0 120,#ffcc00,0.4").opacity.tolist()
    [0.0, 0.4]
    """
    return Names().transfer(str(name))


def is_file(name: str) -> bool:
    """Return whether a name is of a file, which may contain a + itself."""
    return name.lower().endswith(SUFFIXES) and ("+" not in name or os.path.exists(name))


def names_file(text: str) -> bool:
    """Return whether a look, or one of the looks of channels, may be read from a file."""
    looks = (text, *BETWEEN.split(text))
    words = (word for look in looks for word in (look, *JOINT.split(look)))
    return any(word.strip().lower().endswith(SUFFIXES) for word in words)


def _of_range(name: str, least: str | None, greatest: str | None) -> TransferFunction:
    """Return a function that shows only a range of values, with soft ends inside it."""
    low = None if least is None else float(least)
    high = None if greatest is None else float(greatest)
    if low is None and high is None:
        raise ValueError(f"{name!r} has no ends; give a range of values such as 300..900 or 300..")
    if low is not None and high is not None and not low < high:
        if low == high:
            raise ValueError(f"{name} is empty; give two values, such as {low:g}..{low + 1:g}")
        raise ValueError(f"{name} does not ascend; give {greatest}..{least}")
    width = SOFT_ENDS * (high - low) if low is not None and high is not None else 0.0
    points = [] if low is None else [(low, SAND, 0.0), (low + width, SAND, 1.0)]
    if high is not None:
        points += [(high - width, SAND, 1.0), (high, SAND, 0.0)]
    return from_points(points)


def _point(text: str) -> Point:
    """Parse a control point of the command line: value, color and opacity."""
    from resample_volume.classification.files import displayed_color

    value, color, opacity = parts_of(text)
    try:
        return float(value), displayed_color(color), float(opacity)
    except ValueError as error:
        raise ValueError(f"{text}: color {error}") from None


def colormap(name: str) -> TransferFunction:
    """Return a colormap of matplotlib by name, over the range of the data."""
    import matplotlib

    if name not in matplotlib.colormaps:
        raise ValueError(
            f"colors {name!r}; give the name of a matplotlib colormap, such as gray, viridis or "
            "coolwarm"
        )
    position = np.linspace(0, 1, 256)
    color = np.asarray(matplotlib.colormaps[name](position))[:, :3]
    return TransferFunction(position, color, position, normalized=True)


def _adjusted(transfer: Transfer, key: str, given: str) -> Transfer:
    """Apply one of `ADJUSTMENTS` to a transfer function."""
    from resample_volume.classification.files import displayed_color

    if key == "color":
        color = displayed_color(given)
        if isinstance(transfer, RegionTransfer):
            regions = tuple(replace(region, color=color) for region in transfer.regions)
            return replace(transfer, regions=regions)
        if isinstance(transfer, TransferFunction):
            return replace(transfer, color=np.tile(color, (transfer.value.size, 1)))
        raise ValueError("color does not apply to this one")
    numbers = []
    for part in parts_of(given) if key == "gradient" else [given]:
        try:
            numbers.append(float(part))
        except ValueError:
            raise ValueError(f"{key} must be a number (got {part!r})") from None
    number = numbers[0]
    if key == "opacity":
        if not 0 <= number <= 1:
            raise ValueError(f"opacity must be between 0 and 1 (got {number})")
        return transfer.thinned(number)
    if key == "low":
        if not np.isfinite(number) or (transfer.normalized and not 0 <= number <= 1):
            wanted = "between 0 and 1" if transfer.normalized else "finite"
            raise ValueError(f"low must be {wanted}")
        return transfer.cut(number)
    if len(numbers) != 2:
        raise ValueError(f"gradient must be two fractions such as 0.1,0.5 (got {given!r})")
    return Faded(transfer, (numbers[0], numbers[1]))


# In the order of application, regardless of the order given.
