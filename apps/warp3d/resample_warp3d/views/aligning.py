"""Align the depths of several sources by a scale each, from points seen by two."""

import math
from collections.abc import Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np

from resample.types import Doubles
from resample_warp3d.depth.equation import places, warp_places
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Equation, Source
from resample_warp3d.views.robust import solved

DEPTHS = ("scale", "none")
COMPARED = 40_000  # approximate number of points per source
ROUNDS = 3
CLOSE = 0.08  # relative nearness within which a point belongs to a surface
FEWEST = 200  # points that two sources must share to be compared
STEP = 1e-3  # relative step of the nearness for finite differences
UNNOTICED = 2e-4  # smaller corrections are ignored
ALL = RIGHT | DOWN | LEFT | UP


class Correspondences(NamedTuple):
    """Points of one source that meet another's surface."""

    error: Doubles  # (N,) logarithm of the other's nearness over that of the point
    change: Doubles  # (N,) derivative of the error by the logarithm of the first one's scale


def check_depths(depths: str) -> None:
    """Refuse an unknown way to match depths."""
    if depths not in DEPTHS:
        raise ValueError(f"unknown way to match depths {depths!r}; known: {', '.join(DEPTHS)}")


def match_depths(
    sources: Sequence[Source], equations: Sequence[Sequence[Equation]], depths: str = "scale"
) -> Doubles:
    """Return factors (V,) of the sources' nearness that make their surfaces agree.

    Returns
    -------
    Factors with product 1, as no source is known to be right. All are 1 if the sources agree within
    0.02 %; a source that shares nothing with the others gets 1.
    """
    check_depths(depths)
    count = len(sources)
    scale = np.zeros(count)
    if depths == "none" or count < 2:
        return np.exp(scale)
    points = [_points(source) for source in sources]
    for _ in range(ROUNDS):
        rows, right = [], []
        for first, second in permutations(range(count), 2):
            if sources[second].place.size:
                continue
            place, nearness = points[first]
            seen = nearness * math.exp(scale[first])
            met = _points_on_surface(
                place, seen, equations[first][second], sources[second], scale[second]
            )
            if met.error.size < FEWEST:
                continue
            row = np.zeros((met.error.size, count))
            row[:, first], row[:, second] = met.change, 1.0
            rows.append(row)
            right.append(row[:, first] * scale[first] + scale[second] - met.error)
        if not rows:
            break
        scale = solved(np.concatenate(rows), np.concatenate(right), np.ones((1, count)), scale)
    if np.abs(scale).max() <= UNNOTICED:
        scale = np.zeros(count)
    return np.exp(scale)


def scaled(source: Source, scale: float) -> Source:
    """Return a source with its nearness multiplied."""
    if scale == 1.0:
        return source
    factor = np.float32(scale)
    return source._replace(
        nearness=source.nearness * factor, slope=source.slope * factor, step=source.step * scale
    )


def _points(source: Source) -> tuple[Doubles, Doubles]:
    """Return positions (N, 2) and nearness (N,) of some samples inside surfaces."""
    sparse = max(1, math.isqrt(source.nearness.size // COMPARED))
    chosen = slice(sparse // 2, None, sparse)
    image = DepthImage(source.color, source.nearness, source.place)
    nearness = source.nearness[chosen, chosen].astype(np.float64)
    inside = (source.links[chosen, chosen] & ALL) == ALL
    return places(image)[chosen, chosen][inside], nearness[inside]


def _points_on_surface(
    place: Doubles, nearness: Doubles, equation: Equation, other: Source, scale: float
) -> Correspondences:
    """Return the points that meet a surface of the other source, given its scale."""
    error = _errors(place, nearness, equation, other)
    moved = _errors(place, nearness * math.exp(STEP), equation, other)
    known = np.isfinite(error) & np.isfinite(moved)
    known[known] = np.abs(error[known] + scale) < CLOSE
    return Correspondences(error[known] + scale, (moved[known] - error[known]) / STEP)


def _errors(place: Doubles, nearness: Doubles, equation: Equation, other: Source) -> Doubles:
    """Return log ratios (N,) of the other's nearness to the points'; nan off its surfaces."""
    seen, expected = warp_places(equation, place, nearness)
    found = inside_surface(other, seen)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.log(found) - np.log(expected), np.float64)


def inside_surface(source: Source, place: Doubles) -> Doubles:
    """Interpolate a source's nearness (N,) at places (N, 2); nan off its surfaces."""
    height, width = source.nearness.shape
    at = np.where(np.isfinite(place), place, -1.0) - 0.5
    column, row = (np.floor(at[:, axis]).astype(np.int64) for axis in (0, 1))
    good = (column >= 0) & (row >= 0) & (column < width - 1) & (row < height - 1)
    column, row = np.where(good, column, 0), np.where(good, row, 0)
    links = source.links
    good &= (links[row, column] & (RIGHT | DOWN)) == (RIGHT | DOWN)
    good &= (links[row + 1, column + 1] & (LEFT | UP)) == (LEFT | UP)
    x, y = at[:, 0] - column, at[:, 1] - row
    nearness = source.nearness.astype(np.float64)
    above = (1 - x) * nearness[row, column] + x * nearness[row, column + 1]
    below = (1 - x) * nearness[row + 1, column] + x * nearness[row + 1, column + 1]
    return np.where(good, (1 - y) * above + y * below, np.nan)
