"""Samples near edges ask those around them how far they are: a weighted median, by color.

Every sample around votes for the nearness that its surface has at the asking one, with the more
weight the nearer it lies and the more alike its color is. The weighted median of the votes says
which surface wins; the nearness is the median of those that vote for that surface, the closest of
them above all, and so one that some surface has, not a mean of two.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats

Marks = NDArray[np.uint8]

UNLIKE = 1e-4  # weight that a vote has at least, of a color however different
NOT_SURE = 1e-4  # of a sample near an edge, where its surface's nearness is asked for
FAMILIAR = 0.05  # share of those around that have to be alike for their votes to count in full
SAME = 0.25  # of the range of all votes: votes less apart are for one surface
CLOSE = 0.01  # of the nearness, on top
LOWEST = 0.3  # of a voter's nearness: what its slopes may lead down to


class Voters(NamedTuple):
    """What votes are made of."""

    color: Floats  # (H, W, C), of a deviation for which likeness is 1 / √e
    nearness: Floats  # (H, W)
    trust: Floats  # (H, W) 1 away from edges, less beside them, 0 unknown or between surfaces
    slope: Floats  # (H, W, 4) change to the next column and row, and change of these


class Window(NamedTuple):
    """Who is asked, relative to who asks."""

    offset: NDArray[np.int64]  # (K, 2) rows and columns
    share: Doubles  # (K,) weight in the choice of a surface
    close: Doubles  # (K,) weight in its nearness


class Votes(NamedTuple):
    """Votes for one sample."""

    value: Doubles  # (K,) nearness
    share: Doubles  # (K,)
    asked: Doubles  # (K,) what `share` would be for one color
    close: Doubles  # (K,)
    sorted_value: Doubles  # (K,) room to sort in
    sorted_weight: Doubles  # (K,)


@kernel
def _weighted_median(value: Doubles, weight: Doubles, count: int) -> float:
    """The smallest value at which half of the weight is reached; reorders both arrays."""
    half = 0.5 * weight[:count].sum()
    first, last, below = 0, count - 1, 0.0
    while first < last:
        pivot = value[(first + last) // 2]
        low, n, high, less, same = first, first, last, 0.0, 0.0
        while n <= high:
            v, w = value[n], weight[n]
            if v < pivot:
                value[n], weight[n] = value[low], weight[low]
                value[low], weight[low] = v, w
                low, n, less = low + 1, n + 1, less + w
            elif v > pivot:
                value[n], weight[n] = value[high], weight[high]
                value[high], weight[high] = v, w
                high -= 1
            else:
                n, same = n + 1, same + w
        if below + less >= half:
            last = low - 1
        elif below + less + same >= half:
            return float(pivot)
        else:
            first, below = high + 1, below + less + same
        if last < first:
            return float(pivot)
    return float(value[first])


@kernel
def weighted_median(value: Doubles, weight: Doubles) -> float:
    """The smallest value at which half of the weight is reached, leaving the arrays alone."""
    return _weighted_median(value.copy(), weight.copy(), value.size)


@kernel
def _likeness(color: Floats, row: int, column: int, r: int, c: int) -> float:
    """How alike two samples' colors are, 0..1."""
    apart = 0.0
    for n in range(color.shape[2]):
        difference = color[row, column, n] - color[r, c, n]
        apart += difference * difference
    return math.exp(-0.5 * apart) + UNLIKE if apart < 40.0 else UNLIKE


@kernel
def _change(slope: float, bend: float, away: int) -> float:
    """Change of a surface's nearness at a distance from a sample along an axis, by its slope there.

    One that falls ever more steeply turns away: there nearness is a + b √(T − t), whose slope and
    bend at t = 0 tell T, slope / (2 bend). All others go on as parabolas.
    """
    falls = slope if away > 0 else -slope
    distance = float(abs(away))
    if not (falls < 0.0 and bend < 0.0):
        return falls * distance + 0.5 * bend * distance * distance
    turn = max(falls / (2.0 * bend), 1.0)
    return 2.0 * falls * turn * (1.0 - math.sqrt(1.0 - min(distance, turn) / turn))


@kernel
def _collect(voters: Voters, window: Window, row: int, column: int, votes: Votes) -> int:
    """Write the votes for a sample; gives how many."""
    height, width = voters.nearness.shape
    count = 0
    for k in range(window.share.size):
        down, across = window.offset[k, 0], window.offset[k, 1]
        r, c = row + down, column + across
        if not (0 <= r < height and 0 <= c < width):
            continue
        trust = voters.trust[r, c]
        if not trust > 0:
            continue
        weight = _likeness(voters.color, row, column, r, c)
        there, slope = np.float64(voters.nearness[r, c]), voters.slope[r, c]
        value = there + _change(slope[0], slope[2], -across) + _change(slope[1], slope[3], -down)
        votes.value[count] = max(value, LOWEST * there)
        votes.share[count] = trust * weight * window.share[k]
        votes.asked[count] = trust * window.share[k]
        votes.close[count] = (1.0 if trust == 1.0 else NOT_SURE) * weight * window.close[k]
        count += 1
    return count


@kernel
def _median_of(votes: Votes, weight: Doubles, count: int, middle: float, reach: float) -> float:
    """Weighted median of those votes that are within `reach` of `middle`."""
    chosen = 0
    for n in range(count):
        if abs(votes.value[n] - middle) <= reach:
            votes.sorted_value[chosen], votes.sorted_weight[chosen] = votes.value[n], weight[n]
            chosen += 1
    return _weighted_median(votes.sorted_value, votes.sorted_weight, chosen)


@kernel
def _vote(
    voters: Voters, window: Window, row: int, column: int, votes: Votes
) -> tuple[float, float]:
    """Nearness that a sample gets, and the share of the votes for its surface; 0: nobody voted.

    The share counts less where no color around is like the sample's.
    """
    count = _collect(voters, window, row, column, votes)
    if count == 0:
        return 0.0, 0.0
    middle = _median_of(votes, votes.share, count, 0.0, np.inf)
    low, high = votes.value[:count].min(), votes.value[:count].max()
    reach = SAME * (high - low) + CLOSE * middle
    agreed, total, asked = 0.0, 0.0, 0.0
    for n in range(count):
        total += votes.share[n]
        asked += votes.asked[n]
        if abs(votes.value[n] - middle) <= reach:
            agreed += votes.share[n]
    agreed *= min(1.0, total / (FAMILIAR * asked)) / total
    here = np.float64(voters.nearness[row, column])
    if voters.trust[row, column] > 0 and abs(here - middle) <= reach:
        return here, agreed
    return _median_of(votes, votes.close, count, middle, reach), agreed


@kernel
def _vote_in_row(
    voters: Voters, window: Window, band: Marks, row: int, refined: Floats, agreed: Floats
) -> None:
    count = window.share.size
    votes = Votes(
        np.empty(count), np.empty(count), np.empty(count),
        np.empty(count), np.empty(count), np.empty(count),
    )  # fmt: skip
    for column in range(band.shape[1]):
        if band[row, column]:
            near, share = _vote(voters, window, row, column, votes)
            refined[row, column], agreed[row, column] = np.float32(near), np.float32(share)


@parallel_kernel
def vote_rows(
    counter: Counter, voters: Voters, window: Window, band: Marks, refined: Floats, agreed: Floats
) -> None:
    """Let the samples of a band ask those around them.

    Parameters
    ----------
    voters, window
        Who votes for what.
    band
        (H, W) not 0 where samples ask.
    refined
        (H, W) nearness, which they get; 0 where nobody votes.
    agreed
        (H, W) share of the votes for the surface that has won, which they get.
    """
    for row in tasks(counter, band.shape[0]):
        _vote_in_row(voters, window, band, row, refined, agreed)
