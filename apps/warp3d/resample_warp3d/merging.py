"""Several warped views in one: the nearest surface, from the views that sampled it best."""

import hashlib
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resample.types import Floats
from resample_warp3d.types import Hole, Warped

SAME = 0.02  # of the nearness: views whose surfaces are closer together than this see one
SHARP = 2.0  # power of the confidence that views are weighed with
SOLID = 0.5  # coverage from which on a view's surface hides others


def merge(views: Sequence[Warped]) -> Warped:
    """Views of one target, each warped from another source, as one.

    Parameters
    ----------
    views
        Of one shape; their order makes no difference to a single bit.

    Returns
    -------
    Per pixel the mean of the views that show its nearest surface, weighed by their confidence: a
    source that saw the surface from nearby, and not at a grazing angle, has more samples there. A
    hole is a hole in all views; of its reasons the one nearest to a remedy is kept.

    Raises
    ------
    ValueError
        There is no view, or their shapes differ.
    """
    shapes = {view.image.shape for view in views}
    if len(shapes) != 1:
        raise ValueError(f"views of one shape can be merged, not of {sorted(shapes) or 'none'}")
    ordered = sorted(views, key=_digest)
    nearness = [_nearness(view) for view in ordered]
    front = np.max(
        [np.where(v.coverage >= SOLID, n, 0) for v, n in zip(ordered, nearness, strict=True)],
        axis=0,
    )
    total = np.zeros(front.shape, np.float32)
    image, depth = np.zeros(views[0].image.shape, np.float32), np.zeros_like(total)
    coverage, confidence, magnification = (np.zeros_like(total) for _ in range(3))
    for view, near in zip(ordered, nearness, strict=True):
        weight = np.where(near >= front * (1.0 - SAME), view.confidence**SHARP, 0)
        weight = np.where(view.coverage > 0, weight + 1e-12, 0).astype(np.float32)
        weight *= near >= front * (1.0 - SAME)
        total += weight
        image += weight[..., None] * view.image
        coverage += weight * view.coverage
        depth += weight * near
        magnification += weight * view.magnification
        confidence = np.maximum(confidence, np.where(weight > 0, view.confidence, 0))
    share = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    near = depth * share
    return Warped(
        image * share[..., None],
        coverage * share,
        np.divide(1.0, near, out=np.full_like(near, np.inf), where=near > 0),
        _holes(ordered, coverage * share),
        magnification * share,
        confidence,
    )


def _nearness(view: Warped) -> Floats:
    return np.where(view.coverage > 0, 1.0 / view.depth, 0).astype(np.float32)


def _digest(view: Warped) -> bytes:
    """What views are put in order by: their bits."""
    parts = (view.image, view.coverage, view.depth, view.confidence)
    return hashlib.blake2b(b"".join(np.ascontiguousarray(part).data for part in parts)).digest()


def _holes(views: Sequence[Warped], coverage: Floats) -> NDArray[np.uint8]:
    """Reasons of the holes that all views have; cracks where no view has anything better."""
    reason = np.full(coverage.shape, Hole.NONE, np.uint8)
    for hole in (Hole.OUTSIDE, Hole.NO_DEPTH, Hole.DISOCCLUDED):
        found = np.any([view.holes == hole for view in views], axis=0)
        reason[found] = hole
    is_crack = np.any([view.holes == Hole.CRACK for view in views], axis=0)
    is_whole = np.any([(view.holes == Hole.NONE) & (view.coverage > 0) for view in views], axis=0)
    covered = np.where(is_crack & ~is_whole, np.uint8(Hole.CRACK), np.uint8(Hole.NONE))
    return np.where(coverage > 0, covered, reason)
