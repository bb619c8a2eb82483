"""Refine samples near edges by votes: a weighted median of samples around.

Every sample around votes for the nearness of its own surface, extended to the sample in question,
with a weight that grows with proximity and similarity of color. The weighted median of the votes
decides which surface wins; the nearness is the median of the votes for that surface, weighted
mostly by proximity, and so one that some surface has, not a mean of two.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.engine.jit import Counter, kernel, parallel_kernel, tasks
from resample.types import Doubles, Floats
from resample_warp3d.types import DOWN, LEFT, RIGHT, UP, Links

Marks = NDArray[np.uint8]

UNLIKE = 1e-4  # least weight of a vote, however different its color
NOT_SURE = 1e-4  # weight of a sample near an edge in its surface's nearness
FAMILIAR = 0.05  # share of similar colors around from which on votes count in full
SAME = 0.25  # of the range of all votes: votes closer together are for one surface
CLOSE = 0.01  # of the nearness, on top
BINS = 16  # of values; one of them holds the median
SURE = 0.995  # share of the few first votes from which others are not asked
FARTHEST = 4  # px between samples that are asked first
TOLD = 0.9  # share of the votes of samples asked first from which those amid them are not asked
LEVEL = 0.02  # of the nearness, by which these samples may differ
KINDRED = 0.13  # least similarity of their colors: a difference of 2
LOWEST = 0.3  # of a voter's nearness: least value that its slopes may lead to


class Voters(NamedTuple):
    """Data of the voting samples."""

    color: Floats  # (H, W, C), scaled so that a difference of 1 has the similarity 1 / √e
    nearness: Floats  # (H, W)
    trust: Floats  # (H, W) 1 away from edges, less beside them, 0 unknown or between surfaces
    slope: Floats  # (H, W, 4) change to the next column and row, and change of these


class VotingWindow(NamedTuple):
    """Samples that vote, relative to the one in question."""

    offset: NDArray[np.int64]  # (K, 2) rows and columns
    share: Doubles  # (K,) weight in the choice of a surface
    close: Doubles  # (K,) weight in its nearness
    few: int  # of the samples, which are asked first


class Votes(NamedTuple):
    """Votes for one sample."""

    value: Doubles  # (K,) nearness
    share: Doubles  # (K,)
    asked: Doubles  # (K,) `share` if all had one color
    close: Doubles  # (K,)
    sorted_value: Doubles  # (K,) scratch for sorting
    sorted_weight: Doubles  # (K,)


@kernel
def weighted_median(value: Doubles, weight: Doubles, count: int) -> float:
    """Smallest value at which half of the weight is reached; reorders both arrays."""
    bins = np.empty(BINS)
    half = 0.5 * weight[:count].sum()
    while True:
        # Add the weights up in bins of equal width.
        low, high = value[0], value[0]
        for n in range(1, count):
            low, high = min(low, value[n]), max(high, value[n])
        scale = (BINS - 0.5) / (high - low) if high > low else 0.0
        if count == 1 or not 0.0 < scale < np.inf:
            return float(low)
        bins[:] = 0.0
        for n in range(count):
            bins[int((value[n] - low) * scale)] += weight[n]
        # Find the bin where half is reached, and continue in it.
        found = 0
        while found < BINS - 1 and half > bins[found]:
            half -= bins[found]
            found += 1
        kept = 0
        for n in range(count):
            if int((value[n] - low) * scale) == found:
                value[kept], weight[kept] = value[n], weight[n]
                kept += 1
        if kept == 0:
            return float(high)
        count = kept


@kernel
def _color_similarity(color: Floats, row: int, column: int, r: int, c: int) -> float:
    """Similarity of two samples' colors, 0..1: a Gaussian of their distance."""
    apart = 0.0
    for n in range(color.shape[2]):
        difference = color[row, column, n] - color[r, c, n]
        apart += difference * difference
    return math.exp(-0.5 * apart) + UNLIKE if apart < 40.0 else UNLIKE


@kernel
def _change(slope: float, bend: float, away: int) -> float:
    """Change of a surface's nearness at a distance along an axis.

    A surface that falls ever more steeply curves away: there nearness is a + b √(T − t), with
    slope and bend at t = 0 yield T, slope / (2 bend). All others continue as parabolas.
    """
    falls = slope if away > 0 else -slope
    distance = float(abs(away))
    if not (falls < 0.0 and bend < 0.0):
        return falls * distance + 0.5 * bend * distance * distance
    # Follow the square root up to its end.
    turn = max(falls / (2.0 * bend), 1.0)
    return 2.0 * falls * (turn - math.sqrt(turn * (turn - min(distance, turn))))


@kernel
def _collect(
    voters: Voters, window: VotingWindow, asked: tuple[int, int], row: int, column: int,
    votes: Votes, count: int,
) -> int:  # fmt: skip
    """Write the votes for a sample, of a range of the window, after others; return how many."""
    height, width = voters.nearness.shape
    for k in range(asked[0], asked[1]):
        down, across = window.offset[k, 0], window.offset[k, 1]
        # Skip samples outside the frame and untrusted ones.
        r, c = row + down, column + across
        if not (0 <= r < height and 0 <= c < width):
            continue
        trust = voters.trust[r, c]
        if not trust > 0:
            continue
        # Extend the voter's surface to the sample.
        weight = _color_similarity(voters.color, row, column, r, c)
        there, slope = np.float64(voters.nearness[r, c]), voters.slope[r, c]
        value = there + _change(slope[0], slope[2], -across) + _change(slope[1], slope[3], -down)
        # Store the vote and its weights.
        votes.value[count] = max(value, LOWEST * there)
        votes.share[count] = trust * weight * window.share[k]
        votes.asked[count] = trust * window.share[k]
        votes.close[count] = (1.0 if trust == 1.0 else NOT_SURE) * weight * window.close[k]
        count += 1
    return count


@kernel
def _median_of(votes: Votes, weight: Doubles, count: int, middle: float, reach: float) -> float:
    """Weighted median of the votes within `reach` of `middle`."""
    chosen = 0
    for n in range(count):
        if abs(votes.value[n] - middle) <= reach:
            votes.sorted_value[chosen], votes.sorted_weight[chosen] = votes.value[n], weight[n]
            chosen += 1
    return weighted_median(votes.sorted_value, votes.sorted_weight, chosen)


@kernel
def _vote(
    voters: Voters, window: VotingWindow, row: int, column: int, votes: Votes
) -> tuple[float, float]:
    """Nearness of a sample by vote, and the share of votes for its surface.

    Both are 0 without votes. The share counts less where no color around is similar to the
    sample's. Where the first few all but agree, the others are not asked.
    """
    count = _collect(voters, window, (0, window.few), row, column, votes, 0)
    near, agreed = _counted(voters, row, column, votes, count)
    if agreed >= SURE or window.few == window.share.size:
        return near, agreed
    asked = window.few, window.share.size
    count = _collect(voters, window, asked, row, column, votes, count)
    return _counted(voters, row, column, votes, count)


@kernel
def _counted(
    voters: Voters, row: int, column: int, votes: Votes, count: int
) -> tuple[float, float]:
    """Nearness of the surface with most votes, and their share."""
    if count == 0:
        return 0.0, 0.0
    # Find the winning surface: the median of all votes, and the votes near it.
    middle = _median_of(votes, votes.share, count, 0.0, np.inf)
    low, high = votes.value[:count].min(), votes.value[:count].max()
    reach = SAME * (high - low) + CLOSE * middle
    # Sum the votes that agree.
    agreed, total, asked = 0.0, 0.0, 0.0
    for n in range(count):
        total += votes.share[n]
        asked += votes.asked[n]
        if abs(votes.value[n] - middle) <= reach:
            agreed += votes.share[n]
    agreed *= min(1.0, total / (FAMILIAR * asked)) / total
    # Keep a sample that lies on the winning surface; otherwise take that surface's nearness.
    here = np.float64(voters.nearness[row, column])
    if voters.trust[row, column] > 0 and abs(here - middle) <= reach:
        return here, agreed
    return _median_of(votes, votes.close, count, middle, reach), agreed


@kernel
def _between(
    voters: Voters, row: int, column: int, apart: int, is_rough: bool, refined: Floats,
    agreed: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Mean of the samples around that voted first, if they determine the surface, else 0.

    They do if they all but agree, have colors like the sample's, and it is on no other surface. If
    a rough answer is enough, the one with the most similar color does.
    """
    height, width = refined.shape
    down, across = row % (2 * apart), column % (2 * apart)
    mean, low, high, share, count = 0.0, np.inf, 0.0, 1.0, 0
    alikest, likely, sure = 0.0, 0.0, 0.0
    for n in range(4):
        r, c = row + (down if n < 2 else -down), column + (across if n % 2 else -across)
        if not (0 <= r < height and 0 <= c < width):
            return 0.0, 0.0
        value = np.float64(refined[r, c])
        mean, low, high = mean + 0.25 * value, min(low, value), max(high, value)
        share = min(share, np.float64(agreed[r, c]))
        alike = _color_similarity(voters.color, row, column, r, c)
        if alike > alikest:
            alikest, likely, sure = alike, value, np.float64(agreed[r, c])
        count += share >= TOLD and low > 0.0 and high - low <= LEVEL * high and alike > KINDRED
    here = np.float64(voters.nearness[row, column])
    is_known, reach = voters.trust[row, column] > 0, CLOSE * mean
    if is_rough and count < 4:
        mean, share, reach = likely, sure, SAME * (high - low) + CLOSE * likely
    elif count < 4 or (is_known and abs(here - mean) > reach):
        return 0.0, 0.0
    return here if is_known and abs(here - mean) <= reach else mean, share


@parallel_kernel
def vote_rows(
    counter: Counter,
    voters: Voters,
    window: VotingWindow,
    band: Marks,
    apart: int,
    is_rough: bool,
    refined: Floats,
    agreed: Floats,
) -> None:
    """Refine the samples of a band by a vote of samples around them.

    `voters`, `window`: votes, and where they come from. `band`: (H, W) not 0 where samples are
    refined. `apart`: refine those in each so many rows and columns, without those that a call with
    twice as much has refined, which tell the nearness where they agree, or in any case if
    `is_rough`. `refined`: (H, W) nearness, filled in the band; 0 where nobody votes. `agreed`:
    (H, W) share of the votes for the winning surface, filled in the band.
    """
    count = window.share.size
    for row in tasks(counter, band.shape[0]):
        votes = Votes(
            np.empty(count), np.empty(count), np.empty(count),
            np.empty(count), np.empty(count), np.empty(count),
        )  # fmt: skip
        for column in range(0, band.shape[1], apart):
            if not band[row, column] or row % apart:
                continue
            near, share = 0.0, 0.0
            if apart < FARTHEST:
                if row % (2 * apart) == 0 and column % (2 * apart) == 0:
                    continue
                near, share = _between(voters, row, column, apart, is_rough, refined, agreed)
            if near <= 0.0:
                near, share = _vote(voters, window, row, column, votes)
            refined[row, column], agreed[row, column] = np.float32(near), np.float32(share)


@kernel
def _step(nearness: Floats, links: Links, row: int, column: int, away: float, down: bool) -> float:
    """Change of nearness at a distance from a sample along an axis, on its surface."""
    ahead, back = (DOWN, UP) if down else (RIGHT, LEFT)
    dr, dc = (1, 0) if down else (0, 1)
    if away < 0:
        ahead, back, dr, dc = back, ahead, -dr, -dc
    # Interpolate to the linked neighbour, or extrapolate from the one behind.
    here = np.float64(nearness[row, column])
    if links[row, column] & ahead:
        return float(abs(away) * (nearness[row + dr, column + dc] - here))
    if links[row, column] & back:
        return float(abs(away) * (here - nearness[row - dr, column - dc]))
    return 0.0


@parallel_kernel
def enlarge_rows(
    counter: Counter, nearness: Floats, links: Links, axes: Doubles, result: Floats
) -> None:
    """Interpolate between linked samples, and extrapolate those without a link.

    `nearness`, `links`: (h, w) of the small map. `axes`: (4,) the small map's rows per row of the
    result, the first row's place among them, and the same of columns. `result`: (H, W) filled; 0
    where nothing is known.
    """
    for row in tasks(counter, result.shape[0]):
        height, width = nearness.shape
        # Find the nearest sample of the small map.
        y = row * axes[0] + axes[1]
        r = min(max(math.floor(y + 0.5), 0), height - 1)
        for column in range(result.shape[1]):
            x = column * axes[2] + axes[3]
            c = min(max(math.floor(x + 0.5), 0), width - 1)
            here = np.float64(nearness[r, c])
            value = 0.0
            # Follow its surface along both axes; a limit keeps nearness positive.
            if here > 0.0:
                value = here + _step(nearness, links, r, c, x - c, False)
                value = max(value + _step(nearness, links, r, c, y - r, True), 0.3 * here)
            result[row, column] = np.float32(value)
