"""Align relative depth over time: the scale and shift of a film's maps, and the film's cuts.

Networks give each picture of a film its own scale and shift. Within a shot, each map is fitted to
the aligned maps before it, where colors did not change; after a cut, alignment starts again:

    found = align(thumbnail(color, raw) for color, raw in film)
    aligned = found.scale[n] * raw + found.shift[n]
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.colors import to_srgb
from resample.types import Doubles, Floats
from resample_warp3d.depth.encodings import Raw

LONGEST = 160  # px of a thumbnail's longer side
BINS = 8  # of a color histogram, per channel
COLORS = 0.2  # share of the pixels with other colors after a cut, at least
MORE_COLORS = 0.2  # of them, times the correlation of the brightness
STRUCTURE = 0.5  # correlation of the brightness across a cut, at most
COARSE = 4  # px of a thumbnail per px of the brightness that is correlated
STEADY = 4.0 / 255.0  # change of color up to which a pixel is unchanged, if films have no noise
NOISIEST = 12.0 / 255.0  # the same, at most
CHANGED = 0.02  # weight of a pixel with a changed color, relative to an unchanged one
LONGEST_MEAN = 16  # maps in the mean that is an unchanged pixel's reference
MOST_POINTS = 5000  # of a thumbnail that are fitted
STEPS = 40  # of the reweighted fit
TINY = 1e-9  # of the depth's spread
LARGEST_SCALE = 2.0  # of a map relative to those before it; larger ones are rejected
EXPLAINED = 0.5  # share of the difference that may remain, for near and far points alike
OUTERMOST = 0.02, 0.98  # quantiles between which the middle divides near from far points
CLOSE = 0.02  # of the depth's spread: or this may remain
BETTER = 0.8  # share of the differences between pictures that may remain in an aligned shot
SAME = 1e-4  # of the depth's spread: smaller differences are ignored


class Thumbnail(NamedTuple):
    """A small picture and its raw depth."""

    color: Floats  # (h, w, 3) of 0..1, as screens show it
    depth: Doubles  # (h, w); NaN where unknown


class Fit(NamedTuple):
    """Scale and shift of a map."""

    scale: float
    shift: float

    def applied(self, depth: Doubles) -> Doubles:
        """Return an aligned map."""
        return self.scale * depth + self.shift


UNCHANGED = Fit(1.0, 0.0)


@dataclass(frozen=True, eq=False)
class Alignment:
    """Scale and shift of each map of a film, and its shots."""

    scale: Doubles  # (N,)
    shift: Doubles  # (N,)
    starts: tuple[int, ...]  # first picture of each shot
    aligned: tuple[bool, ...]  # whether the maps of each shot were changed

    @property
    def changes(self) -> float:
        """Largest scale relative to the smallest, less 1."""
        return float(self.scale.max() / self.scale.min()) - 1.0

    def ends(self, each: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
        """Return the range of each map that its shot's range of depths corresponds to.

        `each`: range of each map by itself.
        """
        low, high = self.scale * np.transpose(each) + self.shift
        stops = (*self.starts[1:], len(low))
        for start, stop in zip(self.starts, stops, strict=True):
            low[start:stop] = low[start:stop].min()
            high[start:stop] = high[start:stop].max()
        return [
            (float(first), float(last))
            for first, last in np.transpose([low - self.shift, high - self.shift] / self.scale)
        ]


def thumbnail(color: Floats, raw: Raw) -> Thumbnail:
    """Return a thumbnail of a picture (H, W, C) of linear light and its raw depth of any size."""
    import cv2

    height, width = color.shape[:2]
    factor = min(1.0, LONGEST / max(height, width))
    size = max(1, round(width * factor)), max(1, round(height * factor))
    shown = color[..., [0, 0, 0]] if color.shape[2] < 3 else color[..., :3]
    small = cv2.resize(np.ascontiguousarray(shown, np.float32), size, interpolation=cv2.INTER_AREA)
    depth = raw.astype(np.float64)
    depth[~np.isfinite(depth)] = np.nan
    depth = cv2.resize(depth, size, interpolation=cv2.INTER_AREA)
    light = np.clip(np.nan_to_num(small, nan=0.0), 0.0, 1.0)
    return Thumbnail(np.asarray(to_srgb(light), np.float32), np.asarray(depth, np.float64))


def is_cut(first: Floats, second: Floats) -> bool:
    """Whether two successive pictures belong to two shots: both colors and structure differ.

    A flash changes colors and a fast pan the structure, neither both.

    `first`, `second`: colors of thumbnails of one size.
    """
    moved = 0.5 * float(np.abs(_histogram(first) - _histogram(second)).sum())
    alike = _correlation(first, second)
    return alike < STRUCTURE and moved > COLORS + MORE_COLORS * max(alike, 0.0)


def _histogram(color: Floats) -> Doubles:
    """Return the shares of the pixels in boxes of colors."""
    index = np.minimum((color * BINS).astype(np.int64), BINS - 1)
    flat = (index[..., 0] * BINS + index[..., 1]) * BINS + index[..., 2]
    return np.bincount(flat.ravel(), minlength=BINS**3) / flat.size


def _correlation(first: Floats, second: Floats) -> float:
    """Return the correlation of the coarse brightness of two pictures; 1 if one has none."""
    import cv2

    height, width = first.shape[:2]
    size = max(1, width // COARSE), max(1, height // COARSE)
    small = [
        cv2.resize(each.mean(axis=2), size, interpolation=cv2.INTER_AREA).ravel()
        for each in (first, second)
    ]
    a, b = (each - each.mean() for each in small)
    length = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(a @ b) / length if length > 0.0 else 1.0


def fitted(depth: Doubles, reference: Doubles, weight: Doubles) -> Fit | None:
    """Return the scale and shift with the least sum of weighted absolute differences.

    Result: None if depth tells neither, or if near or far points do not agree with the fit.

    `depth`, `reference`, `weight`: (N,) known numbers, and weights above 0.
    """
    spread = float(np.ptp(reference)) if reference.size else 0.0
    if spread == 0.0 or np.ptp(depth) == 0.0:
        return None
    found, share = UNCHANGED, weight
    for _ in range(STEPS):
        total = share.sum()
        middle, level = share @ depth / total, share @ reference / total
        apart = depth - middle
        variance = float(share @ (apart * apart))
        scale = float(share @ (apart * (reference - level))) / variance if variance > 0.0 else 0.0
        found = Fit(scale, float(level - scale * middle))
        distance = np.abs(found.applied(depth) - reference)
        share = weight / np.maximum(distance, TINY * spread)
    if not 1.0 / LARGEST_SCALE <= found.scale <= LARGEST_SCALE:
        return None
    # A fit leaves little of the difference, both for most near and for most far points: things that
    # come nearer change depth, too, but not everywhere.
    left, before = np.abs(found.applied(depth) - reference), np.abs(depth - reference)
    low, high = (_weighted_quantile(depth, weight, share) for share in OUTERMOST)
    is_upper = depth > 0.5 * (low + high)
    parts = [part for part in (is_upper, ~is_upper) if part.any()]
    remaining, given = (
        max(_weighted_quantile(of[part], weight[part]) for part in parts) for of in (left, before)
    )
    return found if remaining <= max(CLOSE * spread, EXPLAINED * given) else None


def _weighted_quantile(values: Doubles, weight: Doubles, share: float = 0.5) -> float:
    """Return a quantile of weighted values; the median by default."""
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order[np.searchsorted(below, share * below[-1])]])


@dataclass
class _Shot:
    """Maps of a shot, aligned one after the other."""

    color: Floats  # of the last picture
    raw: Doubles  # its depth as given
    reference: Doubles  # aligned depth: means of the maps of unchanged pixels
    last: Doubles  # its aligned depth
    count: Doubles  # maps in these means
    fits: list[Fit] = field(default_factory=lambda: [UNCHANGED])
    given: list[float] = field(default_factory=list)  # differences between successive maps
    remaining: list[float] = field(default_factory=list)  # the same of the aligned maps

    @classmethod
    def begun(cls, picture: Thumbnail) -> "_Shot":
        depth = picture.depth
        return cls(picture.color, depth, depth.copy(), depth, np.ones(depth.shape))

    def add(self, picture: Thumbnail) -> None:
        """Align the next map."""
        # Weights are about 1 where colors did not change.
        change = np.abs(picture.color - self.color).max(axis=2).astype(np.float64)
        limit = float(np.clip(3.0 * np.median(change), STEADY, NOISIEST))
        steady = np.maximum(np.exp(-((change / limit) ** 2)), CHANGED)
        raw = picture.depth
        known = np.isfinite(raw) & np.isfinite(self.reference) & np.isfinite(self.raw)
        weight = steady * self.count
        few = np.flatnonzero(known)
        few = few[:: 1 + few.size // MOST_POINTS]
        points = (part.ravel()[few] for part in (raw, self.reference, weight))
        found = fitted(*points) or self.fits[-1]
        aligned = found.applied(raw)
        self.fits.append(found)
        self.given.append(_difference(raw, self.raw, steady, known))
        self.remaining.append(_difference(aligned, self.last, steady, known))
        is_held = known & (steady > 0.5)
        self.count = np.where(is_held, np.minimum(self.count + 1.0, LONGEST_MEAN), 1.0)
        before = np.where(np.isfinite(self.reference), self.reference, aligned)
        self.reference = before + (aligned - before) / self.count
        self.color, self.raw, self.last = picture.color, raw, aligned

    @property
    def is_better(self) -> bool:
        """Whether aligned maps differ clearly less from picture to picture."""
        spread = float(np.nanmax(self.reference) - np.nanmin(self.reference))
        given = sum(self.given)
        return given > SAME * spread * len(self.given) and sum(self.remaining) < BETTER * given


def _difference(
    first: Doubles, second: Doubles, weight: Doubles, known: NDArray[np.bool_]
) -> float:
    """Return the weighted mean of the absolute differences of two maps."""
    if not known.any():
        return 0.0
    return float(np.average(np.abs(first - second)[known], weights=weight[known]))


def align(film: Iterable[Thumbnail]) -> Alignment:
    """Align the maps of a film; shots with maps that agree are left unchanged."""
    shots: list[_Shot] = []
    for picture in film:
        last = shots[-1].color if shots else picture.color[:0]
        if last.shape != picture.color.shape or is_cut(last, picture.color):
            shots.append(_Shot.begun(picture))
        else:
            shots[-1].add(picture)
    better = tuple(shot.is_better for shot in shots)
    fits = [
        fit if is_better else UNCHANGED
        for shot, is_better in zip(shots, better, strict=True)
        for fit in shot.fits
    ]
    ends = np.cumsum([0, *(len(shot.fits) for shot in shots)])
    scale, shift = np.array(fits, np.float64).reshape(-1, 2).T
    return Alignment(scale, shift, tuple(int(start) for start in ends[:-1]), better)
