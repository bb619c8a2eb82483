"""Match colors of several views by gain and bias, from surfaces that two show."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Doubles
from resample_warp3d.types import Warped
from resample_warp3d.views.blending import WHOLE
from resample_warp3d.views.robust import solved

COLORS = ("gain", "gain-bias", "none")
SAME = 0.02  # relative nearness within which views show the same surface
BLOCK = 8  # px per side; means over such blocks hardly depend on misalignment
FULL = 0.75  # share of a block's pixels that both views must show
FEWEST = 12  # blocks that two views must share to be compared
DARK, BRIGHT = 0.02, 0.98  # of the largest value: below is noise, above is clipped
UNNOTICED = 1e-3  # smaller gains or biases are ignored
MOST = 2.0  # largest gain


class Match(NamedTuple):
    """Gain and bias for each view and channel."""

    gain: Doubles  # (V, C)
    bias: Doubles  # (V, C)


def check_colors(colors: str) -> None:
    """Refuse an unknown way to match colors."""
    if colors not in COLORS:
        raise ValueError(f"unknown way to match colors {colors!r}; known: {', '.join(COLORS)}")


def match_colors(views: Sequence[Warped], colors: str = "gain") -> Match:
    """Return gains and biases that make views alike where they show the same surface.

    Returns
    -------
    The gains' product over the views is 1 and the biases' sum 0, as no view is known to be right.
    They are 1 and 0 for a view that shares nothing with the others, and for differences below 0.1
    %.
    """
    check_colors(colors)
    count, channels = len(views), views[0].image.shape[2]
    match = Match(np.ones((count, channels)), np.zeros((count, channels)))
    if colors == "none" or count < 2:
        return match
    pairs = list(_pairs(views))
    for channel in range(channels):
        gain, bias = _of_channel(pairs, count, channel, has_bias=colors == "gain-bias")
        if max(np.abs(np.log(gain)).max(), np.abs(bias).max()) > UNNOTICED:
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
    """Gain (V,) and bias (V,) of a channel."""
    rows = []
    for pair in pairs:
        use = pair.usable[:, channel]
        if use.sum() < FEWEST:
            continue
        row = np.zeros((int(use.sum()), 2 * count))
        first, second = (color[use, channel] for color in pair.color)
        row[:, pair.first], row[:, pair.second] = first, -second
        if has_bias:
            row[:, count + pair.first], row[:, count + pair.second] = 1.0, -1.0
        rows.append(row)
    gain, bias = np.ones(count), np.zeros(count)
    if not rows:
        return gain, bias
    sums = np.zeros((2, 2 * count))
    sums[0, :count] = sums[1, count:] = 1.0
    start = np.concatenate([gain, bias])
    found = solved(np.concatenate(rows), np.zeros(sum(map(len, rows))), sums, start)
    gain = np.clip(found[:count], 1.0 / MOST, MOST)
    level = np.exp(np.log(gain).mean())
    return gain / level, found[count:] / level
