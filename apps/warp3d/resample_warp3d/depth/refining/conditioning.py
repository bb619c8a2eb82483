"""Fit depth maps to their pictures: move edges to color edges, fill gaps and blocks.

Samples near edges are assigned to surfaces by votes of samples around them, weighted by color
(`voting`). Samples between two surfaces, and unknown ones, do not vote.
"""

import math
from functools import cache
from typing import TYPE_CHECKING, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.refining.inspecting import (
    NOTHING,
    OVERSHOOT,
    WIDEST,
    Findings,
    depth_of,
    edges_of,
    inspect,
    known,
    linked,
    noise_of,
    quantum_of,
    softness_of,
)
from resample_warp3d.depth.refining.resizing import (
    enlarged,
    fitted,
    reduced,
    reduced_known,
    without_blocks,
)
from resample_warp3d.types import DepthImage

if TYPE_CHECKING:
    from resample_warp3d.depth.refining.kernels.voting import VotingWindow

Kinds = NDArray[np.uint8]
Mask = NDArray[np.bool_]

Refine = Literal["auto", "none", "snap", "sharpen", "shift", "complete", "densify"]
REFINES = get_args(Refine)
REACH = 8  # px, largest distance of voters; more in maps of large blocks
DENSE = 4  # px up to which all samples vote; beyond, one in a sixth of the reach
FAR, NEAR = 0.5, 0.125  # of the reach, standard deviations of the weights for a surface, and for
LEAST_NEAR = 2.0  # px: its nearness
ACROSS = 2.0  # per NEAR²: falloff of votes away from the axes, for the nearness
INSIDE = 2  # px beside a block's center that keep their surface unless color is another
COLOR_DIFFERENCE = 0.22  # of the colors' standard deviation: such a difference weighs 1 / √e
UNSURE = 0.05  # weight of samples beside edges
MOST_ROUNDS = 3  # of voting for unknown samples: 8 px each
MADE_UP = 0.5  # confidence of a unanimous vote for an unknown sample
AGREED = 0.95  # share of the votes for one surface that an unknown sample needs
HARMLESS = 0.5  # px, standard deviation of a blur that does not affect thin objects
BLURRED = 1.1  # times the deviation found, as the ends of soft edges are missed
LEAST_SIDE = 32  # px: pictures are not reduced to less
LEAST = 0.4  # least share of a sample that a thin object covers
THIN_WEIGHT = 0.1  # weight of samples of thin objects once their value is restored
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


class Refined(NamedTuple):
    """A refined depth image."""

    image: DepthImage
    confidence: Floats  # (H, W) 0..1; 1 where unchanged, 0 where unknown
    findings: Findings  # with `none`, only `unknown` is valid
    chosen: str  # one of `REFINES`, except auto
    step: float  # quantization step of nearness before refinement


def refine(
    image: DepthImage,
    name: Refine = "auto",
    *,
    noise: float | None = None,
    step: float | None = None,
    is_measured: bool = False,
) -> Refined:
    """Refine a depth image.

    Parameters
    ----------
    image
        Color and nearness; nearness may have another size if it shows the same frame.
    name
        `auto` looks for defects, and keeps a map whose edges are where colors change. `snap` moves
        hard edges to color edges, `sharpen` hardens soft edges, `shift` moves the whole map by the
        pixels that its edges are off; all also fill gaps up to 24 px from known samples, where
        colors continue. `complete` only fills gaps, `none` does nothing. `densify` interpolates
        scattered samples and scan lines along surfaces of similar color.
        `auto` fills only maps of sensors, recognized by noise, quantization or many gaps: in
        computed maps gaps may be intended.
    noise, step
        As `preparation.prepare` takes them.
    is_measured
        Unknown samples were lost, as in depth of another camera: `auto` fills them.

    Raises
    ------
    ValueError
        Color and nearness do not fit, or there is no depth at all.
    LookupError
        The name is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import DepthImage, refine
    >>> color, nearness = np.ones((32, 32, 3), np.float32), np.full((32, 32), 0.5, np.float32)
    >>> nearness[12:18, 12:18] = 0  # unknown
    >>> refined = refine(DepthImage(color, nearness, np.empty((0, 0, 2))), "complete")
    >>> refined.image.nearness[15, 15].item(), refined.confidence[15, 15].item()
    (0.5, 0.5)
    """
    if name not in REFINES:
        raise LookupError(f"unknown refine {name!r}; known: {', '.join(REFINES)}")
    is_enlarged = image.nearness.shape != image.color.shape[:2]
    image = fitted(image)
    nearness = known(image)
    quantum = quantum_of(nearness) if step is None else step
    confidence = (nearness > 0).astype(np.float32)
    if name == "none":
        findings = NOTHING._replace(unknown=float(np.mean(nearness <= 0)))
        return Refined(image, confidence, findings, name, quantum)
    if noise is None:
        noise = noise_of(nearness, linked(nearness, quantum, 0.0))
    color = np.nan_to_num(np.ascontiguousarray(image.color, np.float32), posinf=0.0, neginf=0.0)
    findings = inspect(color, nearness, noise, quantum)
    findings = findings._replace(is_measured=findings.is_measured or is_measured)
    chosen = findings.remedy if name == "auto" else name
    if name == "auto" and is_enlarged and chosen not in ("sharpen", "densify"):
        chosen = "snap"
    if chosen == "none":
        return Refined(image, confidence, findings, chosen, quantum)
    task = RefinementTask(
        _scaled(color), findings, noise, quantum, RECIPES.get(chosen, RECIPES["snap"])
    )
    if chosen == "densify":
        nearness, confidence = _densified(task, nearness)
        return Refined(image._replace(nearness=nearness), confidence, findings, chosen, quantum)
    nearness, confidence = _repaired(task, chosen, nearness)
    if name != "auto" or findings.is_measured:
        nearness, confidence = _filled(task, nearness, confidence)
    return Refined(image._replace(nearness=nearness), confidence, findings, chosen, quantum)


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


def _repaired(task: RefinementTask, chosen: str, nearness: Floats) -> tuple[Floats, Floats]:
    """Apply a refinement but for filling; also return the share of votes, 1 where unchanged."""
    findings = task.findings
    if chosen == "sharpen":
        return _sharpened(task, nearness)
    if chosen == "snap":
        return _unblocked(task, nearness) if findings.block > 1 else _hardened(task, nearness)
    if chosen == "shift":
        nearness = _moved(nearness, findings.shift)
    return nearness, (nearness > 0).astype(np.float32)


def _unblocked(task: RefinementTask, nearness: Floats) -> tuple[Floats, Floats]:
    """Interpolate a map of blocks; edges, up to half a block off, move to those of color.

    Large blocks take two rounds: votes come from four times as far as edges are off, then from
    twice as far.
    """
    block = task.findings.block
    around = max(task.recipe.around, block // 2 - INSIDE)
    first = task._replace(recipe=task.recipe._replace(around=around))
    found, agreed = _hardened(first, without_blocks(nearness, block), max(REACH, 2 * block))
    if 2 * block <= REACH:
        return found, agreed
    found, again = _hardened(task, found, max(REACH, block))
    return found, np.minimum(agreed, again)


def _hardened(task: RefinementTask, nearness: Floats, reach: int = REACH) -> tuple[Floats, Floats]:
    """Move edges of nearness to those of color; also return the share of votes."""
    ballot = _ballot(task, nearness)
    band = np.where(nearness > 0, ballot.kind, np.uint8(0))
    refined, agreed = _counted(task, ballot, band, nearness, reach)
    if task.recipe.run > 1 and task.findings.sigma > HARMLESS:
        ballot = _with_thin_things(task, ballot, refined)
        refined, agreed = _counted(task, ballot, band, nearness)
    return refined, agreed


def _moved(nearness: Floats, shift: tuple[int, int]) -> Floats:
    """Move a map by whole px right and down; its outermost samples are repeated."""
    rows, columns = (np.arange(size) for size in nearness.shape)
    row = np.clip(rows - shift[1], 0, rows.size - 1)
    column = np.clip(columns - shift[0], 0, columns.size - 1)
    return np.ascontiguousarray(nearness[row[:, None], column])


def _sharpened(task: RefinementTask, nearness: Floats) -> tuple[Floats, Floats]:
    """Harden soft edges; wide ones in a smaller picture first, as votes do not reach across."""
    sigma = task.findings.sigma
    scale = max(2, round(sigma / 2.0)) if sigma > WIDEST else 1
    shape = nearness.shape[0] // scale, nearness.shape[1] // scale
    if scale > 1 and min(shape) >= LEAST_SIDE:
        small = task._replace(
            color=reduced(task.color, shape),
            findings=task.findings._replace(sigma=sigma / scale),
            noise=task.noise / scale,
        )
        blurred = depth_of if task.findings.is_depth else np.array
        soft = blurred(reduced_known(blurred(nearness), shape))
        hard, _ = _sharpened(small, soft)
        size, ratio = nearness.shape, (shape[0] / nearness.shape[0], shape[1] / nearness.shape[1])
        whole = enlarged(hard, (size[0], size[1]), ratio)
        whole = _only_at_edges(nearness, whole, hard != soft, scale)
        return _hardened(task._replace(recipe=RECIPES["snap"]), whole)
    if task.findings.overshoot > OVERSHOOT:
        changed, smooth = _without_overshoot(task, nearness)
        hard, agreed = _sharpened(changed, smooth)
        reach = math.ceil(2.0 * changed.findings.sigma)
        return _only_at_edges(nearness, hard, hard != smooth, reach), agreed
    return _hardened(task, nearness)


def _only_at_edges(given: Floats, found: Floats, changed: Mask, reach: int) -> Floats:
    """Return what was found within `reach` px of changed samples, and what was given elsewhere."""
    import cv2

    height, width = given.shape
    mask = cv2.resize(changed.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    side = 2 * reach + 1
    near = cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0
    return np.where(given > 0, np.where(near, found, given), np.float32(0))


def _without_overshoot(task: RefinementTask, nearness: Floats) -> tuple[RefinementTask, Floats]:
    """Blur a map until its edges no longer exceed their sides; measure it again."""
    import cv2

    sigma = task.findings.sigma if task.findings.sigma >= 1.0 else 2.0
    weight = cv2.GaussianBlur((nearness > 0).astype(np.float32), (0, 0), sigma)
    blurred = cv2.GaussianBlur(nearness, (0, 0), sigma) / np.maximum(weight, np.float32(1e-6))
    smooth = np.where(nearness > 0, blurred, 0).astype(np.float32)
    soft, again, is_depth, _ = softness_of(smooth, task.noise, task.step)
    again = again if soft > 0 else math.hypot(task.findings.sigma, sigma)
    findings = task.findings._replace(sigma=again, is_depth=is_depth, overshoot=0.0)
    return task._replace(findings=findings), smooth


def _densified(task: RefinementTask, nearness: Floats) -> tuple[Floats, Floats]:
    """Interpolate sparse samples; if they are far apart, in a smaller picture first."""
    from resample_warp3d.depth.refining.densifying import dense_at, scale_of

    size = nearness.shape[0], nearness.shape[1]
    scale = scale_of(nearness)
    shape = max(1, size[0] // scale), max(1, size[1] // scale)
    if scale == 1:
        return dense_at(task.color, nearness, MADE_UP)
    small, agreed = dense_at(reduced(task.color, shape), nearness, MADE_UP)
    whole = enlarged(small, size, (shape[0] / size[0], shape[1] / size[1]))
    hard, _ = _hardened(task, whole)
    return hard, np.where(
        hard > 0, enlarged(agreed, size, (shape[0] / size[0], shape[1] / size[1])), np.float32(0)
    )


def _filled(task: RefinementTask, nearness: Floats, agreed: Floats) -> tuple[Floats, Floats]:
    """Fill unknown nearness from known samples, round by round."""
    for _ in range(MOST_ROUNDS):
        unknown = (nearness <= 0).astype(np.uint8)
        if not unknown.any():
            break
        found, share = _counted(task, _ballot(task, nearness), unknown, nearness)
        nearness = np.where((unknown > 0) & (share < AGREED), np.float32(0), found)
        share = np.where(nearness > 0, MADE_UP * share, 0)
        agreed = np.where(unknown > 0, share, agreed).astype(np.float32)
    return nearness, agreed


def _ballot(task: RefinementTask, nearness: Floats) -> Ballot:
    """Make the voters of a map; samples between surfaces have no weight."""
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
    side = 2 * recipe.around + 1
    band = cv2.dilate((found > 0).astype(np.uint8), np.ones((side, side), np.uint8))
    kind = np.maximum(found, band * np.uint8(BESIDE))
    trust = np.where(kind > 0, np.float32(UNSURE), np.float32(1))
    trust[found == BETWEEN] = 0
    slope = np.empty((*nearness.shape, 4), np.float32)
    measure_slopes(nearness, kind, Bends(recipe.length, recipe.steepest, recipe.bent), slope)
    return Ballot(nearness, trust, slope, kind)


def _counted(
    task: RefinementTask, ballot: Ballot, band: Kinds, nearness: Floats, reach: int = REACH
) -> tuple[Floats, Floats]:
    """Count the votes for a band of samples; return nearness and share of votes."""
    from resample_warp3d.depth.refining.kernels.voting import Voters, vote_rows

    refined, agreed = nearness.copy(), (nearness > 0).astype(np.float32)
    voters = Voters(task.color, ballot.nearness, ballot.trust, ballot.slope)
    vote_rows(voters, window(reach), band, refined, agreed)
    return refined, agreed


def _with_thin_things(task: RefinementTask, ballot: Ballot, refined: Floats) -> Ballot:
    """Restore the nearness of thin objects that blur has reduced, for the votes."""
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
    squared = (offset**2).sum(axis=1)
    share = np.exp(-0.5 * squared / (FAR * reach) ** 2)
    beside = np.abs(offset).min(axis=1) ** 2
    deviation = max(LEAST_NEAR, NEAR * reach)
    close = np.exp((-0.5 * squared - ACROSS * beside) / deviation**2)
    return VotingWindow(offset, share, close)


def _scaled(color: Floats) -> Floats:
    """Scale colors to units of the difference between similar colors."""
    deviation = float(
        np.sqrt(color.reshape(-1, color.shape[2]).var(axis=0, dtype=np.float64).sum() / 3.0)
    )
    return np.asarray(color / np.float32(max(COLOR_DIFFERENCE * deviation, 1e-6)), np.float32)
