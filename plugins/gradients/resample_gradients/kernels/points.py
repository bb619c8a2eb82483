"""Gauss points of a pixel, and the weights of the samples around each.

A pixel covers a parallelogram of the source. Its mean is a sum over Gauss points of it; where an
edge of a transparent source runs through, the upright box around each point's share of the pixel
is clipped at the edge, and the point moves with it: sums and coverage change without jumps.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, making_kernel
from resample.engine.windows.boxes import CLAMP, MIRROR, TRANSPARENT, folded
from resample.types import Doubles

Integers = NDArray[np.int64]
Pair = tuple[float, float]

REFLECT_101 = 4  # an edge beside those of the engine: d c b | a b c d
FARTHEST = 2.0**40  # samples from the source's origin; places beyond count as nowhere
FEW = 0.57  # samples along a side of a pixel up to which two points are enough
PANEL = 2.09  # samples that a panel of four points covers at most
MOST_PANELS = 32.0  # along a side; larger pixels are sampled with gaps
AT_EDGES = 8  # points along a side of a pixel where an edge of the source runs through it, at least
SHARP = 1e-9  # samples; a smaller box counts as a point
NEARLY = 1e-9  # samples beyond an edge that count as nothing


class InterpolatedSource(NamedTuple):
    """A source and how it is interpolated."""

    weight: Doubles  # (D, K) of each sample's weight, a polynomial of the place; see `first_of`
    slope: Doubles  # (D − 1, K) of its derivative
    rules: Doubles  # (6, 4) Gauss points: two, then four; see `interpolation.rules`
    shift: float  # of the polynomials' pieces, samples
    size: tuple[int, int]  # (height, width) of the source
    margin: int  # coefficients around the source's own, on all sides
    ring: float  # samples beyond a clamped edge from which on values are constant
    edge: int
    quality: float  # factor by which panels are shorter


class Node(NamedTuple):
    """A point of a pixel, −0.5 to 0.5, and its share of the pixel."""

    x: float
    y: float
    weight: float
    left: float  # extent of its share to each side of it, px
    right: float
    above: float
    below: float


class PointScratch(NamedTuple):
    """Scratch for one point: weights (K,) along axes, and lines (K × C,) of a window."""

    along_u: Doubles
    along_v: Doubles
    slope_u: Doubles
    slope_v: Doubles
    line: Doubles
    sloped: Doubles


@inner_step
def points_along(long: float, quality: float) -> int:
    """Gauss points along a side of a pixel that is so many samples long."""
    # Two points are exact enough for small pixels.
    if long * quality <= FEW:
        return 2
    # Larger pixels take panels of four.
    return 4 * math.ceil(min(long * quality / PANEL, MOST_PANELS))


@inner_step
def counts_of(lens: InterpolatedSource, seen: Doubles, cut: bool) -> tuple[int, int]:
    """Points of a pixel along x and y."""
    along_x = points_along(math.hypot(seen[2], seen[3]), lens.quality)
    along_y = points_along(math.hypot(seen[4], seen[5]), lens.quality)
    return (max(along_x, AT_EDGES), max(along_y, AT_EDGES)) if cut else (along_x, along_y)


@inner_step
def _along(rules: Doubles, count: int, n: int) -> tuple[float, float, float, float]:
    """Place, weight and extents to both sides of the n-th point along a side."""
    # Look the two-point rule up, or the four-point rule in its panel.
    if count == 2:
        return rules[n, 0] - 0.5, rules[n, 1], rules[n, 2], rules[n, 3]
    panels, k = 4.0 / count, 2 + n % 4
    place = (n // 4 + rules[k, 0]) * panels - 0.5
    return place, rules[k, 1] * panels, rules[k, 2] * panels, rules[k, 3] * panels


@inner_step
def node_of(rules: Doubles, counts: tuple[int, int], n: int) -> Node:
    """The n-th point of a pixel, from the rules along x and y."""
    x, weight_x, left, right = _along(rules, counts[0], n % counts[0])
    y, weight_y, above, below = _along(rules, counts[1], n // counts[0])
    return Node(x, y, weight_x * weight_y, left, right, above, below)


@inner_step
def place_in(seen: Doubles, node: Node) -> tuple[float, float]:
    """Where a point of a pixel lies in the source."""
    u = seen[0] + node.x * seen[2] + node.y * seen[4]
    return u, seen[1] + node.x * seen[3] + node.y * seen[5]


@inner_step
def is_cut(lens: InterpolatedSource, seen: Doubles) -> bool:
    """Whether an edge of a transparent source runs through a pixel."""
    if lens.edge != TRANSPARENT:
        return False
    # Take the box around the parallelogram.
    reach_u = 0.5 * (abs(seen[2]) + abs(seen[4])) - NEARLY
    reach_v = 0.5 * (abs(seen[3]) + abs(seen[5])) - NEARLY
    across = seen[0] >= reach_u and seen[0] + reach_u <= lens.size[1]
    return not (across and seen[1] >= reach_v and seen[1] + reach_v <= lens.size[0])


@inner_step
def is_visible(lens: InterpolatedSource, seen: Doubles) -> bool:
    """Whether a pixel may show anything."""
    # Reject NaN and places too far away.
    if not (abs(seen[0]) <= FARTHEST and abs(seen[1]) <= FARTHEST):
        return False
    reach_u, reach_v = abs(seen[2]) + abs(seen[4]), abs(seen[3]) + abs(seen[5])
    if not (reach_u <= FARTHEST and reach_v <= FARTHEST):
        return False
    if lens.edge != TRANSPARENT:
        return True
    # Cull pixels beside a transparent source.
    across = seen[0] + reach_u > 0.0 and seen[0] - reach_u < lens.size[1]
    return bool(across and seen[1] + reach_v > 0.0 and seen[1] - reach_v < lens.size[0])


@inner_step
def sides(along_x: float, along_y: float, node: Node, axis_sign: float) -> tuple[float, float]:
    """Derivatives of a point's extent to one side (−1, 1) by its pixel's steps."""
    reach_x = node.right if along_x * axis_sign >= 0.0 else -node.left
    reach_y = node.below if along_y * axis_sign >= 0.0 else -node.above
    return axis_sign * reach_x, axis_sign * reach_y


@inner_step
def cut_at_edges(place: float, before: float, after: float, size: float) -> tuple[float, float]:
    """Clip a point's box at both edges; return its new place and its rest.

    `before` and `after` are the extents of the box on both sides of the point.
    """
    whole = before + after
    # A box without width is inside or not.
    if whole < SHARP:
        return place, 1.0 if 0.0 <= place <= size else 0.0
    # Clip the box; the point divides the rest in the same ratio.
    low, high = max(place - before, 0.0), min(place + after, size)
    if high <= low:
        return min(max(place, 0.0), size), 0.0
    return low + (high - low) * before / whole, (high - low) / whole


@inner_kernel
def slopes_of_cut(
    place: float, before: float, after: float, size: float
) -> tuple[float, float, float, float, float, float]:
    """Derivatives of a cut point's place and share by its place and its box's sides."""
    whole = before + after
    # Points without width, and boxes clipped away, do not change.
    if whole < SHARP:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    low, high = max(place - before, 0.0), min(place + after, size)
    if high <= low:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    # Only ends that are not clipped move.
    moves_low = 1.0 if place - before > 0.0 else 0.0
    moves_high = 1.0 if place + after < size else 0.0
    # Differentiate the point's place by its own place and by both sides.
    part, long = before / whole, high - low
    by_place = moves_low + (moves_high - moves_low) * part
    by_before = -moves_low * (1.0 - part) + long * after / (whole * whole)
    by_after = moves_high * part - long * before / (whole * whole)
    # Differentiate the share likewise.
    share_by_place = (moves_high - moves_low) / whole
    share_by_before = (moves_low - long / whole) / whole
    share_by_after = (moves_high - long / whole) / whole
    return by_place, by_before, by_after, share_by_place, share_by_before, share_by_after


@inner_step
def folded_in(lens: InterpolatedSource, place: float, axis: int) -> tuple[float, float]:
    """Fold a place into the source and its margin; return also its direction.

    That is −1 where the source is mirrored, and 0 where it is constant.
    """
    size = float(lens.size[1 - axis])
    if 0.0 <= place <= size:
        return place, 1.0
    # Let the engine fold by its own edge rules; clamped values far out are constant.
    if lens.edge != REFLECT_101:
        margin = lens.ring
        turn = 0.0 if lens.edge == CLAMP and not -margin <= place <= size + margin else 1.0
        place, side = folded(place, size, lens.edge, margin)
        return place, turn * side
    # Reflect about the centers of the outermost samples (REFLECT_101).
    if size < 2.0:
        return 0.5, 0.0
    place, side = folded(place - 0.5, size - 1.0, MIRROR, 0.0)
    return place + 0.5, side


@inner_step
def fill_weights(table: Doubles, t: float, weights: Doubles) -> None:
    """Evaluate polynomials, columns of a table that starts with the constants."""
    terms, taps = table.shape
    # Horner's rule, for all taps at once.
    for k in range(taps):
        weights[k] = table[terms - 1, k]
    for n in range(terms - 2, -1, -1):
        for k in range(taps):
            weights[k] = weights[k] * t + table[n, k]


@inner_step
def first_of(lens: InterpolatedSource, place: float) -> tuple[int, float]:
    """First coefficient in a place's support, and the argument of the polynomials."""
    from_start = place - lens.shift
    whole = math.floor(from_start)
    first = int(whole) - (lens.weight.shape[1] - 1) // 2 + lens.margin
    return first, from_start - whole - 0.5


@making_kernel
def scratch_for(taps: int, channels: int) -> PointScratch:
    """Allocate scratch for windows of so many samples along a side."""
    line, sloped = np.empty(taps * channels), np.empty(taps * channels)
    return PointScratch(
        np.empty(taps), np.empty(taps), np.empty(taps), np.empty(taps), line, sloped
    )
