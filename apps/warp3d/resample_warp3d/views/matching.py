"""Match several sources: their colors by gain and bias, their depths by a scale each."""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations, permutations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from resample.types import Doubles
from resample_warp3d.depth.equation import places, warp_places
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, DepthImage, Equation, Source, Warped
from resample_warp3d.views.merging import WHOLE

ROUNDS = 20
TIGHT = 1e-3  # in the unknowns' unit: smaller errors count squared, larger ones linearly
HOLD = 1e-6  # weight that holds unknowns without equations at `start`
COLORS = ("gain", "gain-bias", "none")
SAME = 0.02  # relative nearness within which views show the same surface
BLOCK = 8  # px per side; means over such blocks hardly depend on misalignment
FULL = 0.75  # share of a block's pixels that both views must show
FEWEST_BLOCKS = 12  # blocks that two views must share to be compared
DARK, BRIGHT = 0.02, 0.98  # of the largest value: below is noise, above is clipped
UNNOTICED_GAIN = 1e-3  # smaller gains or biases are ignored
MOST = 2.0  # largest gain
DEPTHS = ("scale", "none")
COMPARED = 40_000  # approximate number of points per source
ALIGNMENTS = 3
CLOSE = 0.08  # relative nearness within which a point belongs to a surface
FEWEST_POINTS = 200  # points that two sources must share to be compared
STEP = 1e-3  # relative step of the nearness for finite differences
UNNOTICED_SCALE = 2e-4  # smaller corrections are ignored
ALL = RIGHT | DOWN | LEFT | UP


def solved(rows: Doubles, right: Doubles, sums: Doubles, start: Doubles) -> Doubles:
    """Minimize the sum of absolute errors of `rows @ x = right`.

    `rows`, `right`: (N, M) and (N,). `sums`: (K, M) sums of unknowns that keep their value at
    `start`. `start`: (M,) values of unknowns without equations.
    """
    count, held = start.size, len(sums)
    found = start.copy()
    for _ in range(ROUNDS):
        error = np.abs(np.einsum("nm,m->n", rows, found) - right)
        weight = 1.0 / np.maximum(error, TIGHT)
        weight /= weight.sum()
        normal = np.zeros((count + held, count + held))
        weighed = rows * weight[:, None]
        normal[:count, :count] = np.einsum("nm,nk->mk", weighed, rows) + HOLD * np.eye(count)
        normal[:count, count:], normal[count:, :count] = sums.T, sums
        told = np.einsum("nm,n->m", weighed, right) + HOLD * start
        after = np.linalg.solve(normal, np.concatenate([told, sums @ start]))[:count]
        moved = float(np.abs(after - found).max())
        found = after
        if moved < 1e-7:
            break
    return found


class Match(NamedTuple):
    """Gain and bias for each view and channel."""

    gain: Doubles  # (V, C)
    bias: Doubles  # (V, C)


def check_colors(colors: str) -> None:
    """Reject an unknown way to match colors."""
    if colors not in COLORS:
        raise ValueError(f"unknown way to match colors {colors!r}; known: {', '.join(COLORS)}")


def match_colors(views: Sequence[Warped], colors: str = "gain") -> Match:
    """Return gains and biases that make views alike where they show the same surface.

    Result: the gains' product over the views is 1 and the biases' sum 0, as no view is known to be
    right. They are 1 and 0 for a view that shares nothing with the others, and for differences
    below 0.1 %.
    """
    check_colors(colors)
    count, channels = len(views), views[0].image.shape[2]
    match = Match(np.ones((count, channels)), np.zeros((count, channels)))
    if colors == "none" or count < 2:
        return match
    pairs = list(_pairs(views))
    for channel in range(channels):
        gain, bias = _of_channel(pairs, count, channel, has_bias=colors == "gain-bias")
        if max(np.abs(np.log(gain)).max(), np.abs(bias).max()) > UNNOTICED_GAIN:
            match.gain[:, channel], match.bias[:, channel] = gain, bias
    return match


def balanced(views: Sequence[Warped], match: Match) -> list[Warped]:
    """Apply gains and biases to views; uncovered pixels stay empty."""
    made = []
    for view, gain, bias in zip(views, match.gain, match.bias, strict=True):
        if (gain == 1).all() and (bias == 0).all():
            made.append(view)
            continue
        added = view.coverage[..., None] * bias.astype(np.float32)
        made.append(view._replace(image=view.image * gain.astype(np.float32) + added))
    return made


class SharedPoints(NamedTuple):
    """Blocks of pixels that two views share."""

    first: int
    second: int
    color: tuple[Doubles, Doubles]  # (N, C) of both
    usable: NDArray[np.bool_]  # (N, C)


def _pairs(views: Sequence[Warped]) -> Iterator[SharedPoints]:
    top = np.max([view.image.max(axis=(0, 1)) for view in views], axis=0)
    for first, second in combinations(range(len(views)), 2):
        one, other = views[first], views[second]
        shared = (one.coverage >= WHOLE) & (other.coverage >= WHOLE)
        far, near = (choose(one.depth, other.depth) for choose in (np.maximum, np.minimum))
        shared &= near >= np.where(shared, far, 0) * (1.0 - SAME)
        clear = shared[..., None] & (one.image < BRIGHT * top) & (other.image < BRIGHT * top)
        whole = _blocks(clear) >= FULL
        color = _means(one, clear), _means(other, clear)
        usable = whole & (np.minimum(*color) > DARK * top)
        yield SharedPoints(first, second, color, usable)


def _means(view: Warped, where: NDArray[np.bool_]) -> Doubles:
    share = np.maximum(_blocks(where), 1e-9)
    color = view.image / np.maximum(view.coverage, np.float32(WHOLE))[..., None]
    return np.asarray(_blocks(np.where(where, color, 0)) / share, np.float64)


def _blocks(values: NDArray[np.generic]) -> Doubles:
    """Average (H, W, C) over blocks, (N, C)."""
    height, width, channels = values.shape
    size = min(BLOCK, height, width)
    cut = values[: height // size * size, : width // size * size].astype(np.float64)
    shape = height // size, size, width // size, size, channels
    return np.asarray(cut.reshape(shape).mean(axis=(1, 3)).reshape(-1, channels), np.float64)


def _of_channel(
    pairs: Sequence[SharedPoints], count: int, channel: int, *, has_bias: bool
) -> tuple[Doubles, Doubles]:
    """Gain (V,) and bias (V,) of a channel.

    Gains alone are found by their logarithms. With biases, views without common surfaces, also by
    way of others, each keep their own mean: the errors of one half get less as it gets darker.
    """
    linked = [(pair, pair.usable[:, channel]) for pair in pairs]
    linked = [(pair, use) for pair, use in linked if use.sum() >= FEWEST_BLOCKS]
    if not linked:
        return np.ones(count), np.zeros(count)
    rows, right, views = [], [], np.eye(count)
    for pair, use in linked:
        first, second = (color[use, channel, None] for color in pair.color)
        one, other = views[pair.first], views[pair.second]
        right.append(np.zeros(len(first)) if has_bias else np.log(second / first)[:, 0])
        gains = first * one - second * other if has_bias else one - other + 0.0 * first
        rows.append(np.c_[gains, (one - other) * has_bias + 0.0 * first])
    between = np.zeros((count, count))
    between[tuple(np.transpose([(pair.first, pair.second) for pair, _ in linked]))] = 1.0
    parts, part = connected_components(between, directed=False)
    sums = np.kron(np.eye(2), part == np.arange(parts)[:, None])
    start = np.repeat([float(has_bias), 0.0], count)
    found = solved(np.concatenate(rows), np.concatenate(right), sums, start)
    gain = found[:count] if has_bias else np.exp(found[:count])
    gain = np.clip(gain, 1.0 / MOST, MOST)
    level = np.exp(sums[:parts, :count] @ np.log(gain) / sums[:parts, :count].sum(axis=1))[part]
    return gain / level, found[count:] / level


def check_depths(depths: str) -> None:
    """Reject an unknown way to match depths."""
    if depths not in DEPTHS:
        raise ValueError(f"unknown way to match depths {depths!r}; known: {', '.join(DEPTHS)}")


def match_depths(
    sources: Sequence[Source], equations: Sequence[Sequence[Equation]], depths: str = "scale"
) -> Doubles:
    """Return factors (V,) of the sources' nearness that make their surfaces agree.

    Result: factors with product 1, as no source is known to be right. All are 1 if the sources
    agree within 0.02 %; a source that shares nothing with the others gets 1.
    """
    check_depths(depths)
    count = len(sources)
    scale = np.zeros(count)
    if depths == "none" or count < 2:
        return np.exp(scale)
    points = []  # positions (N, 2) and nearness (N,) of some samples inside surfaces
    for source in sources:
        sparse = max(1, math.isqrt(source.nearness.size // COMPARED))
        chosen = slice(sparse // 2, None, sparse)
        image = DepthImage(source.color, source.nearness, source.place)
        inside = (source.links[chosen, chosen] & ALL) == ALL
        near = source.nearness[chosen, chosen].astype(np.float64)
        points.append((places(image)[chosen, chosen][inside], near[inside]))
    for _ in range(ALIGNMENTS):
        rows, right = [], []
        for first, second in permutations(range(count), 2):
            if sources[second].place.size:
                continue
            place, nearness = points[first]
            seen = nearness * math.exp(scale[first])
            # Logarithms of ratios of nearness where points meet a surface of the other source,
            # and their derivatives by the point's logarithm.
            way, other = equations[first][second], sources[second]
            error = _errors(place, seen, way, other)
            moved = _errors(place, seen * math.exp(STEP), way, other)
            known = np.isfinite(error) & np.isfinite(moved)
            known[known] = np.abs(error[known] + scale[second]) < CLOSE
            change = (moved[known] - error[known]) / STEP
            error = error[known] + scale[second]
            if error.size < FEWEST_POINTS:
                continue
            row = np.zeros((error.size, count))
            row[:, first], row[:, second] = change, 1.0
            rows.append(row)
            right.append(row[:, first] * scale[first] + scale[second] - error)
        if not rows:
            break
        scale = solved(np.concatenate(rows), np.concatenate(right), np.ones((1, count)), scale)
    if np.abs(scale).max() <= UNNOTICED_SCALE:
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
