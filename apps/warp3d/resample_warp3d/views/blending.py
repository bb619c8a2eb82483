"""Blending weights of views: by sampling, angle and distance to the border."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from resample.cameras.models import Camera, Orthographic
from resample.cameras.pixels import pixel_centers
from resample.types import Floats
from resample_warp3d.types import Warped
from resample_warp3d.wide.projections import CameraModel, unproject

BLENDS = ("feathered", "confident", "best")
SHARP = 2.0  # power of the confidence in the weights
LEAST = 1e-12  # weight of a view without confidence
WHOLE = 0.95  # coverage from which a pixel is not border
FEATHER = 2.0  # px from a view's border to its full weight
AT_BORDER = 1e-3  # weight of a view beside its border
AHEAD = np.array([0.0, 0.0, 1.0])
OBLIQUE = math.radians(4.0)  # angle at which a view's weight is halved

Mask = NDArray[np.bool_]


def check_blend(blend: str) -> None:
    """Refuse an unknown blend."""
    if blend not in BLENDS:
        raise ValueError(f"unknown blend {blend!r}; known: {', '.join(BLENDS)}")


def weights(
    views: Sequence[Warped], shown: NDArray[np.bool_], shares: Sequence[Floats], blend: str
) -> list[Floats]:
    """Return the weight (H, W) of each view; 0 where it does not show the surface.

    Parameters
    ----------
    shown
        (V, H, W) where each view shows the surface in question.
    shares
        (H, W) factors of each view, such as from `angle_share`; or empty.
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
