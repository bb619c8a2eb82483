"""Points that stand for a pixel, and what an interpolation weighs the samples around each by.

A pixel covers a parallelogram of the source. Its mean is a sum over Gauss points of it; where an
edge of a transparent source runs through, the upright box around each point's share of the pixel
is cut at the edge, and the point moves with it: sums and coverage change without jumps.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import inner_kernel, inner_step, making_kernel
from resample.engine.windows.edges import CLAMP, MIRROR, TRANSPARENT, folded
from resample.types import Doubles

Integers = NDArray[np.int64]
Pair = tuple[float, float]

REFLECT_101 = 4  # an edge beside those of the engine: d c b | a b c d
FARTHEST = 2.0**40  # samples from the source's origin beyond which there is nothing
FEW = 0.57  # samples along a side of a pixel up to which two points stand for it
PANEL = 2.09  # samples that four points, of which none is in the middle, stand for at most
MOST_PANELS = 32.0  # along a side; what covers more is looked at in places
AT_EDGES = 8  # points along a side of a pixel where an edge of the source runs through it, at least
SHARP = 1e-9  # samples, of a box that is taken for a point
NEARLY = 1e-9  # samples beyond an edge that count as nothing


class Lens(NamedTuple):
    """A source and how it is interpolated."""

    weight: Doubles  # (D, K) of each sample's weight, a polynomial of the place; see `first_of`
    slope: Doubles  # (D − 1, K) of its derivative
    rules: Doubles  # (6, 4) Gauss points: two, then four; see `profiles.rules`
    shift: float  # of the polynomials' pieces, samples
    size: tuple[int, int]  # (height, width) of the source
    margin: int  # coefficients around the source's own, on all sides
    ring: float  # samples beyond a clamped edge from which on nothing changes
    edge: int
    quality: float  # panels are this many times as short


class Node(NamedTuple):
    """A point of a pixel, −0.5 to 0.5, and its share of the pixel."""

    x: float
    y: float
    weight: float
    left: float  # how far its share reaches to each side of it, px
    right: float
    above: float
    below: float


class Room(NamedTuple):
    """Room for the work on one point: weights (K,) along axes, and lines (K × C,) of a window."""

    along_u: Doubles
    along_v: Doubles
    slope_u: Doubles
    slope_v: Doubles
    line: Doubles
    sloped: Doubles


@inner_step
def points_along(long: float, quality: float) -> int:
    """Gauss points along a side of a pixel that is so many samples long."""
    if long * quality <= FEW:
        return 2
    return 4 * math.ceil(min(long * quality / PANEL, MOST_PANELS))


@inner_step
def counts_of(lens: Lens, seen: Doubles, cut: bool) -> tuple[int, int]:
    """Points of a pixel along x and y."""
    along_x = points_along(math.hypot(seen[2], seen[3]), lens.quality)
    along_y = points_along(math.hypot(seen[4], seen[5]), lens.quality)
    return (max(along_x, AT_EDGES), max(along_y, AT_EDGES)) if cut else (along_x, along_y)


@inner_step
def _along(rules: Doubles, count: int, n: int) -> tuple[float, float, float, float]:
    """The n-th point along a side: its place, its weight, and how far it reaches to both sides."""
    if count == 2:
        return rules[n, 0] - 0.5, rules[n, 1], rules[n, 2], rules[n, 3]
    panels, k = 4.0 / count, 2 + n % 4
    place = (n // 4 + rules[k, 0]) * panels - 0.5
    return place, rules[k, 1] * panels, rules[k, 2] * panels, rules[k, 3] * panels


@inner_step
def node_of(rules: Doubles, counts: tuple[int, int], n: int) -> Node:
    """The n-th point of a pixel."""
    x, weight_x, left, right = _along(rules, counts[0], n % counts[0])
    y, weight_y, above, below = _along(rules, counts[1], n // counts[0])
    return Node(x, y, weight_x * weight_y, left, right, above, below)


@inner_step
def place_in(seen: Doubles, node: Node) -> tuple[float, float]:
    """Where a point of a pixel lies in the source."""
    u = seen[0] + node.x * seen[2] + node.y * seen[4]
    return u, seen[1] + node.x * seen[3] + node.y * seen[5]


@inner_step
def is_cut(lens: Lens, seen: Doubles) -> bool:
    """Whether an edge of the source, beyond which there is nothing, runs through a pixel."""
    if lens.edge != TRANSPARENT:
        return False
    reach_u = 0.5 * (abs(seen[2]) + abs(seen[4])) - NEARLY
    reach_v = 0.5 * (abs(seen[3]) + abs(seen[5])) - NEARLY
    across = seen[0] >= reach_u and seen[0] + reach_u <= lens.size[1]
    return not (across and seen[1] >= reach_v and seen[1] + reach_v <= lens.size[0])


@inner_step
def is_seen(lens: Lens, seen: Doubles) -> bool:
    """Whether a pixel may see anything."""
    if not (abs(seen[0]) <= FARTHEST and abs(seen[1]) <= FARTHEST):
        return False
    reach_u, reach_v = abs(seen[2]) + abs(seen[4]), abs(seen[3]) + abs(seen[5])
    if not (reach_u <= FARTHEST and reach_v <= FARTHEST):
        return False
    if lens.edge != TRANSPARENT:
        return True
    across = seen[0] + reach_u > 0.0 and seen[0] - reach_u < lens.size[1]
    return bool(across and seen[1] + reach_v > 0.0 and seen[1] - reach_v < lens.size[0])


@inner_step
def sides(along_x: float, along_y: float, node: Node, axis_sign: float) -> tuple[float, float]:
    """How a point's reach to one side (−1, 1) changes with a pixel's steps along x and y."""
    reach_x = node.right if along_x * axis_sign >= 0.0 else -node.left
    reach_y = node.below if along_y * axis_sign >= 0.0 else -node.above
    return axis_sign * reach_x, axis_sign * reach_y


@inner_step
def cut_at_edges(place: float, before: float, after: float, size: float) -> tuple[float, float]:
    """Where a point lies whose box is cut at both edges, and the share that is left of the box.

    `before` and `after` are what the box has on both sides of the point.
    """
    whole = before + after
    if whole < SHARP:
        return place, 1.0 if 0.0 <= place <= size else 0.0
    low, high = max(place - before, 0.0), min(place + after, size)
    if high <= low:
        return min(max(place, 0.0), size), 0.0
    return low + (high - low) * before / whole, (high - low) / whole


@inner_kernel
def slopes_of_cut(
    place: float, before: float, after: float, size: float
) -> tuple[float, float, float, float, float, float]:
    """How a cut point's place, and its share, change with its place and its box's two sides."""
    whole = before + after
    if whole < SHARP:
        return 1.0, 0.0, 0.0, 0.0, 0.0, 0.0
    low, high = max(place - before, 0.0), min(place + after, size)
    if high <= low:
        return 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    moves_low = 1.0 if place - before > 0.0 else 0.0
    moves_high = 1.0 if place + after < size else 0.0
    part, long = before / whole, high - low
    by_place = moves_low + (moves_high - moves_low) * part
    by_before = -moves_low * (1.0 - part) + long * after / (whole * whole)
    by_after = moves_high * part - long * before / (whole * whole)
    share_by_place = (moves_high - moves_low) / whole
    share_by_before = (moves_low - long / whole) / whole
    share_by_after = (moves_high - long / whole) / whole
    return by_place, by_before, by_after, share_by_place, share_by_before, share_by_after


@inner_step
def folded_in(lens: Lens, place: float, axis: int) -> tuple[float, float]:
    """A place within the source and its margin where the same stands; which way it turns there.

    That is −1 where it is mirrored, and 0 where nothing changes any more.
    """
    size = float(lens.size[1 - axis])
    if 0.0 <= place <= size:
        return place, 1.0
    if lens.edge != REFLECT_101:
        margin = lens.ring
        turn = 0.0 if lens.edge == CLAMP and not -margin <= place <= size + margin else 1.0
        place, side = folded(place, size, lens.edge, margin)
        return place, turn * side
    if size < 2.0:
        return 0.5, 0.0
    place, side = folded(place - 0.5, size - 1.0, MIRROR, 0.0)
    return place + 0.5, side


@inner_step
def fill_weights(table: Doubles, t: float, weights: Doubles) -> None:
    """Values of polynomials, the columns of a table with the constants in its first row."""
    terms, taps = table.shape
    for k in range(taps):
        weights[k] = table[terms - 1, k]
    for n in range(terms - 2, -1, -1):
        for k in range(taps):
            weights[k] = weights[k] * t + table[n, k]


@inner_step
def first_of(lens: Lens, place: float) -> tuple[int, float]:
    """First of the coefficients that a place is the sum of, and the polynomials' argument."""
    from_start = place - lens.shift
    whole = math.floor(from_start)
    first = int(whole) - (lens.weight.shape[1] - 1) // 2 + lens.margin
    return first, from_start - whole - 0.5


@making_kernel
def room_for(taps: int, channels: int) -> Room:
    """Room for windows of so many samples along a side."""
    line, sloped = np.empty(taps * channels), np.empty(taps * channels)
    return Room(np.empty(taps), np.empty(taps), np.empty(taps), np.empty(taps), line, sloped)
