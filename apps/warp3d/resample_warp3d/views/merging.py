"""Merge warped views: the nearest surface, from the views that sampled it best."""

import hashlib
import math
from collections.abc import Sequence
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import pixel_centers
from resample.messages import check_kind
from resample.types import Floats
from resample_warp3d.projection_models import CameraModel, unproject
from resample_warp3d.types import Hole, Warped

Blend = Literal["feathered", "confident", "best"]
BLENDS = get_args(Blend)
SHARP = 2.0  # power of the confidence in the weights
LEAST = 1e-12  # weight of a view without confidence
WHOLE = 0.95  # coverage from which a pixel is not border
FEATHER = 2.0  # px from a view's border to its full weight
AT_BORDER = 1e-3  # weight of a view beside its border
AHEAD = np.array([0.0, 0.0, 1.0])
OBLIQUE = math.radians(4.0)  # angle at which a view's weight is halved

Mask = NDArray[np.bool_]
SAME = 0.02  # relative nearness within which views show the same surface
SOLID = 0.5  # least coverage of a view's surface that hides others


def check_blend(blend: Blend) -> None:
    """Reject an unknown blend."""
    if blend not in BLENDS:
        raise ValueError(f"unknown blend {blend!r}; known: {', '.join(BLENDS)}")


def weights(
    views: Sequence[Warped], shown: NDArray[np.bool_], shares: Sequence[Floats], blend: Blend
) -> list[Floats]:
    """Return the weight (H, W) of each view; 0 where it does not show the surface.

    `shown`: (V, H, W) where each view shows the surface in question. `shares`: (H, W) factors of
    each view, such as from `angle_share`; or empty.
    """
    found = []
    for n, (view, where) in enumerate(zip(views, shown, strict=True)):
        weight = view.confidence**SHARP
        if shares:
            weight = weight * shares[n]
        if blend == "feathered":
            weight = weight * feather(where & (view.coverage >= WHOLE))
        found.append(np.where(where, weight + LEAST, 0).astype(np.float32))
    if blend != "best":
        return found
    stack = np.stack(found)
    first = stack.argmax(axis=0)
    return [np.where((first == n) & where, np.float32(1), 0) for n, where in enumerate(stack > 0)]


def feather(shown: Mask) -> Floats:
    """Return a ramp from 0 at a mask's border to 1 inside; the frame is not a border."""
    if shown.all():
        return np.ones(shown.shape, np.float32)
    import cv2

    mask = shown.astype(np.uint8)
    away = cv2.distanceTransform(mask, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    share = np.clip(away / np.float32(FEATHER), 0, 1)
    smooth = share * share * (3 - 2 * share)
    return np.asarray(np.maximum(smooth, np.float32(AT_BORDER)), np.float32)


def angle_share(view: Warped, source: Camera, target: CameraModel) -> Floats:
    """Return a view's weight 0..1 by the angle between its rays and the target's.

    An error of a source's depth displaces its colors in proportion to that angle.
    """
    relative = target.world_to_camera @ np.linalg.inv(source.world_to_camera)
    eye = relative[:3, 3]
    shape = view.coverage.shape[0], view.coverage.shape[1]
    depth = np.where(np.isfinite(view.depth), view.depth, 1.0)
    ray, _ = unproject(target, shape, pixel_centers(shape), 1.0 / depth)
    point = np.nan_to_num(ray * depth[..., None])
    back = point - eye
    along = np.broadcast_to(AHEAD, ray.shape) if isinstance(target, Orthographic) else point
    aside = np.linalg.norm(np.cross(along, back), axis=2)
    angle = np.arctan2(aside, np.einsum("hwk,hwk->hw", along, back))
    return np.asarray(1.0 / (1.0 + np.square(angle / OBLIQUE)), np.float32)


def merge(
    views: Sequence[Warped], blend: Blend = "feathered", shares: Sequence[Floats] = ()
) -> Warped:
    """Merge views of one target, each warped from another source.

    Parameters
    ----------
    views
        Of one shape; the result does not depend on their order, bit by bit.
    blend
        `feathered`: weighted by confidence, fading out toward a view's border, to
        avoid seams; `confident`: weighted by confidence only; `best`: the view with the largest
        weight only, for labels.
    shares
        (H, W) further factors of the views' weights. Default: none.

    Returns
    -------
    Per pixel the mean, weighted by confidence, of the views that show its nearest surface: a source
    that saw the surface from nearby, and not at a grazing angle, has more samples there. Where that
    surface covers a pixel in part, the surface behind it shows. A hole is a hole in all views; of
    its causes the one that is easiest to fix is kept.

    Raises
    ------
    ValueError
        No view is given, their shapes differ, or the blend is unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from resample_warp3d import Camera, merge, warp
    >>> target = Camera.from_fov(60, 24, 32)
    >>> sides = [target.moved(np.c_[np.eye(3), [x, 0, 0]]) for x in (-0.5, 0.5)]
    >>> views = [warp(np.ones((24, 32)), np.full((24, 32), 2.0), side, target) for side in sides]
    >>> [round(float(view.coverage.mean()), 2) for view in (*views, merge(views))]
    [0.85, 0.85, 1.0]
    """
    check_blend(blend)
    for view in views:
        check_kind("view", view, Warped, "results of warp(color, depth, source, target)")
    shapes = {view.image.shape for view in views}
    if len(shapes) != 1:
        raise ValueError(f"views of one shape can be merged, not of {sorted(shapes) or 'none'}")
    order = order_of_bits([(v.image, v.coverage, v.depth, v.confidence) for v in views])
    ordered = [views[n] for n in order]
    factors = [shares[n] for n in order] if shares else []
    nearness = np.stack(
        [np.where(view.coverage > 0, 1.0 / view.depth, 0).astype(np.float32) for view in ordered]
    )
    is_front, (image, coverage, *front) = _surface(ordered, nearness, factors, blend)
    hidden = np.where(is_front, 0, nearness)
    _, (image_behind, coverage_behind, *behind) = _surface(ordered, hidden, factors, blend)
    rest = np.float32(1) - coverage
    near, magnification, confidence = np.where(coverage > 0, front, behind)
    coverage = coverage + rest * coverage_behind
    depth = np.divide(1.0, near, out=np.full_like(near, np.inf), where=near > 0)
    image = image + rest[..., None] * image_behind
    # Holes that all views have; cracks where no view is better.
    reason = np.full(coverage.shape, Hole.NONE, np.uint8)
    for hole in (Hole.OUTSIDE, Hole.NO_DEPTH, Hole.DISOCCLUDED):
        reason[np.any([view.holes == hole for view in ordered], axis=0)] = hole
    is_crack = np.any([view.holes == Hole.CRACK for view in ordered], axis=0)
    is_whole = np.any([(view.holes == Hole.NONE) & (view.coverage > 0) for view in ordered], axis=0)
    covered = np.where(is_crack & ~is_whole, np.uint8(Hole.CRACK), np.uint8(Hole.NONE))
    holes = np.where(coverage > 0, covered, reason)
    return Warped(image, coverage, depth, holes, magnification, confidence)


def _surface(
    views: Sequence[Warped], nearness: Floats, shares: Sequence[Floats], blend: Blend
) -> tuple[NDArray[np.bool_], list[Floats]]:
    """Find the nearest surface of several views (V, H, W).

    Returns where each shows it, and its image, coverage, nearness, magnification and confidence,
    (H, W[, C]); all 0 where none does.
    """
    solid = np.stack([view.coverage >= SOLID for view in views])
    front = np.where(solid, nearness, 0).max(axis=0)
    is_front = (nearness >= front * (1.0 - SAME)) & (nearness > 0)
    total = np.zeros(front.shape, np.float32)
    image = np.zeros(views[0].image.shape, np.float32)
    coverage, near, magnification, confidence = (np.zeros_like(total) for _ in range(4))
    counts = weights(views, is_front, shares, blend)
    for view, shown, depth, weight in zip(views, is_front, nearness, counts, strict=True):
        total += weight
        image += weight[..., None] * view.image
        coverage += weight * view.coverage
        near += weight * depth
        magnification += weight * view.magnification
        confidence = np.maximum(confidence, np.where(shown, view.confidence, 0))
    share = np.divide(1.0, total, out=np.zeros_like(total), where=total > 0)
    means = (each * share for each in (coverage, near, magnification))
    return is_front, [image * share[..., None], *means, confidence]


def order_of_bits(things: Sequence[Sequence[NDArray[Any]]]) -> list[int]:
    """Return a canonical order of items, by a hash of their arrays."""

    def digest(n: int) -> bytes:
        parts = (np.ascontiguousarray(part).data for part in things[n])
        return hashlib.blake2b(b"".join(parts)).digest()

    return sorted(range(len(things)), key=digest)
