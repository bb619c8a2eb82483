"""Fit depth maps to their pictures: move edges to color edges, fill gaps and blocks.

Samples near edges are assigned to surfaces by votes of samples around them, weighted by color
(`voting`). Samples between two surfaces, and unknown ones, do not vote.
"""

import math
from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.depth.refining.enlargement import (
    Enlargement,
    SmallMap,
    enlarged_by,
    parted,
    small_map,
    small_map_like,
)
from resample_warp3d.depth.refining.hardening import (
    REACH,
    RECIPES,
    RefinementTask,
    ballot_of,
    counted,
    grown,
    hardened,
    scaled,
    unblocked,
)
from resample_warp3d.depth.refining.inspecting import (
    NOTHING,
    OVERSHOOT,
    WIDEST,
    Findings,
    depth_of,
    inspect,
    known,
    linked,
    noise_of,
    quantum_of,
    softness_of,
)
from resample_warp3d.depth.refining.resizing import enlarged, fitted, reduced, reduced_known
from resample_warp3d.types import DepthImage

Kinds = NDArray[np.uint8]
Mask = NDArray[np.bool_]

Refine = Literal["auto", "none", "snap", "sharpen", "shift", "complete", "densify"]
REFINES = get_args(Refine)
MOST_ROUNDS = 3  # of voting for unknown samples: 8 px each
WELCOME = 1.3  # most times the error of a map grown by colors that a sharpened one may have
ALIKE = 4.0  # enlargement up to which both may have the same
SLIGHT = 2e-3  # relative: larger errors are compared
MADE_UP = 0.5  # confidence of a unanimous vote for an unknown sample
AGREED, UNANIMOUS = 0.95, 0.995  # share of the votes that an unknown sample needs, if in front
WIDE_GAP = 13  # px, side of squares that only shadows beside things hold; these are behind
IN_FRONT = 1.1  # times the nearness of the farthest surface around: more is in front
NOWHERE = 1e30  # nearness: larger than any
LEAST_SIDE = 32  # px: pictures are not reduced to less


class Refined(NamedTuple):
    """A refined depth image."""

    image: DepthImage
    confidence: Floats  # (H, W) 0..1; 1 where unchanged, 0 where unknown
    findings: Findings  # with `none`, only `unknown` is valid
    chosen: str  # one of `REFINES`, except auto
    step: float  # quantization step of nearness before refinement
    enlargement: Enlargement | None = None  # of the map before refinement, if one was found
    noise: float = 0.0  # of nearness before refinement

    @property
    def choice(self) -> "RefinementChoice":
        """Choices, for other pictures of the shot."""
        return RefinementChoice(self.chosen, self.enlargement, self.findings, self.noise)


class RefinementChoice(NamedTuple):
    """Choices for a shot's first picture, which hold for the whole shot."""

    name: str  # one of `REFINES`, except auto
    enlargement: Enlargement | None
    findings: Findings
    noise: float


def refine(
    image: DepthImage,
    name: Refine = "auto",
    *,
    noise: float | None = None,
    step: float | None = None,
    is_measured: bool = False,
    like: RefinementChoice | None = None,
) -> Refined:
    """Refine a depth image.

    Parameters
    ----------
    image
        Color and nearness; nearness may have another size if it shows the same frame.
    name
        `auto` looks for defects, and keeps a map with edges where colors change. `snap` moves
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
    like
        Choice of an earlier picture of the same shot; instead of looking for defects.

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
    >>> refined = refine(DepthImage(color, nearness), "complete")
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
    if noise is None and like is not None:
        noise = like.noise
    elif noise is None:
        noise = noise_of(nearness, linked(nearness, quantum, 0.0))
    color = np.nan_to_num(np.ascontiguousarray(image.color, np.float32), posinf=0.0, neginf=0.0)
    findings = inspect(color, nearness, noise, quantum) if like is None else like.findings
    findings = findings._replace(is_measured=findings.is_measured or is_measured)
    may_be = not (is_enlarged or findings.is_sparse)
    small = None
    if may_be and like is None:
        small = small_map(nearness, quantum, is_soft=findings.is_soft)
    elif like is not None and like.enlargement is not None:
        small = small_map_like(nearness, quantum, like.enlargement)
    findings = findings._replace(enlargement=1.0 if small is None else small.side)
    chosen: str = name
    if name == "auto" and small is not None:
        chosen = "snap" if small.is_repeated else "sharpen"
    elif name == "auto":
        chosen = findings.remedy
        chosen = "snap" if is_enlarged and chosen not in ("sharpen", "densify") else chosen
    if like is not None:
        chosen = like.name
    elif small is not None and not small.is_repeated:
        own = depth_of(small.values) if small.is_depth else small.values
        if _softness(own, noise, quantum).remedy == "sharpen":
            small = None  # soft itself: the map of full size tells more
    if chosen == "none":
        return Refined(image, confidence, findings, chosen, quantum, noise=noise)
    task = RefinementTask(
        scaled(color), findings, noise, quantum, RECIPES.get(chosen, RECIPES["snap"])
    )
    if chosen == "densify":
        from resample_warp3d.depth.refining.densifying import dense_at, scale_of

        # If samples are far apart, they are interpolated in a smaller picture first.
        size, scale = (nearness.shape[0], nearness.shape[1]), scale_of(nearness)
        if scale == 1:
            nearness, confidence = dense_at(task.color, nearness, MADE_UP)
        else:
            shape = max(1, size[0] // scale), max(1, size[1] // scale)
            few, agreed = dense_at(reduced(task.color, shape), nearness, MADE_UP)
            nearness, _ = hardened(task, enlarged(few, size))
            confidence = np.where(nearness > 0, enlarged(agreed, size), np.float32(0))
        image = image._replace(nearness=nearness)
        return Refined(image, confidence, findings, chosen, quantum, noise=noise)
    nearness, confidence = _repaired(task, chosen, nearness, small)
    if name != "auto" or findings.is_measured:
        nearness, confidence = _filled(task, nearness, confidence)
    image, how = image._replace(nearness=nearness), None if small is None else small.how
    return Refined(image, confidence, findings, chosen, quantum, how, noise)


def _repaired(
    task: RefinementTask, chosen: str, nearness: Floats, small: SmallMap | None
) -> tuple[Floats, Floats]:
    """Apply a refinement without filling; also return the share of votes, 1 where unchanged."""
    if chosen == "sharpen":
        if small is not None and not small.is_repeated:
            return _grown(task, small, nearness)
        return _sharpened(task, nearness)
    if chosen == "snap":
        if small is not None and small.is_repeated:
            return unblocked(task, small, nearness)
        return hardened(task, nearness)
    if chosen == "shift":
        # By whole px right and down; the outermost samples are repeated.
        right, down = task.findings.shift
        rows, columns = (np.arange(size) for size in nearness.shape)
        row = np.clip(rows - down, 0, rows.size - 1)
        column = np.clip(columns - right, 0, columns.size - 1)
        nearness = np.ascontiguousarray(nearness[row[:, None], column])
    return nearness, (nearness > 0).astype(np.float32)


def _grown(task: RefinementTask, small: SmallMap, nearness: Floats) -> tuple[Floats, Floats]:
    """Enlarge a small map to the edges of color; also return the share of votes.

    Where the map, sharpened as it was enlarged, is closer to the small one's samples, it is taken.
    """
    height, width = nearness.shape
    # What covers a mean of two surfaces is told by colors alone.
    values, is_mean = parted(small.values)
    near = depth_of(values) if small.is_depth else values
    start = enlarged(near, (height, width), (small.rows, small.columns))
    mixed = small.repeated(is_mean, (height, width))
    found, agreed = grown(task, start, round(small.side), mixed)
    soft = enlarged_by(small, (height, width))
    soft = depth_of(soft) if small.is_depth else soft
    findings = _softness(soft, task.noise, task.step)
    if findings.remedy != "sharpen":
        return found, agreed
    most = min(WELCOME, ALIKE / small.side) * _error(found, small) - SLIGHT
    where = small.repeated(most > 0, (height, width))
    hard, votes = _sharpened(task._replace(findings=findings), soft, where)
    takes = small.repeated(_error(hard, small) < most, (height, width))
    snap = task._replace(recipe=RECIPES["snap"])
    joined, again = hardened(snap, np.where(takes, hard, found), where=takes)
    return joined, np.minimum(np.where(takes, votes, agreed), again)


def _softness(nearness: Floats, noise: float, step: float) -> Findings:
    """Measure how soft a map's edges are."""
    share, sigma, is_depth, overshoot = softness_of(nearness, noise, step)
    return NOTHING._replace(soft=share, sigma=sigma, is_depth=is_depth, overshoot=overshoot)


def _error(nearness: Floats, small: SmallMap) -> Floats:
    """Return the relative error of a map's means against a small map's samples, smoothed."""
    import cv2

    mean = small.means(depth_of(nearness) if small.is_depth else nearness)
    return np.asarray(cv2.blur(np.abs(mean / small.values - 1.0), (3, 3)))


def _sharpened(
    task: RefinementTask, nearness: Floats, where: Mask | None = None
) -> tuple[Floats, Floats]:
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
        whole = enlarged(hard, (nearness.shape[0], nearness.shape[1]))
        whole = _only_at_edges(nearness, whole, hard != soft, scale)
        return hardened(task._replace(recipe=RECIPES["snap"]), whole)
    if task.findings.overshoot > OVERSHOOT:
        import cv2

        # Blur it until its edges no longer exceed their sides, and measure it again.
        sigma = task.findings.sigma if task.findings.sigma >= 1.0 else 2.0
        weight = cv2.GaussianBlur((nearness > 0).astype(np.float32), (0, 0), sigma)
        soft = cv2.GaussianBlur(nearness, (0, 0), sigma) / np.maximum(weight, np.float32(1e-6))
        smooth = np.where(nearness > 0, soft, 0).astype(np.float32)
        share, again, is_depth, _ = softness_of(smooth, task.noise, task.step)
        again = again if share > 0 else math.hypot(task.findings.sigma, sigma)
        findings = task.findings._replace(sigma=again, is_depth=is_depth, overshoot=0.0)
        hard, agreed = _sharpened(task._replace(findings=findings), smooth)
        reach = math.ceil(2.0 * again)
        return _only_at_edges(nearness, hard, hard != smooth, reach), agreed
    return hardened(task, nearness, where=where)


def _only_at_edges(given: Floats, found: Floats, changed: Mask, reach: int) -> Floats:
    """Return refined values within `reach` px of changed samples, and the given ones elsewhere."""
    import cv2

    height, width = given.shape
    mask = cv2.resize(changed.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    side = 2 * reach + 1
    near = cv2.dilate(mask, np.ones((side, side), np.uint8)) > 0
    return np.where(given > 0, np.where(near, found, given), np.float32(0))


def _filled(task: RefinementTask, nearness: Floats, agreed: Floats) -> tuple[Floats, Floats]:
    """Fill unknown nearness from known samples, round by round.

    What a sensor misses beside an edge is mostly behind it, so the votes for anything nearer than
    the farthest surface around must be all but unanimous, and count for nothing in wide gaps, which
    are shadows: wrong samples in front hide right ones.
    """
    import cv2

    around = np.ones((2 * REACH + 1, 2 * REACH + 1), np.uint8)
    square = np.ones((WIDE_GAP, WIDE_GAP), np.uint8)
    is_wide = cv2.morphologyEx((nearness <= 0).astype(np.uint8), cv2.MORPH_OPEN, square) > 0
    in_front = np.where(is_wide, np.inf, UNANIMOUS)
    for _ in range(MOST_ROUNDS):
        unknown = (nearness <= 0).astype(np.uint8)
        if not unknown.any():
            break
        found, share = counted(task, ballot_of(task, nearness), unknown, nearness)
        farthest = cv2.erode(np.where(unknown, np.float32(NOWHERE), nearness), around)
        least = np.where(found > IN_FRONT * farthest, in_front, AGREED)
        nearness = np.where((unknown > 0) & (share < least), np.float32(0), found)
        share = np.where(nearness > 0, MADE_UP * share, 0)
        agreed = np.where(unknown > 0, share, agreed).astype(np.float32)
    return nearness, agreed
