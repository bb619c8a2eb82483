"""Harden the edges of depth maps and move them to color edges, by votes.

Samples near edges are assigned to surfaces by votes of samples around them, weighted by color
(`voting`). Samples between two surfaces, and unknown ones, do not vote.
"""

import math
from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.refining.enlargement import SmallMap
from resample_warp3d.depth.refining.inspecting import Findings, depth_of, edges_of
from resample_warp3d.depth.refining.resizing import enlarged

if TYPE_CHECKING:
    from resample_warp3d.depth.refining.kernels.voting import VotingWindow

Kinds = NDArray[np.uint8]
Mask = NDArray[np.bool_]

REACH = 8  # px, largest distance of voters; more in maps of large blocks
FIRST = 2  # px up to which all samples vote at first; beyond, those on axes and some others
DENSE = 4  # px up to which all samples vote; beyond, one in a sixth of the reach
FAR, NEAR = 0.5, 0.125  # of the reach, standard deviations of the weights for a surface, and for
LEAST_NEAR = 2.0  # px: its nearness
ACROSS = 2.0  # per NEAR²: falloff of votes away from the axes, for the nearness
INSIDE = 2  # px beside a block's center that keep their surface unless color is another
COLOR_DIFFERENCE = 0.22  # of the colors' standard deviation: such a difference weighs 1 / √e
UNSURE = 0.05  # weight of samples beside edges
HARMLESS = 0.5  # px, standard deviation of a blur that does not affect thin objects
BLURRED = 1.1  # times the deviation found, as the ends of soft edges are missed
LEAST = 0.4  # least share of a sample that a thin object covers
THIN_WEIGHT = 0.1  # weight of samples of thin objects once their value is restored
SAMPLED = 1 << 16  # px sampled for the deviation of colors
NOISY = 12.0  # times the noise: larger jumps are edges


class Recipe(NamedTuple):
    """Parameters of finding edges and extrapolating surfaces."""

    run: int  # as in `ramps.Edges`
    share: float
    least: float
    around: int  # samples beside an edge that may belong to another surface
    length: int  # as in `ramps.Bends`
    steepest: float
    bent: float


RECIPES = {
    "snap": Recipe(1, 0.3, 0.06, 2, 8, 0.03, 0.0),
    "sharpen": Recipe(6, 0.12, 0.04, 0, 4, 0.1, 0.03),
}


class RefinementTask(NamedTuple):
    """Inputs of a refinement."""

    color: Floats  # (H, W, C) in units of the difference between similar colors
    findings: Findings
    noise: float
    step: float
    recipe: Recipe


class Ballot(NamedTuple):
    """Voters: nearness, weight, slope and kind of samples."""

    nearness: Floats  # (H, W)
    trust: Floats  # (H, W)
    slope: Floats  # (H, W, 4)
    kind: Kinds  # (H, W) as `ramps.classify` writes them, and `BESIDE` in the band around edges


def unblocked(task: RefinementTask, small: SmallMap, nearness: Floats) -> tuple[Floats, Floats]:
    """Interpolate a map of blocks, and move its edges to those of color; also return the votes."""
    shape = nearness.shape[0], nearness.shape[1]
    start = enlarged(small.values, shape, (small.rows, small.columns))
    return grown(task, start, int(small.side / 2.0), None)


def grown(
    task: RefinementTask, nearness: Floats, off: int, mixed: Mask | None
) -> tuple[Floats, Floats]:
    """Move edges that are off by up to `off` px to color edges; also return the votes.

    Votes come from four times as far, and then, if that is beyond the usual, from twice as far.
    `mixed`: as `hardened` takes it; surfaces beside them may be round.
    """
    snap = RECIPES["snap"]._replace(bent=0.0 if mixed is None else RECIPES["sharpen"].bent)
    first = snap._replace(around=max(snap.around, off - INSIDE))
    found, agreed = hardened(task._replace(recipe=first), nearness, max(REACH, 4 * off), mixed)
    if 4 * off <= REACH:
        return found, agreed
    found, again = hardened(task._replace(recipe=snap), found, max(REACH, 2 * off))
    return found, np.minimum(agreed, again)


def hardened(
    task: RefinementTask,
    nearness: Floats,
    reach: int = REACH,
    mixed: Mask | None = None,
    where: Mask | None = None,
) -> tuple[Floats, Floats]:
    """Move edges of nearness to color edges; also return the share of votes.

    `reach`: px from which votes come. `mixed`: further samples between surfaces. `where`: samples
    that may change, with those within `reach` of them; by default all.
    """
    import cv2

    ballot = ballot_of(task, nearness, mixed, reach)
    band = np.where(nearness > 0, ballot.kind, np.uint8(0))
    if where is not None:
        band[cv2.dilate(where.astype(np.uint8), _square(reach)) == 0] = 0
    is_blurred = task.recipe.run > 1 and task.findings.sigma > HARMLESS
    refined, agreed = counted(task, ballot, band, nearness, reach, is_rough=is_blurred)
    if is_blurred:
        refined, agreed = counted(task, _with_thin_things(task, ballot, refined), band, nearness)
    return refined, agreed


def _square(reach: int) -> Kinds:
    """Return the neighbourhood within a distance along both axes, for OpenCV's filters."""
    return np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)


def ballot_of(
    task: RefinementTask, nearness: Floats, mixed: Mask | None = None, reach: int = REACH
) -> Ballot:
    """Make the voters of a map; samples between surfaces, and mixed ones, have no weight.

    Slopes are measured within `reach` px of edges, and of unknown samples, where they count.
    """
    import cv2

    from resample_warp3d.depth.refining.kernels.ramps import (
        BESIDE,
        BETWEEN,
        Bends,
        Edges,
        classify,
        measure_slopes,
    )

    recipe = task.recipe
    edges = Edges(recipe.run, recipe.share, max(recipe.least, NOISY * task.noise), 2.0 * task.step)
    found = np.empty(nearness.shape, np.uint8)
    classify(nearness, edges_of(nearness, edges), found)
    if mixed is not None:
        found[mixed] = BETWEEN
    band = cv2.dilate((found > 0).astype(np.uint8), _square(recipe.around))
    kind = np.maximum(found, band * np.uint8(BESIDE))
    trust = np.where(kind > 0, np.float32(UNSURE), np.float32(1))
    trust[found == BETWEEN] = 0
    slope = np.empty((*nearness.shape, 4), np.float32)
    near = cv2.dilate(band, _square(reach + recipe.length))
    skipped = np.where(near > 0, kind, np.uint8(BETWEEN))
    measure_slopes(nearness, skipped, Bends(recipe.length, recipe.steepest, recipe.bent), slope)
    return Ballot(nearness, trust, slope, kind)


def counted(
    task: RefinementTask, ballot: Ballot, band: Kinds, nearness: Floats, reach: int = REACH,
    *, is_rough: bool = False,
) -> tuple[Floats, Floats]:  # fmt: skip
    """Count the votes for a band of samples; return nearness and share of votes.

    Slopes are taken from a few samples: none makes a known sample nearer than all as far around. A
    sample for which none votes stays. `is_rough`: for one in four samples; the others follow the
    ones with the most similar colors.
    """
    import cv2

    from resample_warp3d.depth.refining.kernels.voting import Voters, vote_rows

    refined, agreed = nearness.copy(), (nearness > 0).astype(np.float32)
    voters = Voters(task.color, ballot.nearness, ballot.trust, ballot.slope)
    for apart in (4, 2, 1):
        vote_rows(voters, window(reach), band, apart, is_rough and apart == 1, refined, agreed)
    nearest = cv2.dilate(ballot.nearness, _square(task.recipe.length))
    np.minimum(refined, nearest, out=refined, where=nearness > 0)
    return np.where(refined > 0, refined, nearness), agreed


def _with_thin_things(task: RefinementTask, ballot: Ballot, refined: Floats) -> Ballot:
    """Restore the nearness of thin objects reduced by blur, for the votes."""
    from resample_warp3d.depth.refining.kernels.softness import Blur, restore

    blurred = depth_of if task.findings.is_depth else np.array
    given, hard = blurred(ballot.nearness), blurred(refined)
    # Unchanged samples must also be unchanged in these units.
    hard = np.where(refined == ballot.nearness, given, hard).astype(np.float32)
    whole = np.empty_like(given)
    restore(given, hard, ballot.kind, Blur(BLURRED * task.findings.sigma, LEAST), whole)
    is_told = whole > 0
    nearness = np.where(is_told, blurred(whole), ballot.nearness).astype(np.float32)
    trust = np.where(is_told, np.float32(THIN_WEIGHT), ballot.trust)
    trust[(ballot.kind > 0) & ~is_told] = 0
    return ballot._replace(nearness=nearness, trust=trust)


@cache
def window(reach: int = REACH) -> "VotingWindow":
    """Return the window of voters: all near samples, fewer farther out, more of them on axes."""
    from resample_warp3d.depth.refining.kernels.voting import VotingWindow

    down, across = np.mgrid[-reach : reach + 1, -reach : reach + 1].reshape(2, -1)
    far, near = np.maximum(abs(down), abs(across)), np.minimum(abs(down), abs(across))
    sparse = max(2, reach // 6)
    is_on_axis = (near == 0) & (far % (sparse // 2) == 0)
    is_asked = (far <= DENSE) | is_on_axis | ((down % sparse == 0) & (across % sparse == 0))
    offset = np.stack([down[is_asked], across[is_asked]], axis=1).astype(np.int64)
    apart = np.abs(offset).max(axis=1)
    is_first = (apart <= FIRST) | (offset % max(2, reach // 2) == 0).all(axis=1)
    is_first |= (offset == 0).any(axis=1)
    offset = offset[np.argsort(~is_first, kind="stable")]
    squared = (offset**2).sum(axis=1)
    share = np.exp(-0.5 * squared / (FAR * reach) ** 2)
    beside = np.abs(offset).min(axis=1) ** 2
    deviation = max(LEAST_NEAR, NEAR * reach)
    close = np.exp((-0.5 * squared - ACROSS * beside) / deviation**2)
    return VotingWindow(offset, share, close, int(np.count_nonzero(is_first)))


def scaled(color: Floats) -> Floats:
    """Scale colors to units of the difference between similar colors."""
    sparse = max(1, math.isqrt(color.shape[0] * color.shape[1] // SAMPLED))
    some = color[::sparse, ::sparse].reshape(-1, color.shape[2])
    deviation = float(np.sqrt(some.var(axis=0, dtype=np.float64).sum() / 3.0))
    return np.asarray(color / np.float32(max(COLOR_DIFFERENCE * deviation, 1e-6)), np.float32)
